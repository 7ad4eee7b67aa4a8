// A plot as SVG: one quantity against another on the page, and any plot of series as a file.
import type { ComponentChildren } from "preact";
import { legible } from "../legible";
import { token } from "../theme";
import { tickText } from "./series_plot";

/** A point, and the standard deviation of each coordinate where it was measured. */
export interface Place {
  x: number;
  y: number;
  sx?: number;
  sy?: number;
}

export interface Trace {
  label: string;
  color: string;
  dashed?: boolean;
  dots?: boolean;
  /** In order of time; a place that is NaN leaves a gap. */
  places: Place[];
  /** Where the object is now. */
  now?: Place;
}

export interface Area {
  color: string;
  x: ArrayLike<number>;
  low: ArrayLike<number>;
  high: ArrayLike<number>;
}

export interface ChartOf {
  width: number;
  height: number;
  x: string;
  y: string;
  traces: Trace[];
  areas?: Area[];
  /** Both axes have one scale. */
  equal?: boolean;
  /** The part of the x axis shown; default: all. */
  range?: [number, number];
}

const LEFT = 62;
const [RIGHT, TOP, BOTTOM] = [12, 10, 44];
const FONT = 'system-ui, "Segoe UI", Roboto, sans-serif';

export interface Axes {
  x: (value: number) => number;
  y: (value: number) => number;
}

/** Where values lie in the plot [px]. */
export function axesOf({ width, height, traces, areas = [], equal, range }: ChartOf): Axes & { limits: number[] } {
  const inside = (x: number) => !range || (x >= range[0] && x <= range[1]);
  const all = traces.flatMap((t) => t.places).filter((p) => Number.isFinite(p.x + p.y) && inside(p.x));
  const ys = all.flatMap((p) => [p.y - (p.sy || 0), p.y + (p.sy || 0)]);
  for (const { x, low, high } of areas)
    for (let k = 0; k < x.length; k++) if (inside(x[k]!) && Number.isFinite(low[k])) ys.push(low[k]!, high[k]!);
  let [x0, x1] = range ?? padded(all.flatMap((p) => [p.x - (p.sx || 0), p.x + (p.sx || 0)]));
  let [y0, y1] = padded(ys);
  const [w, h] = [width - LEFT - RIGHT, height - TOP - BOTTOM];
  if (equal) {
    const unit = Math.max((x1 - x0) / w, (y1 - y0) / h);
    [x0, x1] = [(x0 + x1 - unit * w) / 2, (x0 + x1 + unit * w) / 2];
    [y0, y1] = [(y0 + y1 - unit * h) / 2, (y0 + y1 + unit * h) / 2];
  }
  return {
    x: (value) => LEFT + (w * (value - x0)) / (x1 - x0),
    y: (value) => TOP + (h * (y1 - value)) / (y1 - y0),
    limits: [x0, x1, y0, y1],
  };
}

function padded(values: number[]): [number, number] {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) [low, high] = [Math.min(low, value), Math.max(high, value)];
  if (!(low <= high)) return [0, 1];
  const pad = high > low ? 0.06 * (high - low) : Math.max(0.1 * Math.abs(high), 1e-3);
  return [low - pad, high + pad];
}

export function Chart(of: ChartOf & { children?: ComponentChildren }) {
  const { width, height, traces, areas = [] } = of;
  const at = axesOf(of);
  const [x0, x1, y0, y1] = at.limits as [number, number, number, number];
  const [ink, rule] = [token("ink-soft"), token("line")];
  const [across, up] = [ticks(x0, x1, width / 90), ticks(y0, y1, height / 50)];
  return (
    <svg
      xmlns="http://www.w3.org/2000/svg"
      width={width}
      height={height}
      viewBox={`0 0 ${width} ${height}`}
      font-family={FONT}
      font-size="12"
      fill={ink}
    >
      <rect width={width} height={height} fill={token("surface")} />
      {across.map((t) => (
        <g key={`x${t}`}>
          <line x1={at.x(t)} x2={at.x(t)} y1={TOP} y2={height - BOTTOM} stroke={rule} />
          <text x={at.x(t)} y={height - BOTTOM + 16} text-anchor="middle">
            {tickText(t, across)}
          </text>
        </g>
      ))}
      {up.map((t) => (
        <g key={`y${t}`}>
          <line x1={LEFT} x2={width - RIGHT} y1={at.y(t)} y2={at.y(t)} stroke={rule} />
          <text x={LEFT - 6} y={at.y(t) + 4} text-anchor="end">
            {tickText(t, up)}
          </text>
        </g>
      ))}
      <text x={(LEFT + width - RIGHT) / 2} y={height - 8} text-anchor="middle">
        {of.x}
      </text>
      <text transform={`translate(14 ${(TOP + height - BOTTOM) / 2}) rotate(-90)`} text-anchor="middle">
        {of.y}
      </text>
      <svg x={LEFT} y={TOP} width={width - LEFT - RIGHT} height={height - TOP - BOTTOM} overflow="hidden">
        <g transform={`translate(${-LEFT} ${-TOP})`}>
          {areas.map((area, k) => (
            <path key={k} d={around(area, at)} fill={legible(area.color)} fill-opacity="0.2" />
          ))}
          {traces.map((trace, k) => (
            <Drawn key={k} trace={trace} at={at} />
          ))}
          {of.children}
        </g>
      </svg>
    </svg>
  );
}

function Drawn({ trace, at }: { trace: Trace; at: Axes }) {
  const color = legible(trace.color);
  const last = trace.places.findLast((p) => Number.isFinite(p.x + p.y));
  if (trace.dots)
    return (
      <g stroke={color} fill={color}>
        {trace.places.filter((p) => Number.isFinite(p.x + p.y)).map((p, k) => (
          <g key={k}>
            {p.sy ? <line x1={at.x(p.x)} x2={at.x(p.x)} y1={at.y(p.y - p.sy)} y2={at.y(p.y + p.sy)} /> : null}
            {p.sx ? <line y1={at.y(p.y)} y2={at.y(p.y)} x1={at.x(p.x - p.sx)} x2={at.x(p.x + p.sx)} /> : null}
            <circle cx={at.x(p.x)} cy={at.y(p.y)} r="1.8" />
          </g>
        ))}
      </g>
    );
  return (
    <g>
      <path d={along(trace.places, at)} fill="none" stroke={color} stroke-width="2" stroke-dasharray={trace.dashed ? "7 5" : undefined} />
      {trace.now && Number.isFinite(trace.now.x + trace.now.y) && (
        <circle cx={at.x(trace.now.x)} cy={at.y(trace.now.y)} r="5" fill={color} stroke={token("surface")} stroke-width="1.5" />
      )}
      {last && (
        <text x={at.x(last.x) - 4} y={Math.max(at.y(last.y) - 8, TOP + 12)} text-anchor="end" font-weight="600" fill={color}>
          {trace.label}
        </text>
      )}
    </g>
  );
}

function along(places: Place[], at: Axes): string {
  let d = "";
  let pen = false;
  for (const { x, y } of places) {
    const here = Number.isFinite(x + y);
    if (here) d += `${pen ? "L" : "M"}${at.x(x).toFixed(1)} ${at.y(y).toFixed(1)}`;
    pen = here;
  }
  return d;
}

function around({ x, low, high }: Area, at: Axes): string {
  const kept = Array.from(x, (_, k) => k).filter((k) => Number.isFinite(low[k]! + high[k]!));
  const edge = (values: ArrayLike<number>, order: number[]) =>
    order.map((k) => `${at.x(x[k]!).toFixed(1)} ${at.y(values[k]!).toFixed(1)}`).join("L");
  return kept.length ? `M${edge(low, kept)}L${edge(high, kept.toReversed())}Z` : "";
}

/** Round values, about `count` of them. */
function ticks(from: number, to: number, count: number): number[] {
  const least = (to - from) / Math.max(count, 2);
  const power = 10 ** Math.floor(Math.log10(least));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= least * 0.999)!;
  const found: number[] = [];
  for (let k = Math.ceil(from / step - 1e-9); k * step <= to + 1e-9 * step; k++) found.push(k * step);
  return found;
}
