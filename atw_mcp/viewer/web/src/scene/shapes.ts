// Geometry of the document's shapes in body axes [m].
import {
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  CapsuleGeometry,
  CylinderGeometry,
  PlaneGeometry,
  Quaternion,
  SphereGeometry,
  Vector3,
} from "three";
import { toCreasedNormals } from "three/addons/utils/BufferGeometryUtils.js";
import type { Mesh as MeshShape, Plane, Static } from "../document";
import type { Opened } from "../unpack";

export type Shape = Static["shape"];

/** Edges that turn by less are drawn round [rad]. */
const CREASE = Math.PI / 6;

/** `reach`: how far a half space is drawn to each side [m]. */
export function shapeGeometry(opened: Opened, shape: Shape, reach: number): BufferGeometry {
  switch (shape.kind) {
    case "sphere":
      return new SphereGeometry(shape.radius, 40, 28);
    case "box": {
      const [x, y, z] = shape.half_extents as [number, number, number];
      return new BoxGeometry(2 * x, 2 * y, 2 * z);
    }
    case "cylinder":
      return new CylinderGeometry(shape.radius, shape.radius, 2 * shape.half_height, 48).rotateX(Math.PI / 2);
    case "capsule":
      return new CapsuleGeometry(shape.radius, 2 * shape.half_height, 12, 32).rotateX(Math.PI / 2);
    case "mesh":
      return meshGeometry(opened, shape);
    case "plane":
      return planeGeometry(shape, reach);
  }
}

function meshGeometry(opened: Opened, shape: MeshShape): BufferGeometry {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(opened.floats(shape.vertices), 3));
  geometry.setIndex(new BufferAttribute(Uint32Array.from(opened.numbers(shape.triangles)), 1));
  const creased = toCreasedNormals(geometry, CREASE);
  geometry.dispose();
  return creased;
}

function planeGeometry(shape: Plane, reach: number): BufferGeometry {
  const normal = new Vector3(...(shape.normal as [number, number, number]));
  const length = normal.length() || 1;
  normal.divideScalar(length);
  const turn = new Quaternion().setFromUnitVectors(new Vector3(0, 0, 1), normal);
  const at = normal.clone().multiplyScalar(shape.offset / length);
  return new PlaneGeometry(2 * reach, 2 * reach).applyQuaternion(turn).translate(at.x, at.y, at.z);
}

/** Radius of the ball about the body's origin that holds the shape [m]; 0 for a half space, which has none. */
export function boundingRadius(opened: Opened, shape: Shape): number {
  switch (shape.kind) {
    case "sphere":
      return shape.radius;
    case "box":
      return Math.hypot(...shape.half_extents);
    case "cylinder":
      return Math.hypot(shape.radius, shape.half_height);
    case "capsule":
      return shape.radius + shape.half_height;
    case "plane":
      return 0;
    case "mesh": {
      const v = opened.floats(shape.vertices);
      let most = 0;
      for (let i = 0; i + 2 < v.length; i += 3) most = Math.max(most, Math.hypot(v[i]!, v[i + 1]!, v[i + 2]!));
      return most;
    }
  }
}
