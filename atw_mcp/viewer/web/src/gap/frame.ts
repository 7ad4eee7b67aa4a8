// A frame with axes on a canvas: places to pixels, with equal scales where both axes are lengths.
import { tickText, ticks } from "./data";

export interface Limits {
  low: [number, number];
  high: [number, number];
  /** Both axes are lengths, drawn to one scale. */
  equal: boolean;
}

export interface Frame {
  left: number;
  top: number;
  width: number;
  height: number;
  x: (value: number) => number;
  y: (value: number) => number;
}

export function limitsOf(points: Iterable<[number, number]>, equal: boolean): Limits {
  const low: [number, number] = [Infinity, Infinity];
  const high: [number, number] = [-Infinity, -Infinity];
  for (const p of points)
    for (const k of [0, 1] as const)
      if (Number.isFinite(p[k])) {
        low[k] = Math.min(low[k], p[k]);
        high[k] = Math.max(high[k], p[k]);
      }
  for (const k of [0, 1] as const) {
    if (!(high[k] >= low[k])) [low[k], high[k]] = [0, 1];
    const other = k === 0 ? 1 : 0;
    const least = equal ? 0.02 * Math.max(high[other] - low[other], 1e-9) : 1e-9;
    const margin = Math.max(0.05 * (high[k] - low[k]), least);
    low[k] -= margin;
    high[k] += margin;
  }
  return { low, high, equal };
}

/** Height that a frame of a width needs to show limits to scale. */
export function heightFor(limits: Limits, width: number): number {
  if (!limits.equal) return Math.round(0.6 * width);
  const shape = (limits.high[1] - limits.low[1]) / (limits.high[0] - limits.low[0]);
  return Math.round(Math.min(Math.max(shape, 0.3), 1.1) * width);
}

export const MARGIN = { left: 48, bottom: 36, top: 8, right: 8 }; // [px]

export function frameOf(limits: Limits, width: number, height: number): Frame {
  const inner = { width: width - MARGIN.left - MARGIN.right, height: height - MARGIN.top - MARGIN.bottom };
  const span = [limits.high[0] - limits.low[0], limits.high[1] - limits.low[1]] as const;
  const scale: [number, number] = [inner.width / span[0], inner.height / span[1]];
  if (limits.equal) scale[0] = scale[1] = Math.min(...scale);
  const middle = [(limits.low[0] + limits.high[0]) / 2, (limits.low[1] + limits.high[1]) / 2] as const;
  return {
    left: MARGIN.left,
    top: MARGIN.top,
    ...inner,
    x: (v) => MARGIN.left + inner.width / 2 + (v - middle[0]) * scale[0],
    y: (v) => MARGIN.top + inner.height / 2 - (v - middle[1]) * scale[1],
  };
}

/** Ticks of both axes that lie inside a frame, with their text. */
export function frameTicks(frame: Frame, limits: Limits): { x: [number, string][]; y: [number, string][] } {
  const unit = (f: (v: number) => number) => f(1) - f(0);
  const range = (from: number, to: number, f: (v: number) => number) =>
    [(from - f(0)) / unit(f), (to - f(0)) / unit(f)] as const;
  const [x0, x1] = limits.equal ? range(frame.left, frame.left + frame.width, frame.x) : [limits.low[0], limits.high[0]];
  const [y0, y1] = limits.equal ? range(frame.top + frame.height, frame.top, frame.y) : [limits.low[1], limits.high[1]];
  const labelled = (all: number[], f: (v: number) => number) =>
    all.map((v): [number, string] => [f(v), tickText(v, all)]);
  return {
    x: labelled(ticks(x0, x1, Math.max(2, frame.width / 70)), frame.x),
    y: labelled(ticks(y0, y1, Math.max(2, frame.height / 45)), frame.y),
  };
}
