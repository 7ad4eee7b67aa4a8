// Series of a rollout over time: what can be drawn of an object, and its numbers.
import { words } from "../format";
import type { RolloutView, Tracks } from "../document";
import { opened } from "../state";
import { contactTimes, sideOf } from "../scene/contacts";
import type { Opened } from "../unpack";
import type { Band } from "./series_plot";

/** Something that has a value at each sample. */
export interface Measure {
  name: string;
  title: string;
  unit: string;
  /** coordinate of a position that tracks measured as well */
  coordinate?: 0 | 1 | 2;
}

export interface Points {
  times: ArrayLike<number>;
  /** NaN where there is no value */
  values: ArrayLike<number>;
  /** Moments at which the values may jump, ascending [s]; none where they are continuous. */
  jumps?: readonly number[];
}

/** Measured positions along one coordinate. */
export interface Observations extends Points {
  /** standard deviation [m], NaN where unknown */
  sigma: Float64Array;
  /** from when on they were held out of fits [s] */
  heldOutFrom: number;
}

const MOTION: Measure[] = [
  { name: "x", title: "position x", unit: "m", coordinate: 0 },
  { name: "y", title: "position y", unit: "m", coordinate: 1 },
  { name: "z", title: "height z", unit: "m", coordinate: 2 },
  { name: "speed", title: "speed", unit: "m/s" },
  { name: "spin", title: "spin", unit: "rad/s" },
];
const RESIDUALS: Measure[] = [
  { name: "distance", title: "residual distance", unit: "m" },
  { name: "sigmas", title: "residual in sigmas", unit: "σ" },
];
const KINETIC = "kinetic_energy";
const POTENTIAL = "potential_energy";
const TOTAL: Measure = { name: "total_energy", title: "total energy", unit: "J" };

/** What can be drawn of any of these rollouts and tracks. */
export function measures(rollouts: RolloutView[], tracks: Tracks[]): Measure[] {
  const found = rollouts.length ? [...MOTION] : tracks.length ? MOTION.slice(0, 3) : [];
  if (rollouts.some((r) => r.misfits.length)) found.push(...RESIDUALS);
  for (const { name, unit } of rollouts.flatMap((r) => r.quantities))
    if (!found.some((m) => m.name === name)) found.push({ name, title: words(name), unit });
  const has = (name: string) => found.some((m) => m.name === name);
  if (has(KINETIC) && has(POTENTIAL) && !has(TOTAL.name)) found.push(TOTAL);
  return found;
}

/** Names of what has this measure, in the order of the columns. */
export function holders(measure: Measure, rollouts: RolloutView[], tracks: Tracks[]): string[] {
  const names = rollouts.flatMap((r) => {
    if (MOTION.includes(measure)) return r.names;
    if (RESIDUALS.includes(measure)) return r.misfits.map((m) => m.object);
    const wanted = measure === TOTAL ? KINETIC : measure.name;
    return r.quantities.filter((q) => q.name === wanted).map((q) => q.object);
  });
  if (measure.coordinate !== undefined) names.push(...tracks.flatMap((t) => t.names));
  return [...new Set(names)];
}

const kept = new WeakMap<Opened, Map<string, Points | null>>();

/** The values of an object in a rollout; null where it has none. */
export function pointsOf(measure: Measure, rollout: RolloutView, object: string): Points | null {
  const source = opened.value!;
  let known = kept.get(source);
  if (!known) kept.set(source, (known = new Map()));
  const key = `${rollout.id} ${measure.name} ${object}`;
  let points = known.get(key);
  if (points === undefined) {
    points = computedPoints(source, measure, rollout, object);
    if (points && jumps(measure)) points = { ...points, jumps: contactTimes(rollout, object) };
    known.set(key, points);
  }
  return points;
}

/** Whether a contact changes the value at once, as it does velocities. */
function jumps(measure: Measure): boolean {
  return measure.coordinate === undefined && measure.name !== POTENTIAL && !RESIDUALS.includes(measure);
}

function computedPoints(source: Opened, measure: Measure, rollout: RolloutView, object: string): Points | null {
  if (RESIDUALS.includes(measure)) {
    const misfit = rollout.misfits.find((m) => m.object === object);
    if (!misfit) return null;
    return {
      times: source.floats(misfit.times),
      values: source.floats(measure.name === "distance" ? misfit.distance : misfit.sigmas),
    };
  }
  const times = source.floats(rollout.times);
  if (MOTION.includes(measure)) return motion(source, measure, rollout, object);
  const quantity = (name: string) => {
    const found = rollout.quantities.find((q) => q.name === name && q.object === object);
    return found ? source.floats(found.values) : null;
  };
  if (measure !== TOTAL) {
    const values = quantity(measure.name);
    return values && { times, values };
  }
  const [kinetic, potential] = [quantity(KINETIC), quantity(POTENTIAL)];
  return kinetic && potential && { times, values: kinetic.map((k, i) => k + potential[i]!) };
}

/** Motion of an object while it is in the world. */
function motion(source: Opened, measure: Measure, rollout: RolloutView, object: string): Points | null {
  const count = rollout.names.length;
  const column = rollout.names.indexOf(object);
  if (column < 0) return null;
  const times = source.floats(rollout.times);
  const block = { speed: rollout.velocities, spin: rollout.spins }[measure.name] ?? rollout.positions;
  const numbers = source.floats(block);
  const active = source.numbers(rollout.active);
  const values = Float64Array.from(times, (_, row) => {
    const at = 3 * (row * count + column);
    if (!active[row * count + column]) return NaN;
    if (measure.coordinate !== undefined) return numbers[at + measure.coordinate]!;
    return Math.hypot(numbers[at]!, numbers[at + 1]!, numbers[at + 2]!);
  });
  return { times, values };
}

/** Measured positions of an object along one coordinate; null where none were measured. */
export function observationsOf(measure: Measure, track: Tracks, object: string): Observations | null {
  const column = track.names.indexOf(object);
  if (measure.coordinate === undefined || column < 0) return null;
  const source = opened.value!;
  const count = track.names.length;
  const positions = source.floats(track.positions);
  const sigma = source.floats(track.sigma);
  const times = source.floats(track.times);
  const column0 = 3 * column + measure.coordinate;
  return {
    times,
    values: Float64Array.from(times, (_, row) => positions[3 * count * row + column0]!),
    sigma: Float64Array.from(times, (_, row) => sigma[count * row + column]!),
    heldOutFrom: track.held_out_from ?? Infinity,
  };
}

/** Where nine of ten members of the rollout's ensemble have a coordinate; null where none is stored. */
export function bandOf(measure: Measure, rollout: RolloutView, object: string): Omit<Band, "color"> | null {
  const column = rollout.names.indexOf(object);
  if (!rollout.spread || measure.coordinate === undefined || column < 0) return null;
  const { times, low, high } = rollout.spread;
  const source = opened.value!;
  const at = (values: Float32Array | Float64Array) =>
    Float64Array.from({ length: times.shape[0]! }, (_, row) => values[3 * (row * rollout.names.length + column) + measure.coordinate!]!);
  return { times: source.floats(times), low: at(source.floats(low)), high: at(source.floats(high)) };
}

/** First index whose time is at or after t; times ascend. */
export function firstFrom(times: ArrayLike<number>, t: number): number {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle]! < t) low = middle + 1;
    else high = middle;
  }
  return low;
}

/**
 * Value at a moment, linear between samples, but across a jump that of the sample before it or after it; NaN outside
 * them or next to a gap.
 */
export function valueAt({ times, values, jumps }: Points, t: number): number {
  const near = 1e-6; // seconds: times are float32, and a clock at a sample should read that sample
  const k = firstFrom(times, t - near);
  if (k >= times.length) return NaN;
  if (Math.abs(times[k]! - t) <= near) return values[k]!;
  if (k === 0) return NaN;
  const side = sideOf(jumps ?? [], times[k - 1]! + near, times[k]! + near, t);
  if (side !== "none") return values[side === "before" ? k - 1 : k]!;
  const share = (t - times[k - 1]!) / (times[k]! - times[k - 1]!);
  return values[k - 1]! + share * (values[k]! - values[k - 1]!);
}

/** Value of the nearest measurement within half the spacing of measurements about it; NaN where there is none. */
export function nearestValue({ times, values }: Points, t: number): number {
  const k = firstFrom(times, t);
  const nearest = k === 0 || (k < times.length && times[k]! - t <= t - times[k - 1]!) ? k : k - 1;
  if (nearest >= times.length) return NaN;
  const spacing = nearest > 0 ? times[nearest]! - times[nearest - 1]! : (times[1] ?? Infinity) - times[0]!;
  return Math.abs(times[nearest]! - t) <= spacing / 2 + 1e-6 ? values[nearest]! : NaN;
}

/** The points from one moment to another and one to each side; of more than `most`, the extremes of equal parts. */
export function drawn({ times, values }: Points, from: number, to: number, most: number): [number[], number[]] {
  const begin = Math.max(firstFrom(times, from) - 1, 0);
  const end = Math.min(firstFrom(times, to) + 2, times.length);
  const [x, y]: [number[], number[]] = [[], []];
  const keep = (k: number) => (x.push(times[k]!), y.push(values[k]!));
  if (end - begin <= most) {
    for (let k = begin; k < end; k++) keep(k);
    return [x, y];
  }
  const parts = Math.floor(most / 2);
  for (let part = 0; part < parts; part++) {
    const first = begin + Math.floor(((end - begin) * part) / parts);
    const last = begin + Math.floor(((end - begin) * (part + 1)) / parts);
    let [low, high, gap] = [first, first, -1];
    for (let k = first; k < last; k++) {
      if (Number.isNaN(values[k]!)) gap = k;
      if (!(values[k]! >= values[low]!)) low = Number.isNaN(values[k]!) ? low : k;
      if (!(values[k]! <= values[high]!)) high = Number.isNaN(values[k]!) ? high : k;
    }
    for (const k of [...new Set(gap >= 0 ? [low, high, gap] : [low, high])].sort((a, b) => a - b)) keep(k);
  }
  return [x, y];
}
