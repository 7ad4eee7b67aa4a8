// How much space a motion takes.
import { Box3, Quaternion, Vector3, Vector4 } from "three";
import type { RolloutView, Static, Tracks, WorldView } from "../document";
import type { Opened } from "../unpack";
import { boundingRadius } from "./shapes";

/** Samples and points looked at: enough for a view, without walking through every particle of a fluid. */
const SAMPLES = 60;
const POINTS = 200;
/** The part of all places, at either end of an axis, that is left out of the view: objects on their way out. */
const TAIL = 0.04;
/** An object that gets so many times farther than all others that move has left, and does not set the scale. */
const LEFT = 4;

export interface Extent {
  /**
   * The box that all moving objects stay in [m], with marks and regions, and of fixed solids what is near; a cube of 1 m
   * where there is nothing.
   */
  box: Box3;
  /** Balls (x, y, z, radius) that an eye should see: where objects are at various times, corners of what is fixed [m]. */
  places: Vector4[];
}

export function extentOf(opened: Opened, world: WorldView, rollout: RolloutView | null, tracks: Tracks | null = null): Extent {
  const places: Vector4[] = [];
  const box = rollout ? motion(opened, world, rollout, places) : new Box3();
  const seen = places.filter(({ x, y, z }) => box.containsPoint(new Vector3(x, y, z)));
  const point = new Vector3();
  if (tracks) {
    const measured = opened.floats(tracks.positions);
    for (let i = 0; i + 2 < measured.length; i += 3) {
      const [x, y, z] = [measured[i]!, measured[i + 1]!, measured[i + 2]!];
      if (!Number.isFinite(x + y + z)) continue;
      box.expandByPoint(point.set(x, y, z));
      seen.push(new Vector4(x, y, z, 0));
    }
  }
  const marks = new Box3();
  for (const { lower, upper } of world.regions) {
    marks.expandByPoint(point.fromArray(lower)).expandByPoint(point.fromArray(upper));
  }
  for (const joint of world.joints) {
    for (const anchor of [joint.anchor, joint.other_anchor]) if (anchor) marks.expandByPoint(point.fromArray(anchor));
  }
  box.union(marks);
  if (!marks.isEmpty()) seen.push(...corners(marks));
  const near = box.clone().expandByScalar(0.35 * box.getSize(point).length());
  for (const fixed of world.statics) {
    const solid = staticBox(opened, fixed);
    if (solid.isEmpty() || (!near.isEmpty() && solid.intersect(near).isEmpty())) continue;
    box.union(solid);
    seen.push(...corners(solid));
  }
  if (box.isEmpty()) box.set(new Vector3(-0.5, -0.5, 0), new Vector3(0.5, 0.5, 1));
  if (!seen.length) seen.push(...corners(box));
  return { box, places: seen };
}

/** Both extents as one. */
export function union(a: Extent, b: Extent): Extent {
  return { box: a.box.clone().union(b.box), places: [...a.places, ...b.places] };
}

function corners({ min, max }: Box3): Vector4[] {
  const corner = (i: number) => new Vector4(i & 1 ? max.x : min.x, i & 2 ? max.y : min.y, i & 4 ? max.z : min.z, 0);
  return Array.from({ length: 8 }, (_, i) => corner(i));
}

/** The box of all moving objects, without the far part of the paths of those that have left. */
function motion(opened: Opened, world: WorldView, rollout: RolloutView, places: Vector4[]): Box3 {
  const moving: Box3[] = [];
  const whole = new Box3();
  const middles: Vector3[] = [];
  for (const name of rollout.names) {
    const { path, first, moves } = pathOf(opened, world, rollout, name, middles, places);
    if (path.isEmpty()) continue;
    whole.union(first);
    if (moves) moving.push(path);
  }
  const size = new Vector3();
  const usual = usually(middles);
  usual.expandByScalar(0.15 * usual.getSize(size).length());
  moving.forEach((path, i) => {
    const others = moving.reduce((all, p, j) => (j === i ? all : all.union(p)), new Box3());
    const reach = others.isEmpty() ? Infinity : LEFT * others.getSize(size).length();
    if (path.getSize(size).length() > reach) path.intersect(others.expandByScalar(0.25 * others.getSize(size).length()));
    whole.union(rollout.names.length > 2 ? path.intersect(usual) : path);
  });
  return whole;
}

/** The box of places without the ends of each axis. */
function usually(places: Vector3[]): Box3 {
  const box = new Box3();
  if (!places.length) return box;
  for (const axis of ["x", "y", "z"] as const) {
    const sorted = places.map((p) => p[axis]).sort((a, b) => a - b);
    const tail = Math.floor(TAIL * sorted.length);
    box.min[axis] = sorted[tail]!;
    box.max[axis] = sorted[sorted.length - 1 - tail]!;
  }
  return box;
}

/** path: all places. first: the box at its start. middles, places: added to. moves: by more than its own size. */
function pathOf(
  opened: Opened,
  world: WorldView,
  rollout: RolloutView,
  name: string,
  middles: Vector3[],
  places: Vector4[],
): { path: Box3; first: Box3; moves: boolean } {
  const item = world.moving.find((m) => m.name === name);
  const path = new Box3();
  const point = new Vector3();
  const times = rollout.times.shape[0] ?? 0;
  const column = rollout.names.indexOf(name);
  const columns = rollout.names.length;
  const active = opened.numbers(rollout.active);
  const deformed = rollout.deformed.find((d) => d.name === name);
  const values = opened.floats(deformed ? deformed.points : rollout.positions);
  const count = deformed ? (deformed.points.shape[1] ?? 0) : 1;
  const radius = (item?.shape ? boundingRadius(opened, item.shape) : item?.radius) ?? 0;
  const stride = Math.max(1, Math.floor(count / POINTS));
  const step = Math.max(1, Math.floor(times / SAMPLES));
  let first: Box3 | null = null;
  for (let i = 0; i < times; i += step) {
    if (!active[i * columns + column]) continue;
    for (let k = 0; k < count; k += stride) {
      const at = 3 * (deformed ? i * count + k : i * columns + column);
      const [x, y, z] = [values[at]!, values[at + 1]!, values[at + 2]!];
      if (!Number.isFinite(x + y + z)) continue;
      places.push(new Vector4(x, y, z, radius));
      path.expandByPoint(point.set(x - radius, y - radius, z - radius));
      path.expandByPoint(point.set(x + radius, y + radius, z + radius));
    }
    first ??= path.clone();
    const at = 3 * (i * columns + column);
    const centre = opened.floats(rollout.positions).subarray(at, at + 3);
    if (Number.isFinite(centre[0]! + centre[1]! + centre[2]!)) middles.push(new Vector3().fromArray(centre));
  }
  const moves = first !== null && path.getSize(point).length() > 1.5 * first.getSize(new Vector3()).length();
  return { path, first: first ?? path, moves };
}

/** Empty for a half space. A box, mostly a wall or a table, has its own corners: its ball would be much larger. */
export function staticBox(opened: Opened, fixed: Static): Box3 {
  const box = new Box3();
  const at = new Vector3().fromArray(fixed.position);
  const [w, x, y, z] = fixed.orientation as [number, number, number, number];
  const turn = new Quaternion(x, y, z, w);
  const shape = fixed.shape;
  const point = new Vector3();
  if (shape.kind === "plane") return box;
  if (shape.kind === "box") {
    for (let corner = 0; corner < 8; corner++) {
      point.fromArray(shape.half_extents.map((h, k) => (corner & (1 << k) ? h : -h)));
      box.expandByPoint(point.applyQuaternion(turn).add(at));
    }
  } else if (shape.kind === "mesh") {
    const v = opened.floats(shape.vertices);
    for (let i = 0; i + 2 < v.length; i += 3) box.expandByPoint(point.fromArray(v, i).applyQuaternion(turn).add(at));
  } else {
    const r = boundingRadius(opened, shape);
    box.expandByPoint(point.copy(at).addScalar(r)).expandByPoint(point.copy(at).addScalar(-r));
  }
  return box;
}
