// Keys of the whole page; the help dialog lists this table.
import { signal } from "@preact/signals";
import { stepEvent } from "./events";
import { LAYERS } from "./panels/film/shown";
import {
  compared,
  duration,
  eye,
  followed,
  frameClock,
  layout,
  loop,
  nearestFrame,
  object,
  playing,
  seek,
  speed,
  time,
  type Eye,
  type Layout,
} from "./state";

export const SPEEDS = [1 / 16, 1 / 8, 1 / 4, 1 / 2, 1, 2, 4, 8];
export const helpOpen = signal(false);

export interface Binding {
  /** As `KeyboardEvent.key`, "Shift+" before it where that matters. */
  key: string;
  shown: string;
  does: string;
  run: () => void;
}

export const BINDINGS: Binding[] = [
  { key: " ", shown: "Space", does: "Play or pause", run: togglePlay },
  { key: "ArrowLeft", shown: "←", does: "One frame back", run: () => stepFrame(-1) },
  { key: "ArrowRight", shown: "→", does: "One frame forward", run: () => stepFrame(1) },
  { key: "Shift+ArrowLeft", shown: "Shift ←", does: "Previous event", run: () => stepEvent(-1) },
  { key: "Shift+ArrowRight", shown: "Shift →", does: "Next event", run: () => stepEvent(1) },
  { key: "Home", shown: "Home", does: "To the start", run: () => seek(0) },
  { key: "End", shown: "End", does: "To the end", run: () => seek(duration.value) },
  { key: "[", shown: "[", does: "Slower", run: () => changeSpeed(-1) },
  { key: "]", shown: "]", does: "Faster", run: () => changeSpeed(1) },
  { key: "l", shown: "L", does: "Loop on or off", run: () => (loop.value = !loop.value) },
  { key: "1", shown: "1", does: "One rollout", run: () => chooseLayout("one") },
  { key: "2", shown: "2", does: "Two rollouts side by side", run: () => chooseLayout("side") },
  { key: "3", shown: "3", does: "The compared rollout as a ghost", run: () => chooseLayout("ghost") },
  { key: "v", shown: "V", does: "View of the video's camera", run: () => look("video") },
  { key: "o", shown: "O", does: "View that orbits", run: () => look("orbit") },
  { key: "p", shown: "P", does: "View from above (plan)", run: () => look("plan") },
  { key: "f", shown: "F", does: "Follow the chosen object, or stop", run: () => follow(object.value) },
  ...LAYERS.map(({ key, does, on }) => ({
    key,
    shown: key.toUpperCase(),
    does: `${does}: show or hide`,
    run: () => void (on.value = !on.value),
  })),
  { key: "?", shown: "?", does: "This list of keys", run: () => (helpOpen.value = true) },
];

export function togglePlay(): void {
  if (!playing.value && time.value >= duration.value) seek(0);
  playing.value = !playing.value && duration.value > 0;
}

/** Go to the instant of the next frame or of the one before. */
export function stepFrame(direction: 1 | -1): void {
  playing.value = false;
  seek(frameClock.value.time(nearestFrame.value + direction));
}

export function changeSpeed(direction: 1 | -1): void {
  const faster = SPEEDS.find((s) => s > speed.value);
  const slower = SPEEDS.findLast((s) => s < speed.value);
  speed.value = (direction > 0 ? faster : slower) ?? speed.value;
}

export function chooseLayout(next: Layout): void {
  if (next === "one" || compared.value) layout.value = next;
}

export function follow(name: string | null): void {
  followed.value = followed.value === name ? null : name;
}

function look(next: Eye): void {
  eye.value = next;
}

/** Obey the keys wherever the focus is, except where an element uses them itself. */
export function listen(): void {
  giveFocusBack();
  window.addEventListener("keydown", (event) => {
    if (event.key === "Escape") closeMenus();
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || helpOpen.value) return;
    if (event.target instanceof Element && takesKey(event.target, event.key)) return;
    const shifted = event.shiftKey && event.key.startsWith("Arrow") ? "Shift+" : "";
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const found = BINDINGS.find((b) => b.key === shifted + key);
    if (!found) return;
    event.preventDefault();
    found.run();
  });
}

/** Take the focus from a button that was clicked with a pointer: its keys would hide those of the page. */
function giveFocusBack(): void {
  let pointed = false;
  window.addEventListener("pointerdown", () => (pointed = true), true);
  window.addEventListener("keydown", () => (pointed = false), true);
  window.addEventListener("click", (event) => {
    if (!(event.target instanceof Element)) return;
    for (const menu of openMenus()) if (!menu.contains(event.target)) menu.open = false;
    const button = event.target.closest<HTMLElement>("button, summary, a, input[type=checkbox], [role=button]");
    if (pointed && button && button === document.activeElement && !button.closest("dialog")) button.blur();
  });
}

/** Lists that lie over the page. */
function openMenus(): HTMLDetailsElement[] {
  return [...document.querySelectorAll<HTMLDetailsElement>("details.show[open]")];
}

function closeMenus(): void {
  for (const menu of openMenus()) menu.open = false;
}

function takesKey(target: Element, key: string): boolean {
  if (target.closest("input:not([type=checkbox]), textarea, select, [contenteditable]")) return true;
  return key === " " && target.closest("button, summary, a, input, [role=button]") !== null;
}
