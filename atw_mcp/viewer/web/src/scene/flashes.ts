// Events, flashing where they happen: a ring that grows and fades.
import { Color } from "three";
import type { EventMark } from "../document";
import type { Mark } from "../events";
import { Dots } from "./dots";

/** How long an event is seen after it began [s of the world]. */
const SHOWN = 0.45;
/** Diameter of a ring at its end [px]. */
const WIDEST = 54;

/** Events seen at once: the strongest; a heap that settles has hundreds. */
const MOST = 12;

export type EventColors = Record<EventMark["kind"], Color>;

/** Okabe-Ito: contacts begin in vermillion and end in sky, and so on; the ring's form says the same. */
export const EVENT_COLORS: EventColors = {
  contact_begin: new Color("#d55e00"),
  contact_end: new Color("#56b4e9"),
  entry: new Color("#009e73"),
  exit: new Color("#cc79a7"),
  rest: new Color("#0072b2"),
  release: new Color("#e69f00"),
};

export class Flashes {
  private readonly dots: Dots;
  private marks: Mark[] = [];
  private strongest = 0;

  /** rim: colour around discs. */
  constructor(rim: Color) {
    this.dots = new Dots(2 * MOST, rim);
  }

  show(marks: Mark[]): void {
    this.marks = marks.filter((m) => m.event.position !== null);
    this.strongest = this.marks.reduce((most, m) => Math.max(most, m.event.impulse ?? 0), 0);
  }

  get object() {
    return this.dots.object;
  }

  /** Events seen at `t` [s], the strongest first. */
  setTime(t: number): Mark[] {
    const seen: Mark[] = [];
    this.dots.clear();
    for (const mark of this.marks) if (t >= mark.event.time && t < mark.event.time + SHOWN) seen.push(mark);
    seen.sort((a, b) => (b.event.impulse ?? 0) - (a.event.impulse ?? 0)).splice(MOST);
    for (const { event } of seen) {
      const age = (t - event.time) / SHOWN;
      const [x, y, z] = event.position as [number, number, number];
      const color = EVENT_COLORS[event.kind];
      const strength = this.strongest > 0 && event.impulse !== null ? Math.sqrt(event.impulse / this.strongest) : 0.6;
      const widest = WIDEST * (0.3 + 0.7 * strength);
      this.dots.add(x, y, z, color, 8 + (widest - 8) * Math.sqrt(age), (1 - age) ** 0.7, 0.2);
      if (event.kind === "contact_begin") this.dots.add(x, y, z, color, 14 * strength * (1 - age), 1 - age);
    }
    this.dots.done();
    return seen;
  }
}
