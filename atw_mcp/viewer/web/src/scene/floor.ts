// Floors and other half spaces: a surface with a grid of metres that fades out, and takes shadows.
import { Color, Mesh, MeshLambertMaterial, PlaneGeometry, Quaternion, Vector3 } from "three";

export interface FloorColors {
  surface: Color;
  line: Color;
}

/** A round length near a tenth of `size` [m]: 1, 2 or 5 times a power of ten. */
export function roundLength(size: number): number {
  const power = 10 ** Math.floor(Math.log10(Math.max(size, 1e-9)));
  const first = size / power;
  return (first < 2 ? 1 : first < 5 ? 2 : 5) * power;
}

/**
 * normal: a unit vector. offset: normal · p on the surface [m]. centre: where the grid is clearest, reach: where it has
 * faded [m]. cell: side of a square of the grid [m]; every fifth line is stronger.
 */
export function floorMesh(
  normal: Vector3,
  offset: number,
  centre: Vector3,
  reach: number,
  cell: number,
  colors: FloorColors,
  /** Of the surface; lines are always drawn. */
  opacity = 1,
): Mesh {
  const material = new MeshLambertMaterial({ color: colors.surface, transparent: true, depthWrite: opacity === 1 });
  const line = { value: colors.line };
  const middle = { value: centre };
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, { line, middle, cell: { value: cell }, reach: { value: reach }, body: { value: opacity } });
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", "#include <common>\nvarying vec3 place;\nvarying vec2 sheet;")
      .replace(
        "#include <begin_vertex>",
        "#include <begin_vertex>\nplace = (modelMatrix * vec4(position, 1.0)).xyz;\nsheet = uv;",
      );
    shader.fragmentShader = shader.fragmentShader
      .replace(
        "#include <common>",
        `#include <common>
        varying vec3 place;
        varying vec2 sheet;
        uniform vec3 line;
        uniform vec3 middle;
        uniform float cell;
        uniform float reach;
        uniform float body;
        float lines(vec2 at, float side, float width) {
          vec2 w = fwidth(at / side);
          vec2 gap = abs(fract(at / side - 0.5) - 0.5) / max(w, 1e-6);
          vec2 cover = 1.0 - smoothstep(width - 0.5, width + 0.5, gap);
          cover *= 1.0 - smoothstep(0.15, 0.45, w); // too far away to be distinct
          return max(cover.x, cover.y);
        }`,
      )
      .replace(
        "#include <color_fragment>",
        `#include <color_fragment>
        float grid = max(0.55 * lines(sheet, cell, 0.6), lines(sheet, 5.0 * cell, 1.0));
        float far = length(place - middle) / reach;
        float fade = 1.0 - smoothstep(0.45, 1.0, far);
        diffuseColor.rgb = mix(diffuseColor.rgb, line, grid);
        diffuseColor.a = fade * max(body, grid);`,
      );
  };
  const geometry = new PlaneGeometry(2 * reach, 2 * reach);
  // multiples of the cell from the world's origin
  const turn = new Quaternion().setFromUnitVectors(new Vector3(0, 0, 1), normal);
  const foot = centre.clone().addScaledVector(normal, offset - centre.dot(normal));
  const local = foot.clone().applyQuaternion(turn.clone().invert());
  const uv = geometry.attributes.uv!;
  const position = geometry.attributes.position!;
  for (let i = 0; i < uv.count; i++) uv.setXY(i, position.getX(i) + local.x, position.getY(i) + local.y);
  const mesh = new Mesh(geometry, material);
  mesh.quaternion.copy(turn);
  mesh.position.copy(foot);
  mesh.receiveShadow = true;
  mesh.renderOrder = -1;
  mesh.raycast = () => {};
  return mesh;
}
