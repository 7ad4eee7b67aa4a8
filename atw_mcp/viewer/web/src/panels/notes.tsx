// Notes at a moment: those of the present one, and, where a server keeps them, room to write another.
import { computed, useSignal } from "@preact/signals";
import { moment } from "../format";
import { chosen, document, live, object, secondsPerFrame, seek, time } from "../state";
import "./notes.css";

/** Records of notes stand among the evidence. */
export const NOTE = "Note";
/** A note is shown from this long before its moment until this long after [s]; a frame where that is longer. */
const ABOUT = 0.1;

export const notes = computed(() =>
  (document.value?.evidence ?? [])
    .filter((row) => row.tool === NOTE && row.interval !== null)
    .map((row) => ({ id: row.id, text: row.summary, time: row.interval![0] ?? 0, objects: row.objects })),
);

export function Notes() {
  const about = Math.max(ABOUT, secondsPerFrame.value);
  const here = notes.value.filter((n) => Math.abs(n.time - time.value) <= about);
  if (!live.value && notes.value.length === 0) return null;
  return (
    <div class="notes bar" role="group" aria-label="notes">
      {here.map((note) => (
        <p key={note.id} data-note={note.id} data-time={note.time}>
          <button class="link number" onClick={() => seek(note.time)}>
            {moment(note.time)}
          </button>{" "}
          {note.text}
        </p>
      ))}
      {live.value && <Writing />}
      {!live.value && here.length === 0 && (
        <p class="soft small">{notes.value.length === 1 ? "1 note" : `${notes.value.length} notes`}, marked on the time bar</p>
      )}
    </div>
  );
}

function Writing() {
  const text = useSignal("");
  const trouble = useSignal("");
  const keep = async () => {
    if (!text.value.trim()) return;
    const note = { text: text.value, time: time.value, object: object.value, rollout: chosen.value };
    try {
      const answer = await fetch("notes", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify(note),
      });
      if (!answer.ok) throw new Error((await answer.text()) || String(answer.status));
      [text.value, trouble.value] = ["", ""]; // the page follows the case, where the note now is
    } catch (error) {
      trouble.value = `The note was not kept: ${error instanceof Error ? error.message : error}`;
    }
  };
  return (
    <>
      <input
        aria-label="note at this moment"
        placeholder={`note at ${moment(time.value)}, kept as evidence`}
        maxLength={2000}
        value={text.value}
        onInput={(event) => (text.value = event.currentTarget.value)}
        onKeyDown={(event) => event.key === "Enter" && void keep()}
      />
      <button disabled={!text.value.trim()} onClick={() => void keep()}>
        Keep note
      </button>
      {trouble.value && <span role="alert">{trouble.value}</span>}
    </>
  );
}
