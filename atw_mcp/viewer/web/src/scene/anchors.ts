// Points fixed to objects: where they are at the start, carried along as the objects move and turn.
import { Quaternion, Vector3 } from "three";
import type { WorldMeshes } from "./world_meshes";

/** Where a carried point is now, written into `out`; false while its object is not in the world. */
export type Carried = (out: Vector3) => boolean;

/**
 * The point `at` [m, world axes at the start] of object `name`; null: the world itself. `held`: points of a deformable
 * object whose mean it is; without them it is fixed to the one that is nearest at the start. Call with the meshes at the
 * start.
 */
export function carried(meshes: WorldMeshes, name: string | null, at: readonly number[], held: readonly number[] = []): Carried {
  const fixed = new Vector3().fromArray(at as number[]);
  const object = name === null ? undefined : meshes.byName.get(name);
  if (!object || object.userData.column === -1) return (out) => (out.copy(fixed), true);
  const points = meshes.points(name!);
  if (points) {
    const chosen = held.length ? held : [nearest(points, fixed)];
    return (out) => {
      out.set(0, 0, 0);
      for (const i of chosen) {
        out.x += points[3 * i]! / chosen.length;
        out.y += points[3 * i + 1]! / chosen.length;
        out.z += points[3 * i + 2]! / chosen.length;
      }
      return object.visible && Number.isFinite(out.x);
    };
  }
  const local = fixed.clone().sub(object.position).applyQuaternion(object.quaternion.clone().invert());
  return (out) => {
    out.copy(local).applyQuaternion(object.quaternion).add(object.position);
    return object.visible;
  };
}

/** How the object has turned since the start, written into `out`; a deformable object and the world have not. */
export function turned(meshes: WorldMeshes, name: string | null): (out: Quaternion) => void {
  const object = name === null ? undefined : meshes.byName.get(name);
  if (!object || object.userData.column === -1 || meshes.points(name!)) return (out) => void out.identity();
  const back = object.quaternion.clone().invert();
  return (out) => void out.copy(object.quaternion).multiply(back);
}

function nearest(points: Float32Array, to: Vector3): number {
  let best = 0;
  let least = Infinity;
  for (let i = 0; 3 * i < points.length; i++) {
    const d = (points[3 * i]! - to.x) ** 2 + (points[3 * i + 1]! - to.y) ** 2 + (points[3 * i + 2]! - to.z) ** 2;
    if (d < least) [least, best] = [d, i];
  }
  return best;
}
