// What effects do: an arrow at each object, and the field in space.
import { Color, Group, Vector3 } from "three";
import type { EffectMark, RolloutView, WorldView } from "../document";
import { quantity } from "../format";
import type { Opened } from "../unpack";
import { Arrows } from "./arrows";
import { contactTimes, sideOf } from "./contacts";
import type { Label } from "./labels";
import { lerp, moment } from "./samples";
import { boundingRadius } from "./shapes";
import type { WorldMeshes } from "./world_meshes";

/** Length of a full arrow, as a part of the size of the scene. */
const FULL = 0.15;
/** A full arrow stands for this quantile of what there is: one close pass at a magnet would make all others vanish. */
const QUANTILE = 0.9;
/** Stronger ones are cut off at so many full arrows. */
export const CUT = 1.6;
/** Weaker ones than this part of a full arrow are left out. */
const WEAK = 0.03;
/** Okabe-Ito colours in the order in which effects take them. */
const INKS = ["#d55e00", "#cc79a7", "#0072b2", "#009e73", "#e69f00", "#56b4e9"];

/** What a full arrow stands for, and the strongest there is. */
export interface Scale {
  full: number;
  most: number;
  unit: string;
}

/** An entry of the legend. */
export interface EffectKey {
  name: string;
  kind: string;
  /** Standard name of the effect, where it is not its kind; else "". */
  title: string;
  color: string;
  /** Arrows at objects; null where the effect has none. */
  arrows: Scale | null;
  /** Arrows of its field in space; null where it has none. */
  field: Scale | null;
  enabled: boolean;
}

export class Pushes {
  readonly object = new Group();
  readonly keys: EffectKey[] = [];
  /** The value now of each arrow at an object. */
  labels: Label[] = [];
  private readonly steps: ((t: number) => void)[] = [];

  /** size: of the scene [m]. */
  constructor(opened: Opened, world: WorldView, rollout: RolloutView | null, meshes: WorldMeshes, size: number) {
    const full = FULL * size;
    const radii = new Map(world.moving.map((m) => [m.name, m.shape ? boundingRadius(opened, m.shape) : 0]));
    const names = new Set([...world.effects.map((e) => e.name), ...(rollout?.pushes.map((p) => p.effect) ?? [])]);
    let which = 0;
    for (const name of names) {
      const mark: EffectMark | undefined = world.effects.find((e) => e.name === name);
      const color = INKS[which++ % INKS.length]!;
      const key: EffectKey = { name, kind: mark?.kind ?? "", title: mark?.title ?? "", color, arrows: null, field: null, enabled: mark?.enabled ?? true };
      const push = rollout?.pushes.find((p) => p.effect === name);
      if (push && rollout) {
        const values = opened.floats(push.accelerations);
        const scale = scaleOf(values, "m/s^2");
        if (scale) {
          key.arrows = scale;
          const times = opened.floats(rollout.times);
          const columns = rollout.names.length;
          const arrows = new Arrows(columns, new Color(color), 0.0055 * size);
          const now = new Float32Array(3 * columns);
          const from = new Vector3();
          this.object.add(arrows.object);
          this.steps.push((t) => {
            const m = moment(times, t);
            lerp(values, 3 * columns, m, now);
            arrows.clear();
            for (let j = 0; j < columns; j++) {
              if (m.part > 0) {
                // what depends on the velocity jumps with it
                const side = sideOf(contactTimes(rollout, rollout.names[j]!), times[m.at]!, times[m.next]!, t);
                const from = 3 * ((side === "before" ? m.at : m.next) * columns + j);
                if (side !== "none") now.set(values.subarray(from, from + 3), 3 * j);
              }
              const [x, y, z] = [now[3 * j]!, now[3 * j + 1]!, now[3 * j + 2]!];
              const strength = Math.hypot(x, y, z);
              if (!(strength > WEAK * scale.full)) continue;
              if (!meshes.middle(rollout.names[j]!, from)) continue;
              // from the surface on: what is inside the object cannot be seen
              const out = (radii.get(rollout.names[j]!) ?? 0) / strength;
              from.set(from.x + out * x, from.y + out * y, from.z + out * z);
              const length = full * Math.min(strength / scale.full, CUT);
              arrows.add(from, x, y, z, length);
              const at = from.clone().add(new Vector3(x, y, z).multiplyScalar(length / strength));
              const text = quantity(strength, scale.unit, 3);
              const key = `${name} on ${rollout.names[j]!}`;
              this.labels.push({ key, value: strength, text, at, color, kind: "push", effect: name });
            }
            arrows.done();
          });
        }
      }
      if (mark?.field) {
        const points = opened.floats(mark.field.points);
        const vectors = opened.floats(mark.field.vectors);
        const scale = scaleOf(vectors, mark.field.unit);
        if (scale) {
          key.field = scale;
          const count = points.length / 3;
          const arrows = new Arrows(count, new Color(color), 0.0022 * size, 0.5);
          const length = Math.min(0.7 * spacing(points), 0.6 * full);
          const from = new Vector3();
          for (let i = 0; i < count; i++) {
            const [x, y, z] = [vectors[3 * i]!, vectors[3 * i + 1]!, vectors[3 * i + 2]!];
            const strength = Math.hypot(x, y, z) / scale.full;
            if (strength > WEAK) arrows.add(from.fromArray(points, 3 * i), x, y, z, length * Math.min(strength, CUT));
          }
          arrows.done();
          this.object.add(arrows.object);
        }
      }
      this.keys.push(key);
    }
  }

  setTime(t: number): void {
    this.labels = [];
    for (const step of this.steps) step(t);
  }
}

/** The scale for vectors (k, 3); null where all are zero. */
function scaleOf(vectors: Float32Array, unit: string): Scale | null {
  const lengths: number[] = [];
  for (let i = 0; i + 2 < vectors.length; i += 3) {
    const length = Math.hypot(vectors[i]!, vectors[i + 1]!, vectors[i + 2]!);
    if (length > 0) lengths.push(length);
  }
  if (!lengths.length) return null;
  lengths.sort((a, b) => a - b);
  return { full: lengths[Math.floor(QUANTILE * (lengths.length - 1))]!, most: lengths.at(-1)!, unit };
}

/** Distance of the first point from its nearest neighbour [m]: the side of a regular grid. */
function spacing(points: Float32Array): number {
  let least = Infinity;
  for (let i = 3; i + 2 < points.length; i += 3) {
    const d = Math.hypot(points[i]! - points[0]!, points[i + 1]! - points[1]!, points[i + 2]! - points[2]!);
    if (d > 0 && d < least) least = d;
  }
  return least;
}
