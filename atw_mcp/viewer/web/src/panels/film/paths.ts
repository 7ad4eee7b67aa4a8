// Paths of the objects of a rollout in the video, up to a time.
import type { RolloutView, WorldView } from "../../document";
import type { Opened } from "../../unpack";
import type { Pinhole } from "./pinhole";

/** Points of a path at most: more are not seen on a screen. */
const MOST = 300;
/** Objects without one place that a path could join. */
const SPREAD = new Set(["fluid", "rope"]);

export interface PathSoFar {
  path: Path2D;
  /** Pixel of the last point; null where the object has left, or is behind the camera. */
  end: [number, number] | null;
}

export class Paths {
  private readonly columns: number[];
  private readonly times: Float32Array;
  private readonly positions: Float32Array;
  private readonly active: ArrayLike<number>;
  private readonly stride: number;
  private readonly count: number;

  constructor(opened: Opened, world: WorldView, rollout: RolloutView) {
    this.times = opened.floats(rollout.times);
    this.positions = opened.floats(rollout.positions);
    this.active = opened.numbers(rollout.active);
    this.count = rollout.names.length;
    this.stride = Math.max(1, Math.ceil(this.times.length / MOST));
    const kinds = new Map(world.moving.map((m) => [m.name, m.kind]));
    this.columns = rollout.names.map((_, k) => k).filter((k) => !SPREAD.has(kinds.get(rollout.names[k]!) ?? "rigid"));
  }

  /** Paths from the start to `t` [s]. */
  until(t: number, eye: Pinhole): PathSoFar[] {
    const slack = 1e-6; // [s] float32 times
    let last = 0;
    while (last + 1 < this.times.length && this.times[last + 1]! <= t + slack) last++;
    return this.columns.map((column) => {
      const path = new Path2D();
      let drawing = false;
      let end: PathSoFar["end"] = null;
      for (let i = 0; i <= last; i = i === last ? last + 1 : Math.min(i + this.stride, last)) {
        const at = i * this.count + column;
        const here = this.active[at]
          ? eye.project(this.positions[3 * at]!, this.positions[3 * at + 1]!, this.positions[3 * at + 2]!)
          : null;
        end = here && Number.isFinite(here[0]) ? here : null;
        if (!end) drawing = false;
        else if (drawing) path.lineTo(...end);
        else path.moveTo(...end);
        drawing = end !== null;
      }
      return { path, end };
    });
  }
}
