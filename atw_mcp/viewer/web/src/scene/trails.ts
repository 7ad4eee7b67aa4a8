// The path of each object: what has passed is solid, what is to come faint.
import type { Color } from "three";
import type { RolloutView, WorldView } from "../document";
import type { Opened } from "../unpack";
import { Lines } from "./lines";
import { distinct } from "./palette";

/** Pieces of one path: as fine as the eye sees on a screen. */
const PIECES = 300;

export class Trails {
  private readonly lines: Lines;

  /** size: of the scene [m]; objects that hardly move have no path. floor: what paths are seen against. */
  constructor(opened: Opened, world: WorldView, rollout: RolloutView, size: number, floor: Color, dashed: boolean) {
    const times = opened.floats(rollout.times);
    const positions = opened.floats(rollout.positions);
    const active = opened.numbers(rollout.active);
    const columns = rollout.names.length;
    const step = Math.max(1, Math.ceil((times.length - 1) / PIECES));
    this.lines = new Lines(columns * (Math.ceil(times.length / step) + 1), { future: 0.28, dash: dashed ? 7 : 0 });
    rollout.names.forEach((name, column) => {
      const moving = world.moving.find((m) => m.name === name);
      if (!moving || !["rigid", "soft"].includes(moving.kind)) return; // the middle of a rope goes where none of it goes
      const color = distinct(moving.color, floor);
      const from = this.lines.count;
      let reached = 0;
      for (let i = 0; i + 1 < times.length; i += step) {
        const next = Math.min(i + step, times.length - 1);
        const a = i * columns + column;
        const b = next * columns + column;
        if (!active[a] || !active[b] || !Number.isFinite(positions[3 * a]! + positions[3 * b]!)) continue;
        for (let k = 0; k < 3; k++) reached = Math.max(reached, Math.abs(positions[3 * b + k]! - positions[3 * column + k]!));
        this.lines.add(positions, 3 * a, positions, 3 * b, color, 2, times[i]!, times[next]!);
      }
      if (reached < 1e-3 * size) this.lines.count = from;
    });
    this.lines.done();
  }

  get object() {
    return this.lines.object;
  }

  setTime(t: number): void {
    this.lines.now = t;
  }
}
