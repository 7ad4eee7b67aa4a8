// States between the samples of a rollout: positions linear in time, orientations by slerp.

/** A place between samples `at` and `next`: `part` of the way, 0..1. */
export interface Moment {
  at: number;
  next: number;
  part: number;
}

/** Where `t` [s] lies in ascending `times`; the ends are held. */
export function moment(times: Float32Array, t: number): Moment {
  const last = times.length - 1;
  if (last < 0 || !(t > times[0]!)) return { at: 0, next: 0, part: 0 };
  if (t >= times[last]!) return { at: last, next: last, part: 0 };
  let low = 0;
  let high = last;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle]! <= t) low = middle;
    else high = middle;
  }
  return { at: low, next: high, part: (t - times[low]!) / (times[high]! - times[low]!) };
}

/** Index of the measurement at `t` [s], within half the spacing about it; -1 where there is none. Times ascend. */
export function nearestMeasurement(times: Float32Array, t: number): number {
  if (!times.length) return -1;
  const { at, next, part } = moment(times, t);
  const nearest = part > 0.5 ? next : at;
  const spacing = times[Math.max(nearest, 1)]! - times[Math.max(nearest, 1) - 1]!;
  return !(Math.abs(times[nearest]! - t) > spacing / 2 + 1e-6) ? nearest : -1; // alone, it has no spacing
}

/**
 * Write `count` numbers at the moment into `out`: `values` holds `count` a sample. A number that is NaN at either end
 * is NaN between.
 */
export function lerp(values: Float32Array, count: number, m: Moment, out: Float32Array): void {
  const a = m.at * count;
  const b = m.next * count;
  const part = m.part;
  if (part === 0) {
    for (let i = 0; i < count; i++) out[i] = values[a + i]!;
    return;
  }
  for (let i = 0; i < count; i++) out[i] = values[a + i]! + part * (values[b + i]! - values[a + i]!);
}

/** The quaternion (w, x, y, z) of column `column` of `columns` at the moment, by slerp the short way round. */
export function slerp(values: Float32Array, columns: number, column: number, m: Moment, out: number[]): void {
  const a = 4 * (m.at * columns + column);
  const b = 4 * (m.next * columns + column);
  let dot = 0;
  for (let k = 0; k < 4; k++) dot += values[a + k]! * values[b + k]!;
  const sign = dot < 0 ? -1 : 1;
  const angle = Math.acos(Math.min(1, Math.abs(dot)));
  const sine = Math.sin(angle);
  // below 1 mrad the chord is the arc to 1 part in 10^7, and the sine is no divisor
  const from = angle < 1e-3 ? 1 - m.part : Math.sin((1 - m.part) * angle) / sine;
  const to = sign * (angle < 1e-3 ? m.part : Math.sin(m.part * angle) / sine);
  for (let k = 0; k < 4; k++) out[k] = from * values[a + k]! + to * values[b + k]!;
}

/** Whether an object is in the world at the moment. */
export function present(active: Uint8Array, columns: number, column: number, m: Moment): boolean {
  return active[m.at * columns + column] === 1;
}

/** The moment itself, or its earlier sample where the object has left by the next one: no motion to where it is not. */
export function held(active: Uint8Array, columns: number, column: number, m: Moment): Moment {
  return active[m.next * columns + column] === 1 ? m : { at: m.at, next: m.at, part: 0 };
}
