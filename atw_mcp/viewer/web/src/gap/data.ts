// Residuals of a gap step as numbers, and the plane that they are drawn in.
import type { GapSeries, GapView } from "../document";
import type { Opened } from "../unpack";

export const AXES = ["x", "y", "z"] as const;
/** Tokens of the colours of the axes, readable on light and dark, and distinct to colour-blind people. */
export const AXIS_TOKENS = ["base", "branch", "new"] as const;
/** Of the largest extent; what rises less moves on a plane. As atw_mcp/gap/pictures.py. */
const FLAT = 0.1;

export const KINDS = { position: "positions", rotation: "rotations", spin: "spins" } as const;
export type Kind = keyof typeof KINDS;

/** One kind of measurement of one object in one run: numbers of T instants, three components each. */
export interface Residuals {
  run: string;
  object: string;
  kind: Kind;
  /** Its times are those of the film and the rollouts. */
  linked: boolean;
  times: Float32Array;
  observed: Float32Array;
  before: Float32Array;
  after: Float32Array | null;
  /** Root mean square of the measured components (T,), in standard deviations. */
  sizeBefore: Float32Array;
  sizeAfter: Float32Array | null;
  /** Components that were measured. */
  axes: number[];
  rms: number;
  rmsAfter: number | null;
  heldOut: [number, number][];
}

/** The residuals of a step, the largest first. */
export function residualsOf(view: GapView, opened: Opened): Residuals[] {
  return view.series.map((s) => read(s, opened)).sort((a, b) => b.rms - a.rms);
}

function read(series: GapSeries, opened: Opened): Residuals {
  const before = opened.floats(series.residual_before);
  const after = series.residual_after && opened.floats(series.residual_after);
  const sizeBefore = sizes(before);
  const sizeAfter = after && sizes(after);
  return {
    run: series.run,
    object: series.object,
    kind: series.kind ?? "position",
    linked: series.run === "",
    times: opened.floats(series.times),
    observed: opened.floats(series.observed),
    before,
    after,
    sizeBefore,
    sizeAfter,
    axes: [0, 1, 2].filter((axis) => before.some((v, i) => i % 3 === axis && Number.isFinite(v))),
    rms: rootMeanSquare(before),
    rmsAfter: after && rootMeanSquare(after),
    heldOut: series.held_out.map(([from, to]) => [from ?? -Infinity, to ?? Infinity]),
  };
}

function sizes(residual: Float32Array): Float32Array {
  const found = new Float32Array(residual.length / 3);
  for (let i = 0; i < found.length; i++) found[i] = rootMeanSquare(residual.subarray(3 * i, 3 * i + 3));
  return found;
}

function rootMeanSquare(values: Float32Array): number {
  let total = 0;
  let count = 0;
  for (const v of values)
    if (Number.isFinite(v)) {
      total += v * v;
      count++;
    }
  return count ? Math.sqrt(total / count) : NaN;
}

/** "red puck", "red puck, run r1" or "red puck rotation". */
export function nameOf(item: { object: string; run: string; kind?: Kind }): string {
  const kind = item.kind && item.kind !== "position" ? ` ${item.kind}` : "";
  const object = item.object.replaceAll("_", " ") + kind;
  return item.run ? `${object}, run ${item.run}` : object;
}

export function isHeldOut(item: Residuals, time: number): boolean {
  return item.heldOut.some(([from, to]) => time >= from - 1e-6 && time <= to + 1e-6);
}

/** Index of the instant nearest to a time. */
export function nearest(times: Float32Array, time: number): number {
  let low = 0;
  let high = times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle]! <= time) low = middle;
    else high = middle;
  }
  return Math.abs(times[high]! - time) < Math.abs(times[low]! - time) ? high : low;
}

/** Two directions to draw in; across null: time instead. */
export interface Plane {
  across: [number, number, number] | null;
  up: [number, number, number];
  acrossLabel: string;
  upLabel: string;
}

/** Height over the main horizontal direction where things rise and fall, else y over x; one component over time. */
export function planeOf(items: Residuals[]): Plane {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (const { observed } of items)
    for (let i = 0; i < observed.length; i++) {
      const v = observed[i]!;
      if (!Number.isFinite(v)) continue;
      low[i % 3] = Math.min(low[i % 3]!, v);
      high[i % 3] = Math.max(high[i % 3]!, v);
    }
  const measured = [0, 1, 2].filter((a) => high[a]! >= low[a]!);
  const along = (a: number): [number, number, number] => [Number(a === 0), Number(a === 1), Number(a === 2)];
  if (measured.length < 2) {
    const only = measured[0] ?? 0;
    return { across: null, up: along(only), acrossLabel: "time [s]", upLabel: `${AXES[only]} [m]` };
  }
  const extent = (a: number) => high[a]! - low[a]!;
  if (measured.length === 3 && extent(2) >= FLAT * Math.max(extent(0), extent(1), extent(2))) {
    const angle = heading(items);
    return {
      across: [Math.cos(angle), Math.sin(angle), 0],
      up: along(2),
      acrossLabel: `horizontal, ${Math.round((angle * 180) / Math.PI)}° from x [m]`.replace("-", "−"),
      upLabel: "z [m]",
    };
  }
  const [a, b] = measured as [number, number];
  return { across: along(a), up: along(b), acrossLabel: `${AXES[a]} [m]`, upLabel: `${AXES[b]} [m]` };
}

/** Angle from x of the horizontal direction that places extend along most, -45° to 135°. */
function heading(items: Residuals[]): number {
  let n = 0;
  const sum = [0, 0, 0, 0, 0];
  for (const { observed } of items)
    for (let i = 0; i + 2 < observed.length; i += 3) {
      const x = observed[i]!;
      const y = observed[i + 1]!;
      if (!Number.isFinite(x + y)) continue;
      n++;
      [x, y, x * x, x * y, y * y].forEach((v, k) => (sum[k] = sum[k]! + v));
    }
  const [x, y, xx, xy, yy] = sum as [number, number, number, number, number];
  const angle = 0.5 * Math.atan2(2 * (xy - (x * y) / n), xx - (x * x) / n - (yy - (y * y) / n));
  return angle < -Math.PI / 4 ? angle + Math.PI : angle;
}

/** Where a place is in a plane; across and up. */
export function projected(plane: Plane, p: ArrayLike<number>, at: number, time: number): [number, number] {
  const along = (d: [number, number, number]) => {
    let total = 0;
    for (let k = 0; k < 3; k++) if (d[k] !== 0) total += d[k]! * p[at + k]!;
    return total;
  };
  return [plane.across ? along(plane.across) : time, along(plane.up)];
}

/** Some three to seven round numbers from low to high. */
export function ticks(low: number, high: number, most = 6): number[] {
  const span = high - low;
  if (!(span > 0)) return [low];
  const rough = span / most;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough * 0.999)!;
  const found: number[] = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * span; k++) found.push(k * step);
  return found;
}

/** Tick labels with as many decimals as distinguish them. */
export function tickText(value: number, all: number[]): string {
  const step = all.length > 1 ? Math.abs(all[1]! - all[0]!) : 1;
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return value.toFixed(Math.min(decimals, 9)).replace(/^-(0(\.0*)?)$/, "$1").replace("-", "−");
}
