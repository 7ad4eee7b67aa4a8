// In a conversation: the result that the page shows, and what a person can ask of the host and of the server.
import { signal } from "@preact/signals";
import { callServer, otherRollouts, open, share, toggleFullscreen } from "../app";
import { hosted, note, unfolded } from "../hosted";
import { document, evidence } from "../state";
import "./hostbar.css";

/** Text of a result that was read again, and its id. */
const again = signal<{ id: string; text: string } | null>(null);

export function HostBar() {
  const app = hosted.value;
  if (!app) return null;
  const { host, call, mode } = app;
  const others = otherRollouts();
  const cited = evidence.value ?? call.evidence;
  const full = mode === "fullscreen";
  // of work that was not finished when the host got its result, the server knows more by now
  const summary = document.value?.evidence.find((row) => row.id === call.evidence)?.summary ?? call.summary;
  return (
    <section class="hostbar" aria-label="result" data-tool={call.tool} data-evidence={call.evidence ?? ""}>
      <p class="result" title={summary}>
        <b>{call.tool}</b> {summary}
      </p>
      <div class="bar">
        {others.length > 0 && (
          <select
            aria-label="other rollouts of the case"
            value=""
            onChange={(event) => void open([event.currentTarget.value])}
          >
            <option value="">{others.length} other rollouts</option>
            {others.map((id) => (
              <option key={id}>{id}</option>
            ))}
          </select>
        )}
        {host.capabilities?.serverTools && cited && (
          <button class="quiet" onClick={() => void readAgain(cited)}>
            Read {cited}
          </button>
        )}
        {(host.capabilities?.updateModelContext || host.capabilities?.message) && (
          <button
            class="quiet"
            title="Give the model what is shown now, for your next question"
            onClick={() => void share()}
          >
            Ask about this moment
          </button>
        )}
        <span class="push" />
        {!full && (
          <button aria-expanded={unfolded.value} onClick={() => (unfolded.value = !unfolded.value)}>
            {unfolded.value ? "Less" : "More"}
          </button>
        )}
        {host.context.availableDisplayModes?.includes("fullscreen") && (
          <button onClick={() => void toggleFullscreen()}>{full ? "Back to the conversation" : "Full screen"}</button>
        )}
      </div>
      {note.value && (
        <p class="small soft" role="status">
          {note.value}
        </p>
      )}
      {again.value && (
        <div class="panel">
          <div class="bar">
            <h2>{again.value.id}</h2>
            <span class="push" />
            <button class="quiet" onClick={() => (again.value = null)}>
              Close
            </button>
          </div>
          <pre class="scroll" data-read={again.value.id}>
            {again.value.text}
          </pre>
        </div>
      )}
    </section>
  );
}

/** Show a result as the server keeps it. */
async function readAgain(id: string): Promise<void> {
  const text = await callServer("ReadEvidence", { evidence: id });
  if (text !== null) again.value = { id, text: indented(text) };
}

function indented(text: string): string {
  try {
    return JSON.stringify(JSON.parse(text), null, 1);
  } catch {
    return text;
  }
}
