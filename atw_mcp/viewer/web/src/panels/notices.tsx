// What is not shown and why, and work that is not finished.
import { document, failure, gone, live, lost, running } from "../state";
import { Work } from "./running";
import "./notices.css";

/** More sentences than this are collapsed to their count, so that the film stays in sight. */
const SHOWN_AT_ONCE = 2;

export function Notices() {
  const doc = document.value;
  if (!doc || (doc.missing.length === 0 && running.value.length === 0 && !failure.value && !lost.value && !gone.value)) return null;
  return (
    <section class="notices" aria-label="notices">
      {failure.value && (
        <p class="notice failed" role="alert">
          {failure.value}
        </p>
      )}
      {live.value && lost.value && (
        <p class="notice failed" role="alert" data-lost>
          The server has not answered since {lost.value.toLocaleTimeString()}: what is shown may be out of date. It is
          asked again every few seconds; where it was ended, `atw-mcp view` starts another.
        </p>
      )}
      {live.value && gone.value && (
        <p class="notice failed" role="alert" data-gone>
          The store is no longer at {gone.value}: it was removed, renamed or replaced, and what is shown may be out of
          date. Put it back, or start `atw-mcp view` with --store and its new place.
        </p>
      )}
      {running.value.map((work) => (
        <Work key={work.evidence} work={work} />
      ))}
      {doc.missing.length > 0 && <Missing sentences={doc.missing} />}
    </section>
  );
}

function Missing({ sentences }: { sentences: string[] }) {
  if (sentences.length <= SHOWN_AT_ONCE)
    return (
      <div class="notice" data-missing={sentences.length}>
        {sentences.map((sentence) => (
          <p key={sentence}>{sentence}</p>
        ))}
      </div>
    );
  return (
    <details class="notice" data-missing={sentences.length}>
      <summary>{sentences.length} things are not shown</summary>
      <ul>
        {sentences.map((sentence) => (
          <li key={sentence}>{sentence}</li>
        ))}
      </ul>
    </details>
  );
}
