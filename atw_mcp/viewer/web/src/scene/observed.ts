// Measured positions: a dot at each, those to come faint, and a ring where an object was seen last.
import { Color, Group, Vector3 } from "three";
import type { Moving, Tracks } from "../document";
import { words } from "../format";
import type { Opened } from "../unpack";
import { Dots } from "./dots";
import type { Label } from "./labels";
import { Lines } from "./lines";
import { distinct } from "./palette";
import { nearestMeasurement } from "./samples";

/** Dots of one object at most: as many as a screen can show apart. */
const MOST = 400;
/** Okabe-Ito colours of what no world has given one. */
const COLORS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9"];

export class Observed {
  readonly object = new Group();
  private readonly lines: Lines;
  private readonly past: Dots;
  private readonly now: Dots;
  private readonly times: Float32Array;
  private readonly positions: Float32Array;
  private readonly colors: Color[];
  private readonly step: number;

  /** floor: what dots are seen against; rim: around discs. */
  constructor(
    opened: Opened,
    private readonly tracks: Tracks,
    moving: Moving[],
    floor: Color,
    rim: Color,
  ) {
    const columns = tracks.names.length;
    this.times = opened.floats(tracks.times);
    this.positions = opened.floats(tracks.positions);
    this.step = Math.max(1, Math.ceil(this.times.length / MOST));
    this.colors = tracks.names.map((name, k) =>
      distinct(moving.find((m) => m.name === name)?.color ?? COLORS[k % COLORS.length]!, floor),
    );
    this.lines = new Lines(columns * MOST, { future: 0.28, dash: 4 });
    this.past = new Dots(columns * MOST, rim);
    this.now = new Dots(columns, rim);
    for (let column = 0; column < columns; column++) {
      let last = -1;
      for (let row = 0; row < this.times.length; row += this.step) {
        if (!this.seen(row, column)) continue;
        const [a, b] = [last, row].map((r) => 3 * (r * columns + column)) as [number, number];
        const [from, to] = [this.times[Math.max(last, 0)]!, this.times[row]!];
        if (last >= 0) this.lines.add(this.positions, a, this.positions, b, this.colors[column]!, 1, from, to);
        last = row;
      }
    }
    this.lines.done();
    this.object.add(this.lines.object, this.past.object, this.now.object);
  }

  private seen(row: number, column: number): boolean {
    const at = 3 * (row * this.tracks.names.length + column);
    return Number.isFinite(this.positions[at]! + this.positions[at + 1]! + this.positions[at + 2]!);
  }

  /** Move to `t` [s]; returns labels of what is seen then. */
  setTime(t: number): Label[] {
    this.lines.now = t;
    this.past.clear();
    this.now.clear();
    const labels: Label[] = [];
    const columns = this.tracks.names.length;
    const nearest = nearestMeasurement(this.times, t);
    this.tracks.names.forEach((name, column) => {
      const color = this.colors[column]!;
      const place = (row: number) => [0, 1, 2].map((k) => this.positions[3 * (row * columns + column) + k]!) as Three;
      for (let row = 0; row < this.times.length; row += this.step) {
        if (this.seen(row, column)) this.past.add(...place(row), color, 5, this.times[row]! <= t ? 0.9 : 0.3);
      }
      if (nearest < 0 || !this.seen(nearest, column)) return;
      this.now.add(...place(nearest), color, 13, 1, 0.3);
      const at = new Vector3().fromArray(place(nearest));
      labels.push({ key: `${name} observed`, text: `${words(name)} observed`, at, color: `#${color.getHexString()}`, kind: "name" });
    });
    this.past.done();
    this.now.done();
    return labels;
  }
}

type Three = [number, number, number];
