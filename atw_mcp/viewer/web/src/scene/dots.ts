// Discs and rings of a size in pixels: joints, and events that flash.
import { BufferAttribute, BufferGeometry, type Color, DynamicDrawUsage, Points, ShaderMaterial } from "three";

const vertexShader = `
  attribute vec4 ink; // colour, opacity
  attribute vec2 form; // diameter [px], thickness of the ring as a part of the radius; 1: a disc
  uniform float ratio;
  varying vec4 color;
  varying float thickness;
  varying float size;
  void main() {
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
    size = form.x * ratio + 2.0;
    gl_PointSize = size;
    color = ink;
    thickness = form.y;
  }`;

const fragmentShader = `
  uniform vec3 rim;
  varying vec4 color;
  varying float thickness;
  varying float size;
  void main() {
    float r = 2.0 * length(gl_PointCoord - 0.5);
    float w = 3.0 / size;
    float alpha = color.a * (1.0 - smoothstep(1.0 - w, 1.0, r));
    if (thickness < 1.0) alpha *= smoothstep(1.0 - thickness - w, 1.0 - thickness, r);
    if (alpha < 0.01) discard;
    float edge = thickness < 1.0 ? 0.0 : smoothstep(0.55, 0.55 + w, r);
    gl_FragColor = vec4(mix(color.rgb, rim, edge), alpha);
    #include <colorspace_fragment>
  }`;

/** Room for `capacity` dots, drawn over what hides them. */
export class Dots {
  readonly object: Points;
  private count = 0;
  private readonly geometry = new BufferGeometry();
  private readonly places: BufferAttribute;
  private readonly ink: BufferAttribute;
  private readonly form: BufferAttribute;

  /** rim: colour around discs. */
  constructor(capacity: number, rim: Color) {
    const attribute = (size: number) => new BufferAttribute(new Float32Array(size * capacity), size).setUsage(DynamicDrawUsage);
    this.places = attribute(3);
    this.ink = attribute(4);
    this.form = attribute(2);
    this.geometry.setAttribute("position", this.places);
    this.geometry.setAttribute("ink", this.ink);
    this.geometry.setAttribute("form", this.form);
    const material = new ShaderMaterial({
      vertexShader,
      fragmentShader,
      uniforms: { ratio: { value: 1 }, rim: { value: rim } },
      transparent: true,
      depthTest: false,
      depthWrite: false,
    });
    this.object = new Points(this.geometry, material);
    this.object.frustumCulled = false;
    this.object.renderOrder = 4;
    this.object.raycast = () => {};
    this.object.onBeforeRender = (renderer) => {
      material.uniforms.ratio!.value = renderer.getPixelRatio();
    };
    this.done();
  }

  clear(): void {
    this.count = 0;
  }

  /** `thickness`: of a ring, as a part of its radius; 1: a disc. */
  add(x: number, y: number, z: number, color: Color, diameter: number, opacity = 1, thickness = 1): void {
    const i = this.count;
    if (i >= this.places.count) return;
    this.places.setXYZ(i, x, y, z);
    this.ink.setXYZW(i, color.r, color.g, color.b, opacity);
    this.form.setXY(i, diameter, thickness);
    this.count = i + 1;
  }

  done(): void {
    this.geometry.setDrawRange(0, this.count);
    for (const attribute of [this.places, this.ink, this.form]) attribute.needsUpdate = true;
  }
}
