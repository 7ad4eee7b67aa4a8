// The page: the case, the film beside the scene, time, and one of several panels below.
import type { ComponentType } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { document, duration, failure, layout, progress, tab, type Tab } from "./state";
import type { ViewDocument } from "./document";
import { Choosers } from "./panels/choosers";
import { Comparison } from "./panels/comparison";
import { Evidence } from "./panels/evidence";
import { Film } from "./panels/film";
import { Fits } from "./panels/fits";
import { Gap } from "./panels/gap";
import { HostBar } from "./panels/hostbar";
import { Head } from "./panels/head";
import { Help } from "./panels/help";
import { Notes } from "./panels/notes";
import { Notices } from "./panels/notices";
import { Objects } from "./panels/objects";
import { Provenance } from "./panels/provenance";
import { Scene } from "./panels/scene";
import { Series } from "./panels/series";
import { Timeline } from "./panels/timeline";
import { Transport } from "./panels/transport";
import "./tabs.css";

/** Panels below the timeline, in reading order, and when each has something to show. */
const PANELS: { name: Tab; title: string; panel: ComponentType; has: (doc: ViewDocument) => boolean }[] = [
  { name: "series", title: "Series", panel: Series, has: (d) => d.rollouts.length + d.tracks.length > 0 },
  { name: "comparison", title: "Comparison", panel: Comparison, has: (d) => d.comparisons.length > 0 },
  { name: "gap", title: "Gap", panel: Gap, has: (d) => d.gaps.length > 0 },
  { name: "fits", title: "Fits", panel: Fits, has: (d) => d.fits.length > 0 },
  { name: "provenance", title: "Provenance", panel: Provenance, has: (d) => d.provenance.nodes.length > 0 },
  { name: "evidence", title: "Evidence", panel: Evidence, has: () => true },
];

export function Shell() {
  const doc = document.value;
  if (failure.value && !doc)
    return (
      <p class="empty" role="alert">
        {failure.value}
      </p>
    );
  if (!doc)
    return (
      <p class="empty" aria-busy="true">
        {progress.value}
      </p>
    );
  const film = doc.film !== null || doc.observed !== null;
  const scene = doc.worlds.length + doc.tracks.length > 0;
  return (
    <main class="shell">
      <div class="top">
        <HostBar />
        <Head />
        <Notices />
      </div>
      {doc.worlds.length > 0 && <Choosers />}
      <div class="stage" data-cells={Number(film) + Number(scene)} data-layout={layout.value}>
        {film && (
          <div class="cell">
            <Film />
          </div>
        )}
        {scene && (
          <div class="cell">
            <Scene />
          </div>
        )}
        {!film && !scene && <p class="panel empty">This case has neither a video nor a world yet.</p>}
      </div>
      {duration.value > 0 && (
        <div class="time panel">
          <Transport />
          <Timeline />
          <Notes />
        </div>
      )}
      {doc.worlds.length > 0 && (
        <aside class="side" aria-label="objects">
          <Objects />
        </aside>
      )}
      <Below doc={doc} />
      <Help />
    </main>
  );
}

function Below({ doc }: { doc: ViewDocument }) {
  const present = PANELS.filter((p) => p.has(doc));
  const current = present.find((p) => p.name === tab.value) ?? present[0]!;
  const strip = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const chosen = strip.current!.querySelector<HTMLElement>('[aria-selected="true"]')!;
    const room = strip.current!.clientWidth - chosen.offsetWidth;
    strip.current!.scrollLeft = chosen.offsetLeft - strip.current!.offsetLeft - room / 2; // in sight on a phone
  }, [current.name]);
  const turn = (event: KeyboardEvent) => {
    const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
    if (step === 0 || event.shiftKey) return; // with Shift they step through events
    event.stopPropagation();
    event.preventDefault();
    tab.value = present[(present.indexOf(current) + step + present.length) % present.length]!.name;
    (event.currentTarget as HTMLElement).querySelector<HTMLElement>(`#tab-${tab.value}`)?.focus();
  };
  return (
    <section class="below panel" aria-label="details">
      <div class="tabs" role="tablist" aria-label="details" ref={strip} onKeyDown={turn}>
        {present.map(({ name, title }) => (
          <button
            key={name}
            id={`tab-${name}`}
            role="tab"
            aria-selected={name === current.name}
            aria-controls="details"
            tabIndex={name === current.name ? 0 : -1}
            onClick={() => (tab.value = name)}
          >
            {title}
          </button>
        ))}
      </div>
      <div id="details" role="tabpanel" aria-labelledby={`tab-${current.name}`}>
        <current.panel key={current.name} />
      </div>
    </section>
  );
}
