// A ruler over a picture: two points give a distance, a third the angle at the second.
import { useSignal, type Signal } from "@preact/signals";
import { useRef } from "preact/hooks";
import { digits, quantity } from "./format";
import "./ruler.css";

type Place = readonly number[];

interface Mark {
  x: number;
  y: number;
  /** In the plane of motion [m], or in the picture [px]. */
  at: Place;
}

/** locate: metres of a place [px of the screen from the corner], or null where the picture has no scale there. */
export function Ruler({ locate, pixels = 1 }: { locate: (x: number, y: number) => Place | null; pixels?: number }) {
  const marks = useSignal<Mark[]>([]);
  const dragged = useRef<number | null>(null);
  const scaled = useSignal(true);
  const markOf = (event: PointerEvent): Mark => {
    const box = (event.currentTarget as Element).getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    const metres = locate(x, y);
    scaled.value = metres !== null;
    return { x, y, at: metres ?? [x * pixels, y * pixels] };
  };
  const down = (event: PointerEvent) => {
    event.stopPropagation();
    const mark = markOf(event);
    const near = marks.value.findIndex((m) => Math.hypot(m.x - mark.x, m.y - mark.y) < 12);
    (event.currentTarget as Element).setPointerCapture(event.pointerId);
    const kept = near >= 0 || marks.value.length < 3 ? marks.value : [];
    dragged.current = near >= 0 ? near : kept.length;
    if (near < 0) marks.value = [...kept, mark];
  };
  const move = (event: PointerEvent) => {
    if (dragged.current !== null) marks.value = marks.value.map((m, k) => (k === dragged.current ? markOf(event) : m));
  };
  const all = marks.value;
  const length = (a: Mark, b: Mark) => Math.hypot(...a.at.map((v, k) => v - b.at[k]!));
  const unit = (metres: number) => (scaled.value ? quantity(metres, "m") : `${digits(metres)} px`);
  const angle = all.length === 3 ? angleAt(all[1]!.at, all[0]!.at, all[2]!.at) : null;
  return (
    <svg
      class="ruler"
      role="application"
      aria-label="ruler: click two points for a distance, a third for an angle"
      data-length={all.length > 1 ? length(all[0]!, all[1]!) : undefined}
      data-angle={angle ?? undefined}
      data-unit={scaled.value ? "m" : "px"}
      onPointerDown={down}
      onPointerMove={move}
      onPointerUp={() => (dragged.current = null)}
      onClick={(event) => event.stopPropagation()}
    >
      {all.slice(1).map((b, k) => {
        const a = all[k]!;
        return (
          <g key={k}>
            <line x1={a.x} y1={a.y} x2={b.x} y2={b.y} />
            <text x={(a.x + b.x) / 2} y={(a.y + b.y) / 2 - 6}>
              {unit(length(a, b))}
            </text>
          </g>
        );
      })}
      {all.map((m, k) => (
        <circle key={k} cx={m.x} cy={m.y} r="5" />
      ))}
      {angle !== null && (
        <text x={all[1]!.x} y={all[1]!.y + 22}>
          {digits(angle, 3)}°
        </text>
      )}
      {all.length === 0 && (
        <text x="50%" y="24">
          click two points, a third for an angle
        </text>
      )}
    </svg>
  );
}

export function RulerButton({ on }: { on: Signal<boolean> }) {
  return (
    <button
      class="small"
      aria-pressed={on.value}
      title="Measure a distance or an angle in the plane of motion"
      onClick={() => (on.value = !on.value)}
    >
      Ruler
    </button>
  );
}

/** Angle at b between a and c [deg]. */
function angleAt(b: Place, a: Place, c: Place): number {
  const [u, v] = [a.map((x, k) => x - b[k]!), c.map((x, k) => x - b[k]!)];
  const dot = u.reduce((sum, x, k) => sum + x * v[k]!, 0);
  return (Math.acos(Math.min(1, Math.max(-1, dot / (Math.hypot(...u) * Math.hypot(...v))))) * 180) / Math.PI;
}
