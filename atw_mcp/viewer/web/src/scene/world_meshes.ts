// The solids of a world at any time of a rollout, as three.js objects: z up, metres.
import {
  type BufferGeometry,
  EdgesGeometry,
  Group,
  LineBasicMaterial,
  LineSegments,
  type Material,
  Mesh,
  type Object3D,
  SphereGeometry,
  type Vector3,
} from "three";
import type { Deformed, Moving, RolloutView, WorldView } from "../document";
import type { Opened } from "../unpack";
import { extentOf } from "./extent";
import { fastSpeed, fluid } from "./fluid";
import { surface, type Style } from "./looks";
import { rope, type Deformable } from "./rope";
import { held, lerp, moment, present, slerp } from "./samples";
import { shapeGeometry } from "./shapes";
import { sheet } from "./sheet";

export interface WorldOptions {
  /** "ghost": translucent, rigid objects with their edges. */
  style?: Style;
  /** Names of the fixed solids to draw; default: all. Most of a ghost's are there already. */
  statics?: ReadonlySet<string>;
  /** Names of fixed solids that are drawn translucent with their edges: the other world lacks them. */
  lacking?: ReadonlySet<string>;
}

export interface WorldMeshes {
  group: Group;
  /**
   * Objects by name, fixed ones too. `userData` of each and of all meshes below it: `name`, and `column`, the index in
   * the rollout's names; -1 for a fixed solid.
   */
  byName: Map<string, Object3D>;
  /** Move everything to where it is at `t` [s]; what is not in the world then is not visible. */
  setTime(t: number): void;
  /** Points (k, 3) of a deformable object now [m], overwritten by `setTime`; null for others. */
  points(name: string): Float32Array | null;
  /** Where an object's middle is now, written into `out`; false while it is not in the world. */
  middle(name: string, out: Vector3): boolean;
  /** Speeds of the lightest particles of fluids, by name [m/s]. */
  speeds: Map<string, number>;
  /** What cannot be drawn, and why; one sentence each. */
  missing: string[];
  dispose(): void;
}

export function buildWorld(
  opened: Opened,
  world: WorldView,
  rollout: RolloutView | null,
  options: WorldOptions = {},
): WorldMeshes {
  const style = options.style ?? "solid";
  const group = new Group();
  const byName = new Map<string, Object3D>();
  const missing: string[] = [];
  const speeds = new Map<string, number>();
  const clouds = new Map<string, Float32Array>();
  const steps: ((t: number) => void)[] = [];
  const add = (name: string, column: number, object: Object3D) => {
    object.name = name;
    object.traverse((part) => {
      part.userData.name = name;
      part.userData.column = column;
      part.castShadow = style === "solid";
      part.receiveShadow = style === "solid";
    });
    byName.set(name, object);
    group.add(object);
  };

  {
    const { box } = extentOf(opened, world, rollout);
    const reach = box.max.distanceTo(box.min);
    for (const fixed of world.statics) {
      if (options.statics && !options.statics.has(fixed.name)) continue;
      const faint = options.lacking?.has(fixed.name) ? "ghost" : style;
      const solid = new Mesh(
        shapeGeometry(opened, fixed.shape, reach),
        surface(fixed.color, { style: faint, pattern: "none", twoSided: fixed.shape.kind === "plane" }),
      );
      if (faint === "ghost") solid.add(edges(solid.geometry, fixed.color));
      solid.position.fromArray(fixed.position);
      const [w, x, y, z] = fixed.orientation as [number, number, number, number];
      solid.quaternion.set(x, y, z, w);
      solid.userData.shape = fixed.shape.kind;
      add(fixed.name, -1, solid);
    }
  }

  if (rollout) {
    const times = opened.floats(rollout.times);
    const columns = rollout.names.length;
    const active = opened.numbers(rollout.active) as Uint8Array;
    const positions = opened.floats(rollout.positions);
    const orientations = opened.floats(rollout.orientations);
    const turn = [1, 0, 0, 0];
    rollout.names.forEach((name, column) => {
      const moving = world.moving.find((m) => m.name === name);
      if (!moving) {
        missing.push(`${name} is in the rollout but not in the world`);
        return;
      }
      if (moving.kind === "rigid") {
        if (!moving.shape) {
          missing.push(`${name} has no shape`);
          return;
        }
        const body = rigid(opened, moving, style);
        add(name, column, body);
        const here = new Float32Array(3);
        steps.push((t) => {
          const m = moment(times, t);
          body.visible = present(active, columns, column, m);
          if (!body.visible) return;
          const shown = held(active, columns, column, m);
          for (let k = 0; k < 3; k++) {
            const from = positions[3 * (shown.at * columns + column) + k]!;
            here[k] = from + shown.part * (positions[3 * (shown.next * columns + column) + k]! - from);
          }
          slerp(orientations, columns, column, shown, turn);
          body.visible = Number.isFinite(here[0]! + here[1]! + here[2]! + turn[0]!);
          body.position.fromArray(here);
          body.quaternion.set(turn[1]!, turn[2]!, turn[3]!, turn[0]!);
        });
        return;
      }
      const deformed = rollout.deformed.find((d) => d.name === name);
      const fastest =
        deformed && moving.kind === "fluid" ? fastSpeed(opened.floats(deformed.points), deformed.points.shape[1] ?? 0, times) : 0;
      if (fastest > 0) speeds.set(name, fastest);
      const soft = deformed && deformable(opened, moving, deformed, fastest, style);
      if (!soft) {
        missing.push(`the points of ${name} (${moving.kind}) were not stored`);
        return;
      }
      add(name, column, soft.object);
      const values = opened.floats(deformed.points);
      const numbers = 3 * deformed.points.shape[1]!;
      const points = new Float32Array(numbers);
      clouds.set(name, points);
      steps.push((t) => {
        const m = moment(times, t);
        soft.object.visible = present(active, columns, column, m);
        if (!soft.object.visible) return;
        const shown = held(active, columns, column, m);
        lerp(values, numbers, shown, points);
        // at a sample itself, the speed of the step after it
        const next = Math.min(Math.max(shown.next, shown.at + 1), times.length - 1);
        soft.setPoints(points, { values, a: shown.at * numbers, b: next * numbers, seconds: times[next]! - times[shown.at]! });
      });
    });
  }

  const setTime = (t: number) => {
    for (const step of steps) step(t);
  };
  setTime(0);
  const points = (name: string) => clouds.get(name) ?? null;
  const middle = (name: string, out: Vector3) => {
    const object = byName.get(name);
    if (!object?.visible) return false;
    const cloud = clouds.get(name);
    if (!cloud) return (out.copy(object.position), true);
    return mean(cloud, out);
  };
  return { group, byName, setTime, points, middle, speeds, missing, dispose: () => disposeAll(group) };
}

function edges(geometry: BufferGeometry, color: string): LineSegments {
  return new LineSegments(new EdgesGeometry(geometry, 25), new LineBasicMaterial({ color, transparent: true, opacity: 0.9 }));
}

function rigid(opened: Opened, moving: Moving, style: Style): Mesh {
  const shape = moving.shape!;
  const round = shape.kind === "sphere" || shape.kind === "cylinder" || shape.kind === "capsule";
  const geometry = shapeGeometry(opened, shape, 1);
  const body = new Mesh(geometry, surface(moving.color, { style, pattern: round ? "octants" : "none" }));
  if (style === "ghost") {
    const ink = new LineBasicMaterial({ color: moving.color, transparent: true, opacity: 0.9 });
    const few = shape.kind === "sphere" ? new SphereGeometry(shape.radius, 12, 6) : geometry;
    body.add(new LineSegments(new EdgesGeometry(few, shape.kind === "sphere" ? 1 : 25), ink));
    if (few !== geometry) few.dispose();
  }
  return body;
}

function deformable(opened: Opened, moving: Moving, deformed: Deformed, fastest: number, style: Style): Deformable | null {
  const count = deformed.points.shape[1] ?? 0;
  const points = opened.floats(deformed.points);
  if (moving.kind === "rope" && moving.segments) {
    return rope(moving.color, moving.radius ?? 0, count, opened.numbers(moving.segments), style);
  }
  if ((moving.kind === "cloth" || moving.kind === "soft") && moving.triangles) {
    const first = points.slice(0, 3 * count);
    return sheet(moving.color, opened.numbers(moving.triangles), first, moving.kind === "soft", style);
  }
  return moving.kind === "fluid" ? fluid(moving.color, moving.radius ?? 0.01, count, fastest, style) : null;
}

/** The mean of points (k, 3) that are there; false where none is. */
function mean(points: Float32Array, out: Vector3): boolean {
  let count = 0;
  out.set(0, 0, 0);
  for (let i = 0; i + 2 < points.length; i += 3) {
    if (points[i] !== points[i]) continue; // NaN
    out.set(out.x + points[i]!, out.y + points[i + 1]!, out.z + points[i + 2]!);
    count++;
  }
  out.divideScalar(count || 1);
  return count > 0;
}

/** Free what is held on the GPU below `root`. */
export function disposeAll(root: Object3D): void {
  root.traverse((part) => {
    const drawn = part as Object3D & { geometry?: BufferGeometry; material?: Material | Material[]; dispose?: () => void };
    drawn.geometry?.dispose();
    for (const material of [drawn.material ?? []].flat()) material.dispose();
    drawn.dispose?.(); // instance matrices
  });
  root.removeFromParent();
}
