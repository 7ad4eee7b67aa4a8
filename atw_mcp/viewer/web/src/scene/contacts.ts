// Contacts as moments at which velocities jump: between two samples about one nothing is interpolated.
import type { RolloutView } from "../document";

const kept = new WeakMap<RolloutView, Map<string, number[]>>();

/** When contacts of an object begin or end, ascending [s]; of a name that is no object's, those of all. */
export function contactTimes(rollout: RolloutView, object: string): readonly number[] {
  let known = kept.get(rollout);
  if (!known) kept.set(rollout, (known = new Map()));
  let times = known.get(object);
  if (!times) {
    const whole = !rollout.names.includes(object);
    times = rollout.events
      .filter((e) => e.kind.startsWith("contact") && (whole || e.participants.includes(object)))
      .map((e) => e.time)
      .sort((a, b) => a - b);
    known.set(object, times);
  }
  return times;
}

/** On which side of the jumps after `from` and until `to` a moment between them lies; "none": there is no jump. */
export function sideOf(jumps: readonly number[], from: number, to: number, t: number): "before" | "after" | "none" {
  let [low, high] = [0, jumps.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (jumps[middle]! <= from) low = middle + 1;
    else high = middle;
  }
  const first = jumps[low];
  if (first === undefined || first > to) return "none";
  return t < first ? "before" : "after";
}
