// The gap between a world and what was measured: each step of finding, naming and closing it, in order.
import { useEffect, useMemo, useRef } from "preact/hooks";
import { signal, useSignal } from "@preact/signals";
import type { GapView } from "../document";
import { words } from "../format";
import { document, evidence, opened, tab } from "../state";
import { Candidates } from "../gap/candidates";
import { residualsOf } from "../gap/data";
import { Jumps } from "../gap/jumps";
import { OverPlace } from "../gap/over_place";
import { OverTime } from "../gap/over_time";
import { Proof } from "../gap/proof";
import "./gap.css";

const TITLES = {
  FindDiscrepancy: "Where world and data disagree",
  ProposeEffects: "What is missing",
  AddEffect: "An effect added",
} as const;
const SUMMARY = 320; // characters shown at once
const OPEN_AT_FIRST = 4; // steps; of more the last are open

export function Gap() {
  const views = document.value?.gaps ?? [];
  if (!views.length) return <p class="empty">No step of the gap workflow has been taken in this case.</p>;
  return (
    <section class="gap" aria-label="gap">
      {views.map((view, k) => (
        <Step key={view.evidence} view={view} number={k + 1} openAtFirst={k >= views.length - OPEN_AT_FIRST} />
      ))}
    </section>
  );
}

function Step({ view, number, openAtFirst }: { view: GapView; number: number; openAtFirst: boolean }) {
  const open = useMemo(() => signal(openAtFirst), []);
  return (
    <details
      class="gap-step"
      open={open.value}
      onToggle={(event) => (open.value = event.currentTarget.open)}
      data-gap-step={view.evidence}
      data-tool={view.tool}
    >
      <summary>
        <span class="number soft">{number}</span>
        <h2>{TITLES[view.tool]}</h2>
        <span class={`chip ${toneOf(view)}`} data-verdict={view.verdict}>
          {toneOf(view) === "good" ? "✓ " : toneOf(view) === "bad" ? "✗ " : "? "}
          {words(view.verdict)}
        </span>
      </summary>
      {open.value && <Content view={view} />}
    </details>
  );
}

function toneOf(view: GapView): "good" | "warn" | "bad" {
  if (/^(Identified:|Nothing)/.test(view.verdict) || /nothing is missing$/.test(view.verdict)) return "good";
  return /^(Identified|Ambiguous)/.test(view.verdict) ? "warn" : "bad";
}

function Content({ view }: { view: GapView }) {
  const items = useMemo(() => residualsOf(view, opened.value!), [view]);
  const best = view.candidates[0]?.title;
  const effectName = best ? words(best) : "the effect";
  const whole = useMemo(() => signal(false), []);
  const long = view.summary.length > SUMMARY + 40;
  const seen = items.filter((i) => i.axes.length);
  return (
    <div class="gap-content">
      <p class="gap-summary">
        {long && !whole.value ? `${view.summary.slice(0, SUMMARY)}… ` : `${view.summary} `}
        {long && (
          <button class="link small" aria-expanded={whole.value} onClick={() => (whole.value = !whole.value)}>
            {whole.value ? "less" : "more"}
          </button>
        )}{" "}
        <button
          class="link small"
          onClick={() => {
            evidence.value = view.evidence;
            tab.value = "evidence";
          }}
        >
          {view.evidence}, {view.tool}
        </button>
      </p>
      <Index />
      <Proof view={view} />
      <Candidates candidates={view.candidates} compared={view.tool === "ProposeEffects"} />
      {seen.length > 0 ? (
        <>
          <OverTime items={seen} effectName={effectName} />
          <OverPlace items={seen} effectName={effectName} />
          <Jumps jumps={view.jumps} items={seen.filter((i) => i.kind === "position")} />
        </>
      ) : (
        <p class="soft small">This result holds no residuals as numbers.</p>
      )}
    </div>
  );
}

/** The headings of the figures below, to go to: they are several screens long. */
function Index() {
  const here = useRef<HTMLElement>(null);
  const titles = useSignal<string[]>([]);
  const headings = () => [...here.current!.parentElement!.querySelectorAll<HTMLElement>("h3")];
  useEffect(() => {
    const found = headings().map((heading) => heading.textContent ?? "");
    if (found.join() !== titles.value.join()) titles.value = found;
  });
  return (
    <nav class="bar" aria-label="figures" ref={here}>
      {titles.value.map((title, k) => (
        <button key={title} class="link small" onClick={() => headings()[k]!.scrollIntoView({ behavior: "smooth" })}>
          {title}
        </button>
      ))}
    </nav>
  );
}
