// Particles of a fluid: a ball each, drawn as a square of pixels that is shaded and has the depth of a ball.
import { BufferAttribute, BufferGeometry, Color, DynamicDrawUsage, Group, Points, ShaderMaterial } from "three";
import { measured, type Style } from "./looks";
import type { Deformable } from "./rope";

const vertexShader = `
  uniform float radius;
  uniform float bufferHeight;
  varying vec3 centre;
  varying float drawn;
  void main() {
    vec4 view = modelViewMatrix * vec4(position, 1.0);
    centre = view.xyz;
    gl_Position = projectionMatrix * view;
    float pixels = radius * projectionMatrix[1][1] * bufferHeight / gl_Position.w;
    gl_PointSize = max(pixels, 2.0); // a particle never vanishes
    drawn = radius * gl_PointSize / pixels;
  }`;

const fragmentShader = `
  uniform vec3 color;
  uniform float opacity;
  uniform mat4 projectionMatrix;
  varying vec3 centre;
  varying float drawn;
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
    gl_FragColor = vec4(color * light * edge + shine, opacity);
    #include <colorspace_fragment>
  }`;

/** count: particles there is room for. radius of one [m]. */
export function fluid(color: string, radius: number, count: number, style: Style): Deformable {
  const geometry = new BufferGeometry();
  const position = new BufferAttribute(new Float32Array(3 * count), 3).setUsage(DynamicDrawUsage);
  geometry.setAttribute("position", position);
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
    setPoints(points) {
      const out = position.array;
      let there = 0;
      for (let i = 0; i < points.length; i += 3) {
        const x = points[i]!;
        if (x !== x) continue; // NaN: not emitted yet, or drained
        out[there] = x;
        out[there + 1] = points[i + 1]!;
        out[there + 2] = points[i + 2]!;
        there += 3;
      }
      geometry.setDrawRange(0, there / 3);
      position.clearUpdateRanges();
      position.addUpdateRange(0, there);
      position.needsUpdate = true;
      geometry.boundingSphere = null;
    },
  };
}
