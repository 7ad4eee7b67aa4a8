// Materials: a body's colour with a faint pattern that turns with it, and thin lines that never fade below a pixel or two.
import {
  type BufferGeometry,
  type Camera,
  DoubleSide,
  MeshStandardMaterial,
  type Object3D,
  Vector4,
  type WebGLRenderer,
} from "three";

export type Style = "solid" | "ghost";

/** How much of a ghost covers what is behind it. */
const GHOST = 0.3;
/** Brightness of the darker fields of a pattern. */
const FAINT = 0.84;
/** Least radius of a rope's line, in pixels of the drawing buffer. */
const LEAST_RADIUS = 1.3;

export interface Look {
  style: Style;
  /** Where the pattern comes from: the octants of body axes, checks of the attribute `rest`, or none. */
  pattern: "octants" | "checks" | "none";
  /** Side of a check [m]. */
  cell?: number;
  twoSided?: boolean;
  /** Radius [m] of a unit tube or ball, which then never gets thinner than a few pixels. */
  thin?: number;
}

export function surface(color: string, look: Look): MeshStandardMaterial {
  const ghost = look.style === "ghost";
  const material = new MeshStandardMaterial({
    color,
    roughness: 0.62,
    metalness: 0,
    transparent: ghost,
    opacity: ghost ? GHOST : 1,
    depthWrite: !ghost,
  });
  if (look.twoSided) material.side = DoubleSide;
  const height = { value: 600 };
  material.userData = { height };
  material.onBeforeCompile = (shader) => {
    shader.uniforms.bufferHeight = height;
    if (look.pattern !== "none") {
      const declared = look.pattern === "checks" ? "attribute vec3 rest;\n" : "";
      const source = look.pattern === "checks" ? "rest" : "position";
      const wave =
        look.pattern === "checks"
          ? `sin(vRest.x * ${pi(look.cell)}) * sin(vRest.y * ${pi(look.cell)}) * cos(vRest.z * ${pi(look.cell)})`
          : "vRest.x * vRest.y * vRest.z";
      shader.vertexShader = shader.vertexShader
        .replace("#include <common>", `#include <common>\n${declared}varying vec3 vRest;`)
        .replace("#include <begin_vertex>", `#include <begin_vertex>\nvRest = ${source};`);
      shader.fragmentShader = shader.fragmentShader
        .replace("#include <common>", "#include <common>\nvarying vec3 vRest;")
        .replace(
          "#include <color_fragment>",
          `#include <color_fragment>
          float wave = ${wave};
          float soft = max(fwidth(wave), 1e-12);
          diffuseColor.rgb *= mix(${FAINT.toFixed(2)}, 1.0, smoothstep(-soft, soft, wave));`,
        );
    }
    if (look.thin !== undefined) {
      shader.vertexShader = shader.vertexShader
        .replace("#include <common>", "#include <common>\nuniform float bufferHeight;")
        .replace(
          "#include <begin_vertex>",
          `#include <begin_vertex>
          #ifdef USE_INSTANCING
          vec4 centre = projectionMatrix * modelViewMatrix * instanceMatrix * vec4(0.0, 0.0, 0.0, 1.0);
          float pixel = 2.0 * centre.w / (projectionMatrix[1][1] * bufferHeight);
          float wider = max(1.0, ${LEAST_RADIUS.toFixed(2)} * pixel / ${Math.max(look.thin, 1e-9).toExponential(6)});
          transformed.xy *= wider;
          if (length(instanceMatrix[2].xyz) < 1.001 * length(instanceMatrix[0].xyz)) transformed.z *= wider;
          #endif`,
        );
    }
  };
  material.customProgramCacheKey = () => JSON.stringify([look.pattern, look.cell ?? 0, look.thin ?? 0]);
  return material;
}

const viewport = new Vector4();
/** Let a material that counts in pixels know the height of what it is drawn to. */
export function measured(thing: Object3D): void {
  thing.onBeforeRender = (renderer: WebGLRenderer, _scene: Object3D, _camera: Camera, _geometry: BufferGeometry, material) => {
    const height = material.userData.height as { value: number } | undefined;
    if (height) height.value = viewportOf(renderer).w;
  };
}

/** The part of the drawing buffer that is drawn to, in its own pixels: width in z, height in w. */
export function viewportOf(renderer: WebGLRenderer): Vector4 {
  return renderer.getCurrentViewport(viewport);
}

const pi = (cell = 1) => (Math.PI / cell).toExponential(8);
