// What is not shown and why, and work that is not finished.
import { wait } from "../format";
import { document, failure } from "../state";
import type { Running } from "../document";
import "./notices.css";

/** More sentences than this are collapsed to their count, so that the film stays in sight. */
const SHOWN_AT_ONCE = 2;

export function Notices() {
  const doc = document.value;
  if (!doc || (doc.missing.length === 0 && doc.running.length === 0 && !failure.value)) return null;
  return (
    <section class="notices" aria-label="notices">
      {failure.value && (
        <p class="notice failed" role="alert">
          {failure.value}
        </p>
      )}
      {doc.running.map((work) => (
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

function Work({ work }: { work: Running }) {
  const percent = work.total ? Math.round((100 * work.done) / work.total) : null;
  const left = work.seconds_left === null ? "" : `about ${wait(work.seconds_left)} left`;
  return (
    <div class="notice running" role="status" data-running={work.evidence}>
      <div class="row">
        <span>
          <b>{work.tool}</b> {work.message}
        </span>
        <span class="soft number">{[percent === null ? "" : `${percent} %`, left].filter(Boolean).join(", ")}</span>
      </div>
      <progress aria-label={`${work.tool} progress`} max={work.total ?? undefined} value={work.total ? work.done : undefined} />
    </div>
  );
}
