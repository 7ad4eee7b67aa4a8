// Events, flashing where they happen: a ring that grows and fades.
import { Color } from "three";
import type { EventMark, RolloutView } from "../document";
import { Dots } from "./dots";

/** How long an event is seen after it began [s of the world]. */
const SHOWN = 0.45;
/** Diameter of a ring at its end [px]. */
const WIDEST = 54;

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
  private readonly events: EventMark[];

  constructor(rollout: RolloutView, rim: Color) {
    this.events = rollout.events.filter((e) => e.position !== null);
    this.dots = new Dots(2 * Math.max(1, this.events.length), rim);
  }

  get object() {
    return this.dots.object;
  }

  /** Events seen at `t` [s]. */
  setTime(t: number): EventMark[] {
    const seen: EventMark[] = [];
    this.dots.clear();
    for (const event of this.events) {
      const age = (t - event.time) / SHOWN;
      if (age < 0 || age > 1) continue;
      const [x, y, z] = event.position as [number, number, number];
      const color = EVENT_COLORS[event.kind];
      this.dots.add(x, y, z, color, 10 + (WIDEST - 10) * Math.sqrt(age), (1 - age) ** 0.7, 0.22);
      if (event.kind === "contact_begin") this.dots.add(x, y, z, color, 12 * (1 - age), 1 - age);
      seen.push(event);
    }
    this.dots.done();
    return seen;
  }
}
