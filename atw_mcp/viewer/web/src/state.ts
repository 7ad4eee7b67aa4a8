// What is shown now: one clock, one or two rollouts, one chosen object. Panels read and write these signals only.
import { batch, computed, effect, signal } from "@preact/signals";
import type { Running, RolloutView, Tracks, WorldView } from "./document";
import { defaults, type Pair } from "./defaults";
import { FrameClock } from "./frame_clock";
import type { Opened } from "./unpack";

export type Layout = "one" | "side" | "ghost";
export type Eye = "orbit" | "video" | "plan";
export type Tab = "series" | "comparison" | "gap" | "fits" | "provenance" | "evidence";

export const opened = signal<Opened | null>(null);
/** Why there is nothing to show; "" while loading. */
export const failure = signal("");
/** What is waited for while there is no document. */
export const progress = signal("Loading …");
export const live = signal(false);
/** When the server of a live page was last heard of, while it is gone. */
export const lost = signal<Date | null>(null);
/** Path of the store of a live page while no file, or another, is there; else "". */
export const gone = signal("");
/** Work under way as the server of a live page last reported it. */
export const progressing = signal<Running[] | null>(null);

/** Ids of the rollout shown and of the one it is compared with. */
export const chosen = signal<string | null>(null);
export const compared = signal<string | null>(null);
export const layout = signal<Layout>("one");

/** [s] since the start of the rollouts. */
export const time = signal(0);
export const playing = signal(false);
/** Seconds of the world a second of the viewer's. */
export const speed = signal(1);
export const loop = signal(true);

/** Which of the measured runs is shown beside, or without, a rollout. */
export const observedRun = signal(0);

/** Name of the chosen object: highlighted, its series shown. */
export const object = signal<string | null>(null);
/** Name of the object that the orbiting eye follows. */
export const followed = signal<string | null>(null);
export const eye = signal<Eye>("orbit");

/** The panel below the timeline. */
export const tab = signal<Tab>("series");
/** Id of the chosen row of evidence. */
export const evidence = signal<string | null>(null);
/** Id of the chosen record of the provenance graph; "": none; null: the viewer chooses. */
export const record = signal<string | null>(null);

export const document = computed(() => opened.value?.document ?? null);
export const running = computed(() => progressing.value ?? document.value?.running ?? []);
export const rollout = computed(() => rolloutOf(chosen.value));
export const other = computed(() => (layout.value === "one" ? null : rolloutOf(compared.value)));
/** The world of the rollout shown; without a rollout the committed one, else the latest. */
export const world = computed(() => {
  const worlds = document.value?.worlds ?? [];
  return rollout.value ? worldOf(rollout.value.world) : (worlds.findLast((w) => w.committed) ?? worlds.at(-1) ?? null);
});
export const otherWorld = computed(() => worldOf(other.value?.world ?? null));

/** Time from one frame of the video to the next as a world says it [s]; null where none does. */
const modelled = computed(() => world.value?.seconds_per_frame || document.value?.worlds.at(-1)?.seconds_per_frame || null);

/** Time from one frame of the video to the next [s]: without a world by the file's rate, else of 25 frames a second. */
export const secondsPerFrame = computed(
  () => modelled.value ?? document.value?.case.file_seconds_per_frame ?? 0.04,
);

/** When each frame of the video was taken. */
export const frameClock = computed(() => new FrameClock(secondsPerFrame.value, document.value?.case.clock ?? null));

/** Where the time is not that of a world, what it is: time as the video's file has it. */
export const timeBase = computed(() => {
  if (modelled.value !== null || !document.value?.film) return "";
  return document.value.case.file_seconds_per_frame ? "file time" : "at 25 frames a second: the file states no rate";
});

/** When the last frame of the video begins [s]; null where no video was observed. */
export const filmEnd = computed(() => {
  if (document.value?.case.kind !== "video") return null;
  const frames = document.value.film?.frame_count || world.value?.frame_count || 0;
  return frames > 0 ? frameClock.value.time(frames - 1) : null;
});

/** Measured positions of the run chosen; null where there are none. */
export const track = computed(() => document.value?.tracks[observedRun.value] ?? document.value?.tracks[0] ?? null);

/** Measured positions that belong into the scene: without a rollout, or with one alone that is meant to follow them. */
export const followedTrack = computed(() => {
  const follows = rollout.value?.misfits.length && layout.value === "one";
  return !rollout.value || follows ? track.value : null;
});

/** Length of what is shown [s]. */
export const duration = computed(() => {
  const shown = [rollout.value, other.value].filter((r) => r !== null);
  if (shown.length) return Math.max(...shown.map(lastTime));
  return Math.max(filmEnd.value ?? 0, track.value ? lastTime(track.value) : 0);
});

/** Frame of the video at the present time, not rounded. */
export const frame = computed(() => frameClock.value.frame(time.value));

/** The frame nearest to the present time, which the film shows and all panels name; beyond the last after the video. */
export const nearestFrame = computed(() => Math.round(frame.value));

export function rolloutOf(id: string | null): RolloutView | null {
  return document.value?.rollouts.find((r) => r.id === id) ?? null;
}

export function worldOf(id: string | null): WorldView | null {
  return document.value?.worlds.find((w) => w.id === id) ?? null;
}

export function lastTime(r: RolloutView | Tracks): number {
  const times = opened.value!.floats(r.times);
  return times.length ? times[times.length - 1]! : 0;
}

/** What the last document was opened with, where the viewer chose that; null where a person or a tool's result did. */
let proposed: Pair | null = null;

/**
 * Show a document: keep what a person chose where it still exists; else follow to the committed world and the branch
 * that the latest answer rests on.
 */
export function show(next: Opened): void {
  const doc = next.document;
  if (observedRun.value >= doc.tracks.length) observedRun.value = 0;
  const exists = (id: string | null | undefined) => doc.rollouts.some((r) => r.id === id);
  const wanted = defaults(doc);
  const first = opened.value === null;
  const follows = proposed?.chosen === chosen.value && proposed?.compared === compared.value;
  batch(() => {
    opened.value = next;
    if (first && exists(doc.shown[0])) {
      chosen.value = doc.shown[0]!;
      const beside = wanted.compared === chosen.value ? wanted.chosen : wanted.compared;
      compared.value = exists(doc.shown[1]) ? doc.shown[1]! : beside;
      if (doc.shown.length > 1 && compared.value) layout.value = "ghost";
      return;
    }
    if (first || follows || !exists(chosen.value)) chosen.value = wanted.chosen;
    if (first || follows || !exists(compared.value)) compared.value = wanted.compared;
    if (compared.value === chosen.value) compared.value = null;
    if (compared.value === null) layout.value = "one";
    if (first || follows) proposed = wanted;
  });
}

export function seek(t: number): void {
  time.value = Math.min(Math.max(t, 0), duration.value);
}

let before = 0;
/** Advance the clock with the display while playing. */
export function runClock(): void {
  effect(() => {
    if (!playing.value) return;
    before = performance.now();
    requestAnimationFrame(tick);
  });
}

function tick(now: number): void {
  if (!playing.value) return;
  let next = time.value + ((now - before) / 1000) * speed.value;
  before = now;
  if (next >= duration.value) {
    if (loop.value && duration.value > 0) next %= duration.value;
    else {
      next = duration.value;
      playing.value = false;
    }
  }
  time.value = next;
  requestAnimationFrame(tick);
}
