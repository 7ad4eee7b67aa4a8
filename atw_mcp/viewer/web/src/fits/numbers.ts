// Fitted values as people read them, and what a sample of them shows.
import type { FittedParameter } from "../document";
import { digits, scaled, words } from "../format";

/** Names of initial states, which come after what an object or the surroundings are. */
const STATES = /\.(position|velocity|rotation|angular_velocity|shift)\./;

export function isState(parameter: FittedParameter): boolean {
  return STATES.test(parameter.name);
}

/** Whether a parameter was fitted, rather than only varied in the sample. */
export function isFitted(parameter: FittedParameter): boolean {
  return parameter.interval95 !== null || parameter.bounds !== null;
}

/** The object that a parameter is of, if it is of one, and its name without it. */
export function parts(name: string): { object: string | null; rest: string } {
  const [head, ...rest] = name.split(".");
  if (!rest.length) return { object: null, rest: words(name) };
  return { object: head!, rest: words(rest.join(" ")) };
}

/** A value with its 95% interval in one unit, to two digits of the half width: 19.7 ± 2.4 mm. */
export function withInterval(parameter: FittedParameter): string {
  const { value, interval95: interval } = parameter;
  if (interval === null) {
    const { factor, unit } = scaled(value, parameter.unit);
    return `${digits(value / factor)} ${unit}`.trimEnd();
  }
  const [low, high] = interval as [number | null, number | null];
  const below = low === null ? null : value - low;
  const above = high === null ? null : high - value;
  const wide = Math.max(below ?? 0, above ?? 0);
  const { factor, unit } = scaled(Math.max(Math.abs(value), wide), parameter.unit);
  const decimals = wide > 0 ? Math.min(Math.max(0, 1 - Math.floor(Math.log10(wide / factor))), 12) : 3;
  const text = (x: number) => (x / factor).toFixed(decimals).replace("-", "−");
  if (below !== null && above !== null && Math.abs(below - above) <= 0.1 * wide) {
    return `${text(value)} ± ${text((below + above) / 2)} ${unit}`.trimEnd();
  }
  const range =
    low === null ? `at most ${text(high!)}` : high === null ? `at least ${text(low)}` : `${text(low)} to ${text(high)}`;
  return `${text(value)} (${range}) ${unit}`.trimEnd();
}

/** Where a value lies in a range, 0 to 1, on a logarithmic scale where the search was on one. */
export function place(x: number, [low, high]: readonly [number, number], logarithmic: boolean): number {
  if (high <= low) return 0.5;
  if (logarithmic && low > 0) return x > 0 ? Math.log(x / low) / Math.log(high / low) : 0;
  return (x - low) / (high - low);
}

/** The range of numbers, with a margin on either side; null where there is none. */
export function extent(values: Iterable<number>, margin = 0.08): [number, number] | null {
  let [low, high] = [Infinity, -Infinity];
  for (const x of values) {
    if (x < low) low = x;
    if (x > high) high = x;
  }
  if (!(low <= high)) return null;
  const room = (high - low) * margin || Math.abs(high) * margin || 1;
  return [low - room, high + room];
}

/** Pearson's correlation of two samples; null where one of them does not vary. */
export function correlation(a: Float32Array, b: Float32Array): number | null {
  const n = Math.min(a.length, b.length);
  const mean = (x: Float32Array) => x.subarray(0, n).reduce((sum, value) => sum + value, 0) / n;
  const [ma, mb] = [mean(a), mean(b)];
  let [aa, bb, ab] = [0, 0, 0];
  for (let i = 0; i < n; i++) {
    const [da, db] = [a[i]! - ma, b[i]! - mb];
    aa += da * da;
    bb += db * db;
    ab += da * db;
  }
  return aa > 0 && bb > 0 ? ab / Math.sqrt(aa * bb) : null;
}

/** The two samples that are most correlated; null where there are not two. */
export function mostCorrelated(samples: readonly Float32Array[]): [number, number] | null {
  let best: [number, number] | null = samples.length > 1 ? [0, 1] : null;
  let most = 0;
  for (let i = 0; i < samples.length; i++) {
    for (let j = i + 1; j < samples.length; j++) {
      const size = Math.abs(correlation(samples[i]!, samples[j]!) ?? 0);
      if (size > most) [most, best] = [size, [i, j]];
    }
  }
  return best;
}
