// Words in the scene: elements over the canvas, moved to where their places are seen.
import type { Camera, Vector3 } from "three";
import { Vector3 as Vector } from "three";

export interface Label {
  /** The same from frame to frame for the same thing. */
  key: string;
  text: string;
  at: Vector3;
  /** Name of the object that it is about. */
  object?: string;
  /** Name of the effect whose push it is. */
  effect?: string;
  /** Number in the text, in full. */
  value?: number;
  /** Radius that it stays clear of [m]. */
  above?: number;
  /** Of the dot before the text; null: none. */
  color: string | null;
  kind: "name" | "distance" | "gone" | "new" | "event" | "region" | "push";
  chosen?: boolean;
}

interface Shown {
  element: HTMLElement;
  dot: HTMLElement;
  words: HTMLElement;
  text: string;
  width: number;
  used: boolean;
}

/** Height of a label, and its distance above its place [px]. */
const HEIGHT = 19;
const LIFT = 15;

/** Part of the panel in CSS pixels. */
export interface Window {
  x: number;
  y: number;
  width: number;
  height: number;
}

const projected = new Vector();
const depth = new Vector();

/** Pixels that the radius which a label stays clear of takes on the screen. */
function clear(label: Label, camera: Camera, window: Window): number {
  const [scale, down, , shift] = [5, 11, 14, 15].map((k) => camera.projectionMatrix.elements[k]!);
  const w = down! * depth.copy(label.at).applyMatrix4(camera.matrixWorldInverse).z + shift!;
  return (0.5 * label.above! * scale! * window.height) / w;
}

export class Labels {
  private readonly shown = new Map<string, Shown>();

  constructor(private readonly host: HTMLElement) {}

  /** Show labels of several views; where two would cover each other the earlier in the list is shown. */
  place(views: { labels: Label[]; camera: Camera; window: Window }[]): void {
    for (const one of this.shown.values()) one.used = false;
    views.forEach(({ labels }, index) => labels.forEach((label) => this.element(`${index}|${label.key}`, label)));
    for (const one of this.shown.values()) one.width ||= one.element.offsetWidth; // all at once: one layout of the page
    views.forEach(({ labels, camera, window }, index) => {
      const taken: [number, number, number][] = [];
      for (const label of labels) {
        projected.copy(label.at).project(camera);
        if (projected.z < -1 || projected.z > 1 || Math.abs(projected.x) > 1 || Math.abs(projected.y) > 1) continue;
        const one = this.shown.get(`${index}|${label.key}`)!;
        let x = window.x + (0.5 + 0.5 * projected.x) * window.width;
        const seen = window.y + (0.5 - 0.5 * projected.y) * window.height;
        if (label.object) Object.assign(one.element.dataset, { object: label.object, x, y: seen });
        if (label.effect) one.element.dataset.effect = label.effect;
        if (label.value !== undefined) one.element.dataset.value = String(label.value);
        const y = seen - LIFT - (label.above ? clear(label, camera, window) : 0);
        x = Math.max(Math.min(x, window.x + window.width - one.width / 2 - 2), window.x + one.width / 2 + 2);
        const free = taken.every(([tx, ty, tw]) => Math.abs(ty - y) > HEIGHT || Math.abs(tx - x) > (tw + one.width) / 2);
        if (!free && !label.chosen) continue;
        taken.push([x, y, one.width]);
        one.used = true;
        one.element.style.transform = `translate(${Math.round(x - one.width / 2)}px, ${Math.round(y - HEIGHT / 2)}px)`;
      }
    });
    for (const one of this.shown.values()) {
      const hidden = one.used ? "" : "hidden";
      if (one.element.style.visibility !== hidden) one.element.style.visibility = hidden;
    }
    if (this.shown.size > 400) this.forget();
  }

  private element(key: string, label: Label): Shown {
    let one = this.shown.get(key);
    if (!one) {
      const element = document.createElement("span");
      const dot = document.createElement("i");
      const words = document.createElement("b");
      element.append(dot, words);
      this.host.append(element);
      one = { element, dot, words, text: "", width: 0, used: false };
      this.shown.set(key, one);
    }
    const kind = `scene-label ${label.kind}${label.chosen ? " chosen" : ""}`;
    if (one.text !== label.text || one.element.className !== kind) {
      const same = one.text.length === label.text.length && one.element.className === kind;
      one.text = label.text;
      one.words.textContent = label.text;
      one.element.className = kind;
      one.dot.hidden = label.color === null;
      if (!same) one.width = 0;
    }
    if (label.color) one.dot.style.background = label.color;
    return one;
  }

  /** Drop elements that are not shown: events of long ago. */
  private forget(): void {
    for (const [key, one] of this.shown) {
      if (one.used) continue;
      one.element.remove();
      this.shown.delete(key);
    }
  }

  dispose(): void {
    for (const one of this.shown.values()) one.element.remove();
    this.shown.clear();
  }
}
