// Particles of a fluid: a ball each, drawn as a square of pixels that is shaded and has the depth of a ball.
import { BufferAttribute, BufferGeometry, Color, DynamicDrawUsage, Group, Points, ShaderMaterial } from "three";
import { measured, type Style } from "./looks";
import type { Deformable } from "./rope";

const vertexShader = `
  uniform float radius;
  uniform float bufferHeight;
  attribute float speed;
  varying float fast;
  varying vec3 centre;
  varying float drawn;
  void main() {
    vec4 view = modelViewMatrix * vec4(position, 1.0);
    centre = view.xyz;
    gl_Position = projectionMatrix * view;
    float pixels = radius * projectionMatrix[1][1] * bufferHeight / gl_Position.w;
    gl_PointSize = max(pixels, 2.0); // a particle never vanishes
    drawn = radius * gl_PointSize / pixels;
    fast = speed;
  }`;

const fragmentShader = `
  uniform vec3 color;
  uniform float opacity;
  uniform mat4 projectionMatrix;
  varying vec3 centre;
  varying float drawn;
  varying float fast;
  void main() {
    vec2 at = vec2(2.0, -2.0) * (gl_PointCoord - 0.5);
    float inside = 1.0 - dot(at, at);
    if (inside < 0.0) discard;
    vec3 normal = vec3(at, sqrt(inside));
    vec4 clip = projectionMatrix * vec4(centre + drawn * normal, 1.0);
    gl_FragDepth = 0.5 + 0.5 * clip.z / clip.w;
    float light = 0.55 + 0.45 * max(dot(normal, normalize(vec3(0.25, 0.7, 0.65))), 0.0);
    float edge = 0.75 + 0.25 * normal.z;
    float shine = 0.35 * pow(max(dot(normal, normalize(vec3(0.2, 0.45, 0.87))), 0.0), 40.0);
    vec3 foam = mix(color, vec3(0.5, 0.82, 1.0), 0.8 * smoothstep(0.0, 1.0, fast));
    gl_FragColor = vec4(foam * light * edge + shine, opacity);
    #include <colorspace_fragment>
  }`;

/** count: particles there is room for. radius of one [m]. fastest: speed of the lightest [m/s]. */
export function fluid(color: string, radius: number, count: number, fastest: number, style: Style): Deformable {
  const geometry = new BufferGeometry();
  const position = new BufferAttribute(new Float32Array(3 * count), 3).setUsage(DynamicDrawUsage);
  const speed = new BufferAttribute(new Float32Array(count), 1).setUsage(DynamicDrawUsage);
  geometry.setAttribute("position", position);
  geometry.setAttribute("speed", speed);
  const height = { value: 600 };
  const ghost = style === "ghost";
  const material = new ShaderMaterial({
    vertexShader,
    fragmentShader,
    uniforms: {
      color: { value: new Color(color) },
      radius: { value: ghost ? 0.5 * radius : radius },
      opacity: { value: ghost ? 0.3 : 1 },
      bufferHeight: height,
    },
    transparent: ghost,
    depthWrite: !ghost,
  });
  material.userData = { height };
  const cloud = new Points(geometry, material);
  cloud.frustumCulled = false;
  measured(cloud);
  const object = new Group();
  object.add(cloud);
  return {
    object,
    setPoints(points, { values, a, b, seconds }) {
      const out = position.array;
      const rate = seconds > 0 && fastest > 0 ? 1 / (seconds * fastest) : 0;
      let there = 0;
      for (let i = 0; i < points.length; i += 3) {
        const x = points[i]!;
        if (x !== x) continue; // NaN: not emitted yet, or drained
        out[there] = x;
        out[there + 1] = points[i + 1]!;
        out[there + 2] = points[i + 2]!;
        const dx = values[b + i]! - values[a + i]!;
        const dy = values[b + i + 1]! - values[a + i + 1]!;
        const dz = values[b + i + 2]! - values[a + i + 2]!;
        const moved = Math.sqrt(dx * dx + dy * dy + dz * dz);
        speed.array[there / 3] = moved === moved ? rate * moved : 0;
        there += 3;
      }
      geometry.setDrawRange(0, there / 3);
      position.clearUpdateRanges();
      position.addUpdateRange(0, there);
      speed.clearUpdateRanges();
      speed.addUpdateRange(0, there / 3);
      position.needsUpdate = true;
      speed.needsUpdate = true;
      geometry.boundingSphere = null;
    },
  };
}

/** The speed that one of twenty particles exceeds, over a whole rollout [m/s]; values (T, k, 3) [m], times (T,) [s]. */
export function fastSpeed(values: Float32Array, count: number, times: Float32Array): number {
  const speeds: number[] = [];
  const stride = Math.max(1, Math.floor(count / 200));
  const step = Math.max(1, Math.floor(times.length / 40));
  for (let i = 0; i + 1 < times.length; i += step) {
    for (let k = 0; k < count; k += stride) {
      const a = 3 * (i * count + k);
      const b = a + 3 * count;
      const moved = Math.hypot(values[b]! - values[a]!, values[b + 1]! - values[a + 1]!, values[b + 2]! - values[a + 2]!);
      if (Number.isFinite(moved)) speeds.push(moved / (times[i + 1]! - times[i]!));
    }
  }
  speeds.sort((a, b) => a - b);
  return speeds[Math.floor(0.95 * speeds.length)] ?? 0;
}
