// How far answers can be trusted: how well the world that they rest on follows the data, and probabilities.
import { computed } from "@preact/signals";
import type { Answer, Following, WorldView } from "../document";
import { digits, quantity } from "../format";
import { document, tab } from "../state";
import { cite } from "./head";

const WORDS: Record<Following["verdict"], { text: string; chip: string }> = {
  good: { text: "follows the data", chip: "good" },
  doubtful: { text: "follows the data, with doubts", chip: "warn" },
  poor: { text: "follows the data poorly", chip: "bad" },
};
const FEW = 2; // doubts that are shown at once

/** The committed world: every probe, and so every answer, starts from it. */
const world = computed<WorldView | null>(() => {
  const doc = document.value;
  return doc?.worlds.find((w) => w.id === doc.case.committed_world) ?? null;
});

/** A line of the header. */
export function Trust() {
  const shown = world.value;
  if (!shown) return null;
  const found = shown.follows;
  return (
    <div class="trust small" data-verdict={found?.verdict ?? ""} data-value={found?.rms ?? ""}>
      <span class="soft">Answers rest on</span> <b>{shown.label}</b>
      {found ? (
        <span class={`chip ${WORDS[found.verdict].chip}`}>{WORDS[found.verdict].text}</span>
      ) : document.value!.gaps.length > 0 ? (
        <button class="link" onClick={() => (tab.value = "gap")}>
          judged by the gap it leaves
        </button>
      ) : (
        <span class="soft">not judged by a fit</span>
      )}
      {found && found.rms_held_out !== null && (
        <span class="number soft">held out: {quantity(found.rms_held_out, "m", 3)} rms</span>
      )}
      {found && (
        <button class="link" onClick={() => cite(found.evidence)}>
          {found.evidence}
        </button>
      )}
      {found && found.doubts.length > 0 && (
        <p class="doubts" role="note" title={found.doubts.join("\n")}>
          <b aria-hidden="true">⚠</b> {found.doubts.slice(0, FEW).join("; ")}
          {found.doubts.length > FEW && `; and ${found.doubts.length - FEW} more`}
        </p>
      )}
    </div>
  );
}

/** On the card of an answer: that the world it rests on leaves the data. */
export function Doubt() {
  const found = world.value?.follows;
  if (!found || found.verdict === "good") return null;
  return (
    <span class={`chip ${WORDS[found.verdict].chip}`} data-doubt={found.verdict} title={found.doubts.join("\n")}>
      ⚠ its world {WORDS[found.verdict].text}
    </span>
  );
}

/** Probabilities that an ensemble of the world gave to the statements that an answer rests on. */
export function Chances({ answer }: { answer: Answer }) {
  return (
    <>
      {answer.chances.map((c, k) => (
        <span key={k} class="number" data-probability={c.probability} title={c.less_sure_because || undefined}>
          {c.statement}: probability {digits(c.probability, 2)}
          {c.interval90 && ` (90 %: ${digits(c.interval90[0], 2)} to ${digits(c.interval90[1], 2)})`}
        </span>
      ))}
    </>
  );
}
