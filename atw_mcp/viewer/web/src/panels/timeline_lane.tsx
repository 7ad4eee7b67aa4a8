// The marks of one rollout on the timeline.
import { signal } from "@preact/signals";
import { eventLabel, type Lane, type Mark } from "../events";
import { digits, words } from "../format";
import { object, seek } from "../state";
import { Shape } from "./mark_shapes";
import { bundles, width, type Bundle } from "./timeline_view";

export const LANE = 52; // px: a title, a line of labels, the marks
const MIDDLE = 40; // px from the lane's top to the marks' centres
/** Width of a character of a label [px], with a little to spare. */
const CHARACTER = 6;

/** The marks under the pointer: where along the plot and how far above its bottom [px]. */
export const tip = signal<{ x: number; above: number; marks: Mark[] } | null>(null);

/** Rings about events that are gone (dashed, a cross) and new (a plus). */
const CHANGES = [
  { change: "gone", sign: "M8-12l6 6M14-12l-6 6" },
  { change: "new", sign: "M11-13v8M7-9h8" },
] as const;

export function LaneMarks({ lane }: { lane: Lane }) {
  const shown = bundles(lane.marks);
  const strongest = Math.max(...lane.marks.map((m) => m.event.impulse ?? 0), 1e-12);
  const title = `${lane.rollout.label}: ${lane.marks.length} event${lane.marks.length === 1 ? "" : "s"}`;
  return (
    <>
      <text class="lane-title" x={10} y={13}>
        {title}
      </text>
      {shown.map((bundle, k) => (
        <BundleMark
          key={`${bundle.marks[0]!.event.kind} ${bundle.marks[0]!.event.time} ${k}`}
          bundle={bundle}
          strongest={strongest}
          room={roomFor(shown, k)}
        />
      ))}
    </>
  );
}

/** Half the width that a label about a bundle may take without touching its neighbours [px]. */
function roomFor(shown: Bundle[], k: number): number {
  const x = shown[k]!.x;
  const left = k > 0 ? (x - shown[k - 1]!.x) / 2 : x;
  const right = k + 1 < shown.length ? (shown[k + 1]!.x - x) / 2 : width.value - x;
  return Math.min(left, right);
}

function BundleMark({ bundle, strongest, room }: { bundle: Bundle; strongest: number; room: number }) {
  const { x, marks } = bundle;
  const [first] = marks as [Mark];
  const chosen = object.value;
  const dim = marks.every((m) => m.ground || (chosen !== null && !m.event.participants.includes(chosen)));
  const label = marks.length === 1 ? labelFor(first, room) : "";
  const show = (event: Event) => {
    const plot = (event.currentTarget as Element).closest("svg")!.getBoundingClientRect();
    const own = (event.currentTarget as Element).getBoundingClientRect();
    tip.value = { x, above: plot.bottom - own.top + 4, marks };
  };
  const hide = () => (tip.value = null);
  return (
    <g
      class={dim ? "mark dim" : "mark"}
      transform={`translate(${x} ${MIDDLE})`}
      role="button"
      tabIndex={-1}
      aria-label={marks.length === 1 ? eventLabel(first) : `${marks.length} events from ${eventLabel(first)}`}
      data-kind={marks.length === 1 ? first.event.kind : "several"}
      data-time={first.event.time}
      data-count={marks.length}
      data-change={marks.find((m) => m.change)?.change ?? ""}
      onClick={() => seek(first.event.time)}
      onPointerEnter={show}
      onPointerLeave={hide}
      onFocus={show}
      onBlur={hide}
    >
      <rect class="target" x={-8} y={-11} width={16} height={22} rx={3} />
      {marks.length === 1 ? (
        <Shape kind={first.event.kind} size={first.event.impulse === null ? 1 : sizeOf(first.event.impulse / strongest)} />
      ) : (
        <>
          <rect class="pill" x={-8} y={-7} width={16} height={14} rx={7} />
          <text class="count" y={3.5}>
            {marks.length < 100 ? marks.length : "…"}
          </text>
        </>
      )}
      {CHANGES.filter(({ change }) => marks.some((m) => m.change === change)).map(({ change, sign }) => (
        <g key={change} class={`change ${change}`}>
          <circle r={10} />
          <path d={sign} />
        </g>
      ))}
      {label && (
        <text class="label" y={-14}>
          {label}
        </text>
      )}
    </g>
  );
}

/** Radius of a contact's mark relative to the largest, by its impulse: area grows with it. */
function sizeOf(share: number): number {
  return 0.6 + 0.6 * Math.sqrt(share);
}

/** The longest label that there is room for. */
function labelFor({ event, ground }: Mark, room: number): string {
  const impulse = event.impulse === null ? "" : `${digits(event.impulse, 3)} N s`;
  const who = ground ? "" : event.participants.map(words).join(" × ");
  const choices = [[who, impulse].filter(Boolean).join(" "), who, impulse];
  return choices.find((text) => text && (text.length * CHARACTER) / 2 <= room) ?? "";
}
