// Work that is not finished: what it does, how far it is, how long it still takes, and the course of its error.
import type { Running } from "../document";
import { wait } from "../format";
import { errorWords } from "./error_words";
import { SearchCurve } from "./search_curve";
import "./running.css";

export function Work({ work }: { work: Running }) {
  const percent = work.total ? Math.round((100 * work.done) / work.total) : null;
  const left = work.seconds_left === null ? "" : `about ${wait(work.seconds_left)} left`;
  const curve = work.curve && work.curve.steps.length > 1 ? work.curve : null;
  return (
    <div class="notice running" data-running={work.evidence} data-done={work.done} data-total={work.total ?? ""}>
      <div class="row">
        <span role="status">
          <b>{work.tool}</b> {work.message}
        </span>
        <span class="soft number">{[percent === null ? "" : `${percent} %`, left].filter(Boolean).join(", ")}</span>
      </div>
      <progress
        aria-label={`${work.tool} progress`}
        max={work.total ?? undefined}
        value={work.total ? work.done : undefined}
      />
      {curve && (
        <details open>
          <summary class="small">course of the search</summary>
          <SearchCurve curve={curve} />
          <p class="small soft">
            How far the simulated motion is from the observed{errorWords(curve.unit)}. A new line begins where the search goes on
              to more of the observed frames or starts once more: errors compare along one line.
          </p>
        </details>
      )}
    </div>
  );
}
