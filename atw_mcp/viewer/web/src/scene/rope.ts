// A rope: a tube along its segments, with balls at its points.
import { Color, CylinderGeometry, Group, InstancedMesh, Matrix4, SphereGeometry } from "three";
import { measured, surface, type Style } from "./looks";

/** Two samples of a deformable object's points: where they begin in `values`, and how far apart they are [s]. */
export interface Between {
  values: Float32Array;
  a: number;
  b: number;
  seconds: number;
}

/** A part of the scene that follows the points of a deformable object. */
export interface Deformable {
  object: Group;
  /** Points (k, 3) [m]; NaN where there is none. between: the samples that they lie between. */
  setPoints(points: Float32Array, between: Between): void;
}

const matrix = new Matrix4();

/** segments (s, 2): points that are joined. radius [m]. */
export function rope(color: string, radius: number, count: number, segments: ArrayLike<number>, style: Style): Deformable {
  const object = new Group();
  const links = segments.length / 2;
  const material = surface(color, { style, pattern: "none", thin: radius });
  const tubes = new InstancedMesh(new CylinderGeometry(1, 1, 1, 14, 1, true).rotateX(Math.PI / 2), material, links);
  const balls = new InstancedMesh(new SphereGeometry(1, 14, 10), material, count);
  const light = new Color(1, 1, 1);
  const dim = new Color(0.72, 0.72, 0.72);
  for (let i = 0; i < links; i++) tubes.setColorAt(i, i % 2 ? dim : light);
  for (const part of [tubes, balls]) {
    part.frustumCulled = false;
    measured(part);
    object.add(part);
  }
  return {
    object,
    setPoints(points) {
      const e = matrix.elements;
      for (let i = 0; i < links; i++) {
        const a = 3 * segments[2 * i]!;
        const b = 3 * segments[2 * i + 1]!;
        alongZ(e, points, a, b, radius);
        tubes.setMatrixAt(i, matrix);
      }
      for (let i = 0; i < count; i++) {
        const x = points[3 * i]!;
        matrix.makeScale(radius, radius, radius);
        if (Number.isFinite(x)) matrix.setPosition(x, points[3 * i + 1]!, points[3 * i + 2]!);
        else matrix.makeScale(0, 0, 0);
        balls.setMatrixAt(i, matrix);
      }
      for (const part of [tubes, balls]) {
        part.instanceMatrix.needsUpdate = true;
        part.boundingSphere = null;
      }
    },
  };
}

/** Elements of the matrix that takes the unit tube along z to the tube of `radius` from points[a] to points[b]. */
function alongZ(e: number[], points: Float32Array, a: number, b: number, radius: number): void {
  const dx = points[b]! - points[a]!;
  const dy = points[b + 1]! - points[a + 1]!;
  const dz = points[b + 2]! - points[a + 2]!;
  const length = Math.hypot(dx, dy, dz);
  if (!(length > 0)) {
    e.fill(0);
    e[15] = 1;
    return;
  }
  const [zx, zy, zz] = [dx / length, dy / length, dz / length];
  // any direction across: z of the world, or x where the segment is upright
  let [xx, xy, xz] = Math.abs(zz) < 0.9 ? [-zy, zx, 0] : [0, -zz, zy];
  const across = Math.hypot(xx, xy, xz);
  [xx, xy, xz] = [xx / across, xy / across, xz / across];
  const [yx, yy, yz] = [zy * xz - zz * xy, zz * xx - zx * xz, zx * xy - zy * xx];
  e[0] = xx * radius;
  e[1] = xy * radius;
  e[2] = xz * radius;
  e[3] = 0;
  e[4] = yx * radius;
  e[5] = yy * radius;
  e[6] = yz * radius;
  e[7] = 0;
  e[8] = dx;
  e[9] = dy;
  e[10] = dz;
  e[11] = 0;
  e[12] = (points[a]! + points[b]!) / 2;
  e[13] = (points[a + 1]! + points[b + 1]!) / 2;
  e[14] = (points[a + 2]! + points[b + 2]!) / 2;
  e[15] = 1;
}
