// The outline of the chosen object: its back faces, a few pixels larger, in the colour of what is chosen.
import {
  BackSide,
  type BufferAttribute,
  BufferGeometry,
  type Color,
  Float32BufferAttribute,
  Mesh,
  type Object3D,
  ShaderMaterial,
} from "three";
import { viewportOf } from "./looks";

/** Thickness [px]. */
const THICK = 3;

const vertexShader = `
  #ifdef SMOOTH
  #define outward normal
  #else
  attribute vec3 outward;
  #endif
  uniform vec2 buffer;
  uniform float thick;
  void main() {
    vec4 here = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
    vec4 there = projectionMatrix * modelViewMatrix * vec4(position + 1e-3 * outward, 1.0);
    vec2 way = (there.xy / there.w - here.xy / here.w) * buffer;
    float size = length(way);
    if (size > 1e-9) here.xy += way / size * 2.0 * thick / buffer * here.w;
    gl_Position = here;
  }`;
const fragmentShader = `
  uniform vec3 ink;
  void main() {
    gl_FragColor = vec4(ink, 1.0);
    #include <colorspace_fragment>
  }`;

/** An outline to be added below a mesh. smooth: a closed surface whose corners move, and whose normals are shared. */
export function outline(mesh: Mesh, color: Color, smooth: boolean): Object3D {
  if (smooth) return hullOf(mesh.geometry, color, true);
  const source = mesh.geometry.index ? mesh.geometry.toNonIndexed() : mesh.geometry;
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", source.attributes.position!);
  geometry.setAttribute("outward", new Float32BufferAttribute(outwards(source.attributes.position as BufferAttribute), 3));
  return hullOf(geometry, color, false);
}

function hullOf(geometry: BufferGeometry, color: Color, smooth: boolean): Object3D {
  const material = new ShaderMaterial({
    defines: smooth ? { SMOOTH: "" } : {},
    vertexShader,
    fragmentShader,
    side: BackSide,
    uniforms: { ink: { value: color }, buffer: { value: [1, 1] }, thick: { value: THICK } },
  });
  const hull = new Mesh(geometry, material);
  hull.raycast = () => {};
  hull.frustumCulled = false;
  hull.onBeforeRender = (renderer) => {
    const size = viewportOf(renderer);
    material.uniforms.buffer!.value = [size.z, size.w];
    material.uniforms.thick!.value = THICK * renderer.getPixelRatio();
  };
  return hull;
}

/** Unit vectors out of the surface, the same for all corners of triangles at one place, so that edges stay closed. */
function outwards(position: BufferAttribute): Float32Array {
  const sums = new Map<string, [number, number, number]>();
  const keys: string[] = [];
  let size = 0;
  for (const x of position.array) size = Math.max(size, Math.abs(x));
  const round = (x: number) => Math.round((1e5 * x) / (size || 1));
  for (let i = 0; i < position.count; i++) {
    keys.push([position.getX(i), position.getY(i), position.getZ(i)].map(round).join());
  }
  for (let i = 0; i < position.count; i += 3) {
    const [ax, ay, az] = [position.getX(i), position.getY(i), position.getZ(i)];
    const [ux, uy, uz] = [position.getX(i + 1) - ax, position.getY(i + 1) - ay, position.getZ(i + 1) - az];
    const [vx, vy, vz] = [position.getX(i + 2) - ax, position.getY(i + 2) - ay, position.getZ(i + 2) - az];
    const normal = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx] as const;
    for (let k = 0; k < 3; k++) {
      const sum = sums.get(keys[i + k]!) ?? [0, 0, 0];
      sums.set(keys[i + k]!, [sum[0] + normal[0], sum[1] + normal[1], sum[2] + normal[2]]);
    }
  }
  const out = new Float32Array(3 * position.count);
  keys.forEach((key, i) => {
    const [x, y, z] = sums.get(key)!;
    const length = Math.hypot(x, y, z) || 1;
    out.set([x / length, y / length, z / length], 3 * i);
  });
  return out;
}
