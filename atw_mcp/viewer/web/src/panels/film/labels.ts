// Which object of a simulated world is seen at each pixel of the video, what hides it taken into account.
import {
  Camera,
  Color,
  InstancedMesh,
  Mesh,
  MeshBasicMaterial,
  NearestFilter,
  Object3D,
  Points,
  Scene,
  ShaderMaterial,
  WebGLRenderer,
  WebGLRenderTarget,
  type Material,
} from "three";
import type { RolloutView, WorldView } from "../../document";
import { buildWorld, type WorldMeshes } from "../../scene/world_meshes";
import type { Opened } from "../../unpack";
import { Pinhole, type Motion } from "./pinhole";
import { trace, type Loop } from "./trace";

/** Longest side of the picture of labels [px]: an outline is good to half of one of its pixels. */
const LONGEST = 800;
/** Times whose outlines are kept: a loop over a video is then drawn without tracing it again. */
export const KEPT = 600;
/** Labels are bytes; 0 is everything that does not move. */
const MOST = 255;

export interface SeenObject {
  name: string;
  /** Curves in pixels of the frame; inner ones too. */
  path: Path2D;
  box: [number, number, number, number];
}

/** Draws labels for all worlds of a page with one context. */
export class Labeller {
  readonly width: number;
  readonly height: number;
  private readonly renderer: WebGLRenderer;
  private readonly target: WebGLRenderTarget;
  private readonly pixels: Uint8Array;

  /** Frames are of width x height [px]. Throws where the browser has no WebGL. */
  constructor(
    private readonly frameWidth: number,
    frameHeight: number,
  ) {
    const scale = LONGEST / Math.max(frameWidth, frameHeight);
    this.width = Math.round(frameWidth * scale);
    this.height = Math.round(frameHeight * scale);
    this.renderer = new WebGLRenderer({ canvas: document.createElement("canvas"), antialias: false });
    this.target = new WebGLRenderTarget(this.width, this.height, { minFilter: NearestFilter, magFilter: NearestFilter });
    this.pixels = new Uint8Array(4 * this.width * this.height);
  }

  /** Labels (height, width), rows from the top; read without holding up the page. */
  async draw(scene: Scene, camera: Camera): Promise<Uint8Array> {
    this.renderer.setRenderTarget(this.target);
    this.renderer.setClearColor(0x000000, 0);
    this.renderer.clear();
    this.renderer.render(scene, camera);
    await this.renderer.readRenderTargetPixelsAsync(this.target, 0, 0, this.width, this.height, this.pixels);
    const labels = new Uint8Array(this.width * this.height);
    for (let y = 0; y < this.height; y++) {
      const from = 4 * (this.height - 1 - y) * this.width;
      const to = y * this.width;
      for (let x = 0; x < this.width; x++) labels[to + x] = this.pixels[from + 4 * x]!;
    }
    return labels;
  }

  /** Pixels of a picture of labels in a pixel of the frame. */
  get scale(): number {
    return this.width / this.frameWidth;
  }

  dispose(): void {
    this.target.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }
}

/** The outlines of one rollout in the video's camera. */
export class SimulatedOutlines {
  private readonly meshes: WorldMeshes;
  private readonly scene = new Scene();
  private readonly camera = new Camera();
  private readonly names: string[] = [];
  private readonly farthest: number;
  private readonly known = new Map<number, SeenObject[]>();

  constructor(
    private readonly labeller: Labeller,
    opened: Opened,
    private readonly world: WorldView,
    rollout: RolloutView,
  ) {
    this.meshes = buildWorld(opened, world, rollout);
    const moving = rollout.names.slice(0, MOST);
    for (const [name, object] of this.meshes.byName) {
      const label = moving.indexOf(name) + 1;
      if (label > 0) this.names[label] = name;
      object.traverse((part) => flatten(part, label));
    }
    this.scene.add(this.meshes.group);
    const eye = new Pinhole(world.camera!);
    const positions = opened.floats(rollout.positions);
    this.farthest = 1e-3;
    for (let i = 0; i < positions.length; i += 3) {
      const depth = eye.depth(positions[i]!, positions[i + 1]!, positions[i + 2]!);
      if (depth > this.farthest) this.farthest = depth;
    }
  }

  /** What is seen at `t` [s], where that was made. */
  at(t: number): SeenObject[] | null {
    return this.known.get(t) ?? null;
  }

  /** Make what is seen at `t`, once; motion: how the camera has moved by then since the first frame. */
  async make(t: number, motion?: Motion): Promise<void> {
    if (this.known.has(t)) return;
    this.meshes.setTime(t);
    new Pinhole(this.world.camera!, motion).aim(this.camera, this.farthest);
    const labels = await this.labeller.draw(this.scene, this.camera);
    const seen = [...trace(labels, this.labeller.width, this.labeller.height)].map(([label, loops]) =>
      drawn(this.names[label] ?? "", loops, this.labeller.scale),
    );
    if (this.known.size >= KEPT) this.known.clear();
    this.known.set(t, seen);
  }

  dispose(): void {
    this.meshes.dispose();
  }
}

function drawn(name: string, loops: Loop[], scale: number): SeenObject {
  const path = new Path2D();
  const box: SeenObject["box"] = [Infinity, Infinity, -Infinity, -Infinity];
  for (const loop of loops) {
    for (let i = 0; i < loop.length; i += 2) {
      const u = (loop[i]! + 0.5) / scale - 0.5;
      const v = (loop[i + 1]! + 0.5) / scale - 0.5;
      if (i === 0) path.moveTo(u, v);
      else path.lineTo(u, v);
      box[0] = Math.min(box[0], u);
      box[1] = Math.min(box[1], v);
      box[2] = Math.max(box[2], u);
      box[3] = Math.max(box[3], v);
    }
    path.closePath();
  }
  return { name, path, box };
}

/** Give a part of a scene the colour of its label and nothing else: no light, no pattern; lines are hidden. */
function flatten(part: Object3D, label: number): void {
  if (part instanceof Mesh || part instanceof Points) {
    const material = part.material as Material;
    const color = new Color().setRGB(label / MOST, 0, 0); // linear, as the target is
    if (material instanceof ShaderMaterial) {
      // particles: their own shaders give them their size and depth
      part.material = new ShaderMaterial({
        vertexShader: material.vertexShader,
        fragmentShader: material.fragmentShader
          .replace(/gl_FragColor\s*=[^;]*;/, "gl_FragColor = vec4(color, 1.0);")
          .replace("#include <colorspace_fragment>", ""),
        uniforms: { ...material.uniforms, color: { value: color } },
      });
      part.material.userData = material.userData;
    } else {
      part.material = new MeshBasicMaterial({ color, side: material.side, toneMapped: false });
    }
    if (part instanceof InstancedMesh) part.instanceColor = null;
    material.dispose();
  } else if (part.type.startsWith("Line")) part.visible = false;
}
