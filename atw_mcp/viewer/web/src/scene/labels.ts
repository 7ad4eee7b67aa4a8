// Words in the scene: elements over the canvas, moved to where their places are seen.
import type { Camera, Vector3 } from "three";
import { Vector3 as Vector } from "three";

export interface Label {
  /** The same from frame to frame for the same thing. */
  key: string;
  text: string;
  at: Vector3;
  /** Of the dot before the text; null: none. */
  color: string | null;
  kind: "name" | "distance" | "gone" | "new" | "event" | "region";
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

export class Labels {
  private readonly shown = new Map<string, Shown>();

  constructor(private readonly host: HTMLElement) {}

  /** Show labels of several views; where two would cover each other the earlier in the list is shown. */
  place(views: { labels: Label[]; camera: Camera; window: Window }[]): void {
    for (const one of this.shown.values()) one.used = false;
    views.forEach(({ labels, camera, window }, index) => {
      const taken: [number, number, number][] = [];
      for (const label of labels) {
        projected.copy(label.at).project(camera);
        if (projected.z < -1 || projected.z > 1 || Math.abs(projected.x) > 1 || Math.abs(projected.y) > 1) continue;
        const one = this.element(`${index}|${label.key}`, label);
        let x = window.x + (0.5 + 0.5 * projected.x) * window.width;
        const y = window.y + (0.5 - 0.5 * projected.y) * window.height - LIFT;
        x = Math.min(Math.max(x, window.x + one.width / 2 + 2), window.x + window.width - one.width / 2 - 2);
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
      one = { element, dot, words, text: "", width: 0, used: true };
      this.shown.set(key, one);
    }
    const kind = `scene-label ${label.kind}${label.chosen ? " chosen" : ""}`;
    if (one.text !== label.text || one.element.className !== kind) {
      const same = one.text.length === label.text.length && one.element.className === kind;
      one.text = label.text;
      one.words.textContent = label.text;
      one.element.className = kind;
      one.dot.hidden = label.color === null;
      if (!same || !one.width) one.width = one.element.offsetWidth;
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
