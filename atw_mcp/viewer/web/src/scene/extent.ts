// How much space a motion takes.
import { Box3, Quaternion, Vector3 } from "three";
import type { RolloutView, WorldView } from "../document";
import type { Opened } from "../unpack";
import { boundingRadius } from "./shapes";

/** Samples and points looked at: enough for a view, without walking through every particle of a fluid. */
const SAMPLES = 60;
const POINTS = 400;

/**
 * The box that all moving objects stay in [m], with fixed solids that are no larger than a few times that; a cube of
 * 1 m where there is nothing.
 */
export function extentOf(opened: Opened, world: WorldView, rollout: RolloutView | null): Box3 {
  const box = new Box3();
  const point = new Vector3();
  const turn = new Quaternion();
  if (rollout) {
    const times = opened.floats(rollout.times).length;
    const columns = rollout.names.length;
    const positions = opened.floats(rollout.positions);
    const active = opened.numbers(rollout.active);
    const radii = rollout.names.map((name) => {
      const shape = world.moving.find((m) => m.name === name)?.shape;
      return shape ? boundingRadius(opened, shape) : 0;
    });
    const step = Math.max(1, Math.floor(times / SAMPLES));
    const grow = (x: number, y: number, z: number, r: number) => {
      if (!Number.isFinite(x + y + z)) return;
      box.expandByPoint(point.set(x - r, y - r, z - r)).expandByPoint(point.set(x + r, y + r, z + r));
    };
    const kinds = rollout.names.map((name) => world.moving.find((m) => m.name === name)?.kind ?? "rigid");
    for (let i = 0; i < times; i += step) {
      for (let j = 0; j < columns; j++) {
        if (!active[i * columns + j] || kinds[j] !== "rigid") continue;
        const at = 3 * (i * columns + j);
        grow(positions[at]!, positions[at + 1]!, positions[at + 2]!, radii[j]!);
      }
      for (const deformed of rollout.deformed) {
        const count = deformed.points.shape[1] ?? 0;
        const points = opened.floats(deformed.points);
        const radius = world.moving.find((m) => m.name === deformed.name)?.radius ?? 0;
        const stride = Math.max(1, Math.floor(count / POINTS));
        for (let k = 0; k < count; k += stride) {
          const at = 3 * (i * count + k);
          grow(points[at]!, points[at + 1]!, points[at + 2]!, radius);
        }
      }
    }
  }
  const limit = box.isEmpty() ? Infinity : 3 * Math.max(box.getSize(point).length(), 1e-3);
  for (const fixed of world.statics) {
    const r = boundingRadius(opened, fixed.shape);
    if (r === 0 || r > limit) continue;
    const at = new Vector3(...(fixed.position as [number, number, number]));
    const shape = fixed.shape;
    // a box is mostly a wall or a table: its own corners, as its ball would be much larger
    if (shape.kind === "box") {
      const [w, x, y, z] = fixed.orientation as [number, number, number, number];
      for (let corner = 0; corner < 8; corner++) {
        point.fromArray(shape.half_extents.map((h, k) => (corner & (1 << k) ? h : -h)));
        box.expandByPoint(point.applyQuaternion(turn.set(x, y, z, w)).add(at));
      }
    } else {
      box.expandByPoint(point.copy(at).addScalar(r)).expandByPoint(point.copy(at).addScalar(-r));
    }
  }
  for (const region of world.regions) {
    const lower = new Vector3(...(region.lower as [number, number, number]));
    const upper = new Vector3(...(region.upper as [number, number, number]));
    if (lower.distanceTo(upper) > limit) continue;
    box.expandByPoint(lower).expandByPoint(upper);
  }
  for (const joint of world.joints) {
    for (const anchor of [joint.anchor, joint.other_anchor]) {
      if (anchor) box.expandByPoint(point.fromArray(anchor));
    }
  }
  if (box.isEmpty()) box.set(new Vector3(-0.5, -0.5, 0), new Vector3(0.5, 0.5, 1));
  return box;
}
