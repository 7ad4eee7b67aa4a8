// The events of the rollouts shown: which are visible, which a comparison found gone or new, and steps between them.
import { computed, signal } from "@preact/signals";
import type { ComparisonView, EventMark, RolloutView } from "./document";
import { digits, moment, words } from "./format";
import { compared, document, duration, layout, other, rollout, seek, time, worldOf } from "./state";

export type Kind = EventMark["kind"];

export const KINDS: { kind: Kind; title: string }[] = [
  { kind: "contact_begin", title: "contact" },
  { kind: "contact_end", title: "contact end" },
  { kind: "entry", title: "entry" },
  { kind: "exit", title: "exit" },
  { kind: "rest", title: "rest" },
  { kind: "release", title: "release" },
];

/** An event as the timeline draws it. */
export interface Mark {
  event: EventMark;
  /** a contact with the ground */
  ground: boolean;
  /** what a comparison of the two rollouts says of it */
  change: "" | "gone" | "new";
}

/** The events of a rollout. */
export interface Lane {
  role: "base" | "branch";
  rollout: RolloutView;
  marks: Mark[];
}

/** Ends of contacts are hidden at first: most follow their beginning by a millisecond. */
export const hiddenKinds = signal<ReadonlySet<Kind>>(new Set(["contact_end"]));
export const groundShown = signal(true);

/** The stored comparison of the rollout shown with the compared one, in either order. */
export const comparison = computed<ComparisonView | null>(() => {
  const ids = [rollout.value?.id, compared.value];
  return (
    document.value?.comparisons.findLast((c) => c.base !== c.edited && ids.includes(c.base) && ids.includes(c.edited)) ??
    null
  );
});

export const lanes = computed<Lane[]>(() => {
  const shown: Lane[] = [];
  if (rollout.value) shown.push(laneOf(rollout.value, "base"));
  if (other.value && other.value.id !== rollout.value?.id) shown.push(laneOf(other.value, "branch"));
  return shown;
});

/** The lanes without the events that are filtered out. */
export const visibleLanes = computed<Lane[]>(() =>
  lanes.value.map((lane) => ({
    ...lane,
    marks: lane.marks.filter((m) => !hiddenKinds.value.has(m.event.kind) && (groundShown.value || !m.ground)),
  })),
);

const moments = computed(() => [...new Set(visibleLanes.value.flatMap((l) => l.marks.map((m) => m.event.time)))].sort(ascending));

/** Go to the next visible event (+1) or the one before (-1); to the end or the start where there is none. */
export function stepEvent(direction: 1 | -1): void {
  const apart = 1e-6; // seconds: the clock is where an event was sought, save for rounding
  const all = moments.value;
  const found =
    direction > 0 ? all.find((t) => t > time.value + apart) : all.findLast((t) => t < time.value - apart);
  seek(found ?? (direction > 0 ? duration.value : 0));
}

export function sameEvent(a: EventMark, b: EventMark): boolean {
  return a.kind === b.kind && Math.abs(a.time - b.time) < 1e-6 && a.participants.join() === b.participants.join();
}

/** What happened: "contact of red cylinder and blue cube, 0.3142 N s". */
export function happening(event: EventMark): string {
  const who = event.participants.map(words).join(" and ");
  const size = event.impulse === null ? "" : `, ${digits(event.impulse)} N s`;
  switch (event.kind) {
    case "contact_begin":
      return `contact of ${who}${size}`;
    case "contact_end":
      return `end of the contact of ${who}`;
    case "entry":
      return `${who} enters`;
    case "exit":
      return `${who} leaves`;
    case "rest":
      return `${who} comes to rest`;
    case "release":
      return `${who} is released`;
  }
}

/** Show an event of a rollout: the rollout if it is not in sight, and its moment. */
export function showEvent(event: EventMark, id: string): void {
  if (rollout.value?.id !== id && compared.value === id && layout.value === "one") layout.value = "ghost";
  seek(event.time);
}

export function eventLabel(mark: Mark): string {
  const change = mark.change === "gone" ? " (gone in the compared rollout)" : mark.change === "new" ? " (new)" : "";
  return `${moment(mark.event.time)}: ${happening(mark.event)}${change}`;
}

function laneOf(shown: RolloutView, role: Lane["role"]): Lane {
  const found = other.value ? comparison.value : null; // marks of a rollout that is out of sight would be riddles
  const gone = found?.base === shown.id ? found.gone : [];
  const fresh = found?.edited === shown.id ? found.new : [];
  const ground = groundNames(shown);
  const marks = shown.events.map<Mark>((event) => ({
    event,
    ground: event.kind.startsWith("contact") && event.participants.some((name) => ground.has(name)),
    change: gone.some((e) => sameEvent(e, event)) ? "gone" : fresh.some((e) => sameEvent(e, event)) ? "new" : "",
  }));
  return { role, rollout: shown, marks: marks.sort((a, b) => a.event.time - b.event.time) };
}

/** Names of what objects lie on: fixed planes that face up, and what is called floor or ground. */
function groundNames(shown: RolloutView): Set<string> {
  const names = new Set(["floor", "ground"]);
  for (const fixed of worldOf(shown.world)?.statics ?? [])
    if (fixed.shape.kind === "plane" && fixed.shape.normal[2]! > 0.9) names.add(fixed.name);
  return names;
}

function ascending(a: number, b: number): number {
  return a - b;
}
