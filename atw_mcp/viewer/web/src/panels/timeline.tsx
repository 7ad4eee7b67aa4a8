// Events of the rollouts shown as marks over time; clicking one goes to its moment.
import { useEffect, useRef } from "preact/hooks";
import { signal, untracked, useSignalEffect } from "@preact/signals";
import { eventLabel, groundShown, hiddenKinds, KINDS, lanes, visibleLanes, type Kind, type Lane } from "../events";
import { digits } from "../format";
import { Icon } from "../icons";
import { document, duration, filmEnd, nearestFrame, seek, time, track } from "../state";
import { Shape } from "./mark_shapes";
import { notes } from "./notes";
import { LaneMarks, LANE, tip } from "./timeline_lane";
import { heldOut, heldOutRuns, MARGIN, moment, place, reveal, showInterval, ticks, view, width, zoom, zoomed } from "./timeline_view";
import "./timeline.css";

const AXIS = 22; // px, its height
/** A drag along the axis of fewer pixels is a click. */
const CLICK = 4;

/** The interval being marked on the axis [px]. */
const dragged = signal<[number, number] | null>(null);

export function Timeline() {
  const plot = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const observer = new ResizeObserver(([entry]) => (width.value = Math.max(entry!.contentRect.width, 100)));
    observer.observe(plot.current!);
    return () => observer.disconnect();
  }, []);
  useSignalEffect(() => {
    const t = time.value;
    untracked(() => reveal(t)); // only when the clock moves: one may look elsewhere meanwhile
  });
  return (
    <section class="timeline" aria-label="timeline">
      <div class="plot" ref={plot}>
        <Scrubber />
        <div class="plot">
          <Lanes />
          <Cursor />
        </div>
        <Tip />
      </div>
      <Legend />
    </section>
  );
}

/** The whole of time, whatever part the lanes show. */
function Scrubber() {
  const span = duration.value || 1;
  const share = (t: number) => `${(100 * t) / span}%`;
  const go = (event: PointerEvent) => {
    const bar = event.currentTarget as HTMLElement;
    if (event.type === "pointerdown") bar.setPointerCapture(event.pointerId);
    else if (!bar.hasPointerCapture(event.pointerId)) return;
    const box = bar.getBoundingClientRect();
    seek(((event.clientX - box.left - MARGIN) / (box.width - 2 * MARGIN)) * span);
  };
  const [from, to] = view.value;
  return (
    <div
      class="scrubber"
      role="slider"
      tabIndex={0}
      aria-label="time"
      aria-valuemin={0}
      aria-valuemax={duration.value}
      aria-valuenow={Number(time.value.toFixed(4))}
      aria-valuetext={`${time.value.toFixed(3)} seconds, frame ${nearestFrame.value}`}
      onPointerDown={go}
      onPointerMove={go}
    >
      <div class="track">
        {zoomed.value && <div class="part" style={{ left: share(from), width: share(to - from) }} />}
        {notes.value.map((note) => (
          <i key={note.id} class="flag" title={note.text} style={{ left: share(note.time) }} />
        ))}
        <div class="thumb" style={{ left: share(time.value) }} />
      </div>
    </div>
  );
}

function Lanes() {
  const shown = visibleLanes.value;
  const height = Math.max(shown.length, 1) * LANE + AXIS;
  const x = (event: MouseEvent) => event.clientX - (event.currentTarget as Element).getBoundingClientRect().left;
  const onAxis = (event: MouseEvent) =>
    event.clientY - (event.currentTarget as Element).getBoundingClientRect().top > height - AXIS;
  const down = (event: PointerEvent) => {
    if (event.button !== 0 || (event.target as Element).closest(".mark")) return;
    (event.currentTarget as Element).setPointerCapture(event.pointerId);
    if (onAxis(event)) dragged.value = [x(event), x(event)];
    else seek(moment(x(event)));
  };
  const move = (event: PointerEvent) => {
    if (!(event.currentTarget as Element).hasPointerCapture(event.pointerId)) return;
    if (dragged.value) dragged.value = [dragged.value[0], x(event)];
    else seek(moment(x(event)));
  };
  const up = () => {
    if (!dragged.value) return;
    const [a, b] = dragged.value;
    dragged.value = null;
    if (Math.abs(b - a) < CLICK) seek(moment(b));
    else showInterval(moment(a), moment(b));
  };
  const wheel = (event: WheelEvent) => {
    if (!event.ctrlKey && !onAxis(event)) return; // the page scrolls
    event.preventDefault();
    zoom(Math.exp(-event.deltaY / 300), moment(x(event)));
  };
  return (
    <svg
      class="lanes"
      height={height}
      role="group"
      aria-label="events"
      onPointerDown={down}
      onPointerMove={move}
      onPointerUp={up}
      onPointerCancel={() => (dragged.value = null)}
      onDblClick={() => (zoomed.value = null)}
      onWheel={wheel}
    >
      <defs>
        <pattern id="held-out-hatch" width="6" height="6" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">
          <rect width="3" height="6" fill="var(--held-out)" />
        </pattern>
      </defs>
      <Extents height={height - AXIS} />
      {shown.map((lane, k) => (
        <g key={lane.rollout.id} class={lane.role} transform={`translate(0 ${k * LANE})`} data-lane={lane.rollout.id}>
          {k > 0 && <line class="rule" x2={width.value} />}
          <LaneMarks lane={lane} />
        </g>
      ))}
      <Axis top={height - AXIS} />
    </svg>
  );
}

/** The video's extent, and what was held out of fits. */
function Extents({ height }: { height: number }) {
  const film = filmEnd.value;
  const [from, to] = view.value;
  const inside = (t: number) => place(Math.min(Math.max(t, from), to));
  return (
    <>
      {film !== null && film > from && (
        <rect
          class="film-extent"
          x={inside(0)}
          width={inside(film) - inside(0)}
          height={height}
          data-from={0}
          data-to={film}
        />
      )}
      {heldOut.value.map(([a, b]) => (
        <rect
          key={a}
          class="held-out"
          x={inside(a)}
          width={Math.max(inside(b) - inside(a), 0)}
          height={height}
          data-from={a}
          data-to={b}
        />
      ))}
    </>
  );
}

function Axis({ top }: { top: number }) {
  const { at, decimals } = ticks();
  return (
    <g class="axis" transform={`translate(0 ${top})`}>
      <rect width={width.value} height={AXIS} rx={3} />
      {at.map((t) => {
        const x = place(t);
        const anchor = x < 24 ? "start" : x > width.value - 24 ? "end" : "middle";
        return (
          <g key={t} transform={`translate(${x} 0)`}>
            <line class="rule" y1={-3} y2={3} />
            <text x={anchor === "start" ? 4 : anchor === "end" ? 6 : 0} y={15} text-anchor={anchor}>
              {t.toFixed(decimals)} s
            </text>
          </g>
        );
      })}
      {dragged.value && (
        <rect
          class="selection"
          x={Math.min(...dragged.value)}
          width={Math.abs(dragged.value[1] - dragged.value[0])}
          height={AXIS}
        />
      )}
    </g>
  );
}

function Cursor() {
  const line = useRef<HTMLDivElement>(null);
  useSignalEffect(() => {
    if (!line.current) return;
    const x = place(time.value);
    line.current.style.transform = `translateX(${x}px)`;
    line.current.hidden = x < 0 || x > width.value;
  });
  return <div class="cursor" ref={line} />;
}

function Tip() {
  const shown = tip.value;
  if (!shown) return null;
  const most = 8; // lines: a bundle may hold hundreds of events
  const side = shown.x < width.value / 2 ? { left: `${shown.x}px` } : { right: `${width.value - shown.x}px` };
  return (
    <div class="tip" role="tooltip" style={{ ...side, bottom: `${shown.above}px` }}>
      {shown.marks.slice(0, most).map((mark, k) => (
        <p key={k}>{eventLabel(mark)}</p>
      ))}
      {shown.marks.length > most && <p class="soft">and {shown.marks.length - most} more: zoom in to see each</p>}
    </div>
  );
}

/** Kinds of events with their shapes and counts; each can be hidden. */
function Legend() {
  const all = lanes.value.flatMap((lane: Lane) => lane.marks);
  const flip = (kind: Kind) => {
    const next = new Set(hiddenKinds.value);
    if (!next.delete(kind)) next.add(kind);
    hiddenKinds.value = next;
  };
  const ground = all.filter((m) => m.ground).length;
  const run = track.value?.run ?? "";
  const others = heldOutRuns.value.filter((name) => name !== "" && name !== run);
  const middle = () => Math.min(Math.max(time.value, view.value[0]), view.value[1]);
  return (
    <div class="bar legend" role="group" aria-label="events shown">
      {KINDS.map(({ kind, title }) => {
        const count = all.filter((m) => m.event.kind === kind).length;
        return (
          count > 0 && (
            <button
              key={kind}
              aria-pressed={!hiddenKinds.value.has(kind)}
              title={`Show or hide: ${title}`}
              data-kind={kind}
              data-count={count}
              onClick={() => flip(kind)}
            >
              <svg class="key" viewBox="-7 -7 14 14" aria-hidden="true">
                <Shape kind={kind} />
              </svg>
              {title} {count}
            </button>
          )
        );
      })}
      {ground > 0 && (
        <button
          aria-pressed={groundShown.value}
          title="Show or hide contacts with the ground"
          onClick={() => (groundShown.value = !groundShown.value)}
        >
          with the ground {ground}
        </button>
      )}
      {all.length === 0 && <span class="soft small">no events</span>}
      {filmEnd.value !== null && <span class="chip">shaded: {document.value!.case.kind === "video" ? "video" : "measured"}</span>}
      {heldOut.value.length > 0 && <span class="chip">hatched: {run && `run ${run} `}held out of fits</span>}
      {others.length > 0 && (
        <span class="chip" title="Choose the run in Series">
          held out of fits{heldOut.value.length > 0 ? " as well" : ""}: {others.length > 1 ? "runs" : "run"} {others.join(", ")}
        </span>
      )}
      <span class="push" />
      {zoomed.value && (
        <span class="soft small number">
          {digits(view.value[0])} to {digits(view.value[1])} s
        </span>
      )}
      <button class="quiet icon" aria-label="Zoom out" title="Zoom out" onClick={() => zoom(1 / 2, middle())}>
        <Icon name="minus" />
      </button>
      <button class="quiet icon" aria-label="Zoom in" title="Zoom in at the cursor" onClick={() => zoom(2, middle())}>
        <Icon name="plus" />
      </button>
      <button
        class="quiet icon"
        aria-label="All of time"
        title="All of time"
        disabled={!zoomed.value}
        onClick={() => (zoomed.value = null)}
      >
        <Icon name="whole" />
      </button>
    </div>
  );
}
