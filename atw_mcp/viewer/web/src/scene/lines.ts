// Straight lines a few pixels wide, all of one kind in a single draw call.
import {
  type Color,
  DoubleSide,
  DynamicDrawUsage,
  InstancedBufferAttribute,
  InstancedBufferGeometry,
  BufferAttribute,
  Mesh,
  ShaderMaterial,
} from "three";
import { viewportOf } from "./looks";

const vertexShader = `
  attribute vec3 start;
  attribute vec3 end;
  attribute vec2 when;
  attribute vec4 ink; // colour, and width in pixels
  uniform vec2 buffer;
  uniform float ratio;
  varying vec3 color;
  varying float moment;
  varying float across;
  varying float along;
  void main() {
    vec4 a = modelViewMatrix * vec4(start, 1.0);
    vec4 b = modelViewMatrix * vec4(end, 1.0);
    // what lies behind a perspective eye has no place on the screen: cut there
    if (projectionMatrix[2][3] == -1.0) {
      float near = 0.5 * projectionMatrix[3][2] / projectionMatrix[2][2]; // half the near plane's distance
      float cut = -abs(near);
      if (a.z > cut && b.z <= cut) a = mix(b, a, (cut - b.z) / (a.z - b.z));
      else if (b.z > cut && a.z <= cut) b = mix(a, b, (cut - a.z) / (b.z - a.z));
    }
    vec4 from = projectionMatrix * a;
    vec4 to = projectionMatrix * b;
    vec2 way = (to.xy / to.w - from.xy / from.w) * buffer;
    float span = length(way);
    way = span > 1e-6 ? way / span : vec2(1.0, 0.0);
    float width = ink.w * ratio;
    vec4 here = position.y > 0.5 ? to : from;
    vec2 aside = vec2(-way.y, way.x) * position.x * (width + 1.0);
    vec2 beyond = way * (position.y - 0.5) * width;
    here.xy += (aside + beyond) / buffer * here.w;
    gl_Position = here;
    color = ink.rgb;
    moment = mix(when.x, when.y, position.y);
    across = position.x * (width + 1.0) / max(width, 1.0);
    along = span * position.y * 0.5 / ratio;
  }`;

const fragmentShader = `
  uniform float now;
  uniform float opacity;
  uniform float future;
  uniform float dash;
  varying vec3 color;
  varying float moment;
  varying float across;
  varying float along;
  void main() {
    float alpha = opacity * (moment > now ? future : 1.0);
    if (dash > 0.0 && fract(along / dash) > 0.55) discard;
    float w = max(fwidth(across), 1e-6);
    alpha *= 1.0 - smoothstep(1.0 - w, 1.0 + w, abs(across));
    if (alpha < 0.01) discard;
    gl_FragColor = vec4(color, alpha);
    #include <colorspace_fragment>
  }`;

export interface LineLook {
  opacity?: number;
  /** Opacity of what is later than `now`, as a part of that of the rest. */
  future?: number;
  /** Length of a dash with its gap [px]; 0: solid. */
  dash?: number;
  /** Drawn over what hides it. */
  over?: boolean;
}

/** Room for `capacity` lines. */
export class Lines {
  readonly object: Mesh;
  count = 0;
  private readonly geometry = new InstancedBufferGeometry();
  private readonly ends: [InstancedBufferAttribute, InstancedBufferAttribute];
  private readonly when: InstancedBufferAttribute;
  private readonly ink: InstancedBufferAttribute;
  private readonly material: ShaderMaterial;

  constructor(capacity: number, look: LineLook = {}) {
    const attribute = (size: number) => {
      const made = new InstancedBufferAttribute(new Float32Array(size * capacity), size);
      made.setUsage(DynamicDrawUsage);
      return made;
    };
    this.ends = [attribute(3), attribute(3)];
    this.when = attribute(2);
    this.ink = attribute(4);
    this.geometry.setAttribute("position", new BufferAttribute(new Float32Array([-1, 0, 0, 1, 0, 0, 1, 1, 0, -1, 1, 0]), 3));
    this.geometry.setIndex([0, 1, 2, 0, 2, 3]);
    this.geometry.setAttribute("start", this.ends[0]);
    this.geometry.setAttribute("end", this.ends[1]);
    this.geometry.setAttribute("when", this.when);
    this.geometry.setAttribute("ink", this.ink);
    this.material = new ShaderMaterial({
      vertexShader,
      fragmentShader,
      uniforms: {
        buffer: { value: [1, 1] },
        ratio: { value: 1 },
        now: { value: Infinity },
        opacity: { value: look.opacity ?? 1 },
        future: { value: look.future ?? 1 },
        dash: { value: look.dash ?? 0 },
      },
      transparent: true,
      depthWrite: false,
      depthTest: !look.over,
      side: DoubleSide, // either end may lie to the left
    });
    this.object = new Mesh(this.geometry, this.material);
    this.object.frustumCulled = false;
    this.object.renderOrder = look.over ? 3 : 2;
    this.object.raycast = () => {};
    this.object.onBeforeRender = (renderer) => {
      const size = viewportOf(renderer);
      const uniforms = this.material.uniforms;
      uniforms.buffer!.value = [size.z, size.w];
      uniforms.ratio!.value = renderer.getPixelRatio();
    };
    this.clear();
  }

  clear(): void {
    this.count = 0;
    this.geometry.instanceCount = 0;
  }

  /** Add a line from `a` to `b`, each three numbers from the index on [m]; width [px]; times of both ends [s]. */
  add(
    a: ArrayLike<number>,
    at: number,
    b: ArrayLike<number>,
    bt: number,
    color: Color,
    width: number,
    from = 0,
    to = from,
  ): void {
    const i = this.count;
    if (3 * i >= this.ends[0].array.length) return;
    for (let k = 0; k < 3; k++) {
      this.ends[0].array[3 * i + k] = a[at + k]!;
      this.ends[1].array[3 * i + k] = b[bt + k]!;
    }
    this.when.array[2 * i] = from;
    this.when.array[2 * i + 1] = to;
    this.ink.setXYZW(i, color.r, color.g, color.b, width);
    this.count = i + 1;
  }

  /** Hand what was added to the GPU. */
  done(): void {
    this.geometry.instanceCount = this.count;
    for (const attribute of [...this.ends, this.when, this.ink]) attribute.needsUpdate = true;
  }

  set now(t: number) {
    this.material.uniforms.now!.value = t;
  }
}
