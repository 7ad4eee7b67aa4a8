// A surface of triangles whose corners move: cloth, seen from both sides, or the skin of a soft object.
import { BufferAttribute, BufferGeometry, DynamicDrawUsage, Group, Mesh } from "three";
import { surface, type Style } from "./looks";
import type { Deformable } from "./rope";

/** Checks along the longer side. */
const CLOTH_CHECKS = 12;
const SOFT_CHECKS = 5;

/** triangles (t, 3). first (k, 3): points at the start [m], to which the pattern is fixed. */
export function sheet(
  color: string,
  triangles: ArrayLike<number>,
  first: Float32Array,
  closed: boolean,
  style: Style,
): Deformable {
  const count = first.length / 3;
  const { rest, size } = pattern(first, closed);
  const geometry = new BufferGeometry();
  const position = new BufferAttribute(new Float32Array(first), 3).setUsage(DynamicDrawUsage);
  const normal = new BufferAttribute(new Float32Array(3 * count), 3).setUsage(DynamicDrawUsage);
  const index = Uint32Array.from(triangles);
  geometry.setAttribute("position", position);
  geometry.setAttribute("normal", normal);
  geometry.setAttribute("rest", new BufferAttribute(rest, 3));
  geometry.setIndex(new BufferAttribute(index, 1));
  const cell = Math.max(size / (closed ? SOFT_CHECKS : CLOTH_CHECKS), 1e-6);
  const mesh = new Mesh(geometry, surface(color, { style, pattern: "checks", cell, twoSided: !closed }));
  mesh.frustumCulled = false;
  const object = new Group();
  object.add(mesh);
  return {
    object,
    setPoints(points) {
      position.array.set(points);
      normals(points, index, normal.array as Float32Array);
      position.needsUpdate = true;
      normal.needsUpdate = true;
      geometry.boundingSphere = null;
    },
  };
}

/** Coordinates (k, 3) that checks are drawn in: those at the start, of cloth without the shortest of the three. */
function pattern(first: Float32Array, closed: boolean): { rest: Float32Array; size: number } {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < first.length; i++) {
    low[i % 3] = Math.min(low[i % 3]!, first[i]!);
    high[i % 3] = Math.max(high[i % 3]!, first[i]!);
  }
  const span = high.map((h, k) => h - low[k]!);
  const order = [0, 1, 2].sort((a, b) => span[b]! - span[a]!);
  const rest = new Float32Array(first.length);
  for (let i = 0; i < first.length; i += 3) {
    for (let k = 0; k < 3; k++) {
      const axis = closed ? k : order[k]!;
      if (closed || k < 2) rest[i + k] = first[i + axis]! - low[axis]!;
    }
  }
  return { rest, size: Math.max(...span.filter(Number.isFinite), 0) };
}

/** Normals (k, 3) at the corners, each triangle weighted with its area. */
export function normals(points: Float32Array, index: Uint32Array, out: Float32Array): void {
  out.fill(0);
  for (let i = 0; i < index.length; i += 3) {
    const a = 3 * index[i]!;
    const b = 3 * index[i + 1]!;
    const c = 3 * index[i + 2]!;
    const ux = points[b]! - points[a]!;
    const uy = points[b + 1]! - points[a + 1]!;
    const uz = points[b + 2]! - points[a + 2]!;
    const vx = points[c]! - points[a]!;
    const vy = points[c + 1]! - points[a + 1]!;
    const vz = points[c + 2]! - points[a + 2]!;
    const nx = uy * vz - uz * vy;
    const ny = uz * vx - ux * vz;
    const nz = ux * vy - uy * vx;
    for (const corner of [a, b, c]) {
      out[corner] = out[corner]! + nx;
      out[corner + 1] = out[corner + 1]! + ny;
      out[corner + 2] = out[corner + 2]! + nz;
    }
  }
  for (let i = 0; i < out.length; i += 3) {
    const length = Math.hypot(out[i]!, out[i + 1]!, out[i + 2]!) || 1;
    out[i] = out[i]! / length;
    out[i + 1] = out[i + 1]! / length;
    out[i + 2] = out[i + 2]! / length;
  }
}
