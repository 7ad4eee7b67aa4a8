// What part of time the timeline shows, and where a moment lies in it.
import { computed, signal } from "@preact/signals";
import type { Mark } from "../events";
import { document, duration, lastTime, opened, rollout, track } from "../state";

/** Room left of the first moment and right of the last, so that marks there are whole [px]. */
export const MARGIN = 10;
/** Marks closer than this are bundled: the width of one and a gap [px]. */
const BUNDLE = 20;
/** The shortest interval that can be shown [s]: a few steps of a rollout. */
const SHORTEST = 1e-3;

export const width = signal(600);
/** The interval shown [s]; null: all. */
export const zoomed = signal<[number, number] | null>(null);
export const view = computed<[number, number]>(() => {
  const all = duration.value || 1;
  const [from, to] = zoomed.value ?? [0, all];
  return from < all ? [from, Math.min(to, all)] : [0, all];
});

export function place(t: number): number {
  const [from, to] = view.value;
  return MARGIN + ((t - from) / (to - from)) * (width.value - 2 * MARGIN);
}

export function moment(x: number): number {
  const [from, to] = view.value;
  return from + ((x - MARGIN) / (width.value - 2 * MARGIN)) * (to - from);
}

/** Show the interval from one moment to another, or all of time where it is wider. */
export function showInterval(a: number, b: number): void {
  const all = duration.value;
  const middle = (a + b) / 2;
  const span = Math.max(Math.abs(b - a), Math.min(SHORTEST, all));
  if (span >= all) zoomed.value = null;
  else {
    const from = Math.min(Math.max(middle - span / 2, 0), all - span);
    zoomed.value = [from, from + span];
  }
}

/** Zoom by a factor about a moment, which stays where it is; a factor above 1 shows less. */
export function zoom(factor: number, about: number): void {
  const [from, to] = view.value;
  const span = (to - from) / factor;
  const share = (about - from) / (to - from);
  const next = about - share * span;
  showInterval(next, next + span);
}

/** Shift the interval shown so that a moment is in it. */
export function reveal(t: number): void {
  if (zoomed.value === null) return;
  const [from, to] = view.value;
  if (t >= from && t <= to) return;
  showInterval(t, t + (to - from));
}

/** Marks at one place of the timeline. */
export interface Bundle {
  x: number;
  marks: Mark[];
}

/** Bundle the marks of the interval shown that would overlap; marks ascend in time. */
export function bundles(marks: Mark[]): Bundle[] {
  const [from, to] = view.value;
  const found: Bundle[] = [];
  let first = -Infinity;
  for (const mark of marks) {
    const t = mark.event.time;
    if (t < from || t > to) continue;
    const x = place(t);
    if (x - first < BUNDLE) {
      const bundle = found.at(-1)!;
      bundle.marks.push(mark);
      bundle.x = (first + x) / 2;
    } else {
      first = x;
      found.push({ x, marks: [mark] });
    }
  }
  return found;
}

/** Round moments for the axis, at least 70 px apart, and the decimals that they need. */
export function ticks(): { at: number[]; decimals: number } {
  const [from, to] = view.value;
  const least = ((to - from) * 70) / Math.max(width.value - 2 * MARGIN, 70);
  const power = 10 ** Math.floor(Math.log10(least));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= least * 0.999) ?? 10 * power;
  const at: number[] = [];
  for (let k = Math.ceil(from / step - 1e-6); k * step <= to + step * 1e-6; k++) at.push(k * step);
  return { at, decimals: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

/** Names of runs of which something was held out of fits; "" is the only one. */
export const heldOutRuns = computed(() => {
  const series = document.value?.gaps.flatMap((gap) => gap.series) ?? [];
  return [...new Set(series.filter((s) => s.held_out.length).map((s) => s.run))].sort();
});

/** Intervals held out of fits [s], of the measured run chosen, without repeats. */
export const heldOut = computed<[number, number][]>(() => {
  const doc = document.value;
  const measured = track.value;
  const shown = rollout.value ?? measured;
  if (!doc || !shown) return [];
  const found = new Map<string, [number, number]>();
  const add = (from: number | null | undefined, to: number | null | undefined) => {
    const interval: [number, number] = [from ?? 0, to ?? lastTime(shown)];
    found.set(interval.map((t) => t.toFixed(6)).join(), interval);
  };
  if (measured && measured.held_out_from !== null)
    add(measured.held_out_from, opened.value!.floats(measured.times).at(-1));
  for (const series of doc.gaps.flatMap((gap) => gap.series))
    if (series.run === "" || series.run === measured?.run) for (const [from, to] of series.held_out) add(from, to);
  return [...found.values()];
});
