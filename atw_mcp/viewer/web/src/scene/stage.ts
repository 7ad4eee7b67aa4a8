// The canvas: one or two views of the world seen by the same eye, drawn only when something has changed.
import { type Box3, Raycaster, Vector2, Vector3, WebGLRenderer } from "three";
import type { Eye } from "../state";
import type { CameraView, RolloutView, Tracks, WorldView } from "../document";
import type { Mark } from "../events";
import type { Opened } from "../unpack";
import { extentOf, union } from "./extent";
import { Eyes } from "./eyes";
import { Labels, type Window } from "./labels";
import type { Palette } from "./palette";
import { planeNormal, planeOfMotion } from "./plane_of_motion";
import { View, type Shown } from "./view";

/** Beyond two pixels of the drawing buffer a CSS pixel nothing is gained but heat. */
const FINEST = 2;

export interface Subjects {
  opened: Opened;
  shown: { world: WorldView; rollout: RolloutView | null };
  other: { world: WorldView; rollout: RolloutView } | null;
  arrangement: "one" | "side" | "ghost";
  /** Measured positions beside it, or alone. */
  tracks: Tracks | null;
}

/** Measured for tests and for whoever wonders: `window.__atw`. */
export interface Statistics {
  /** Frames drawn since the page was opened. */
  frames: number;
  /** Draw calls of the last one. */
  calls: number;
  /** Moving everything to a time, labels included: the last one, and all together [ms]. */
  updateMs: number;
  updateTotalMs: number;
  /** Handing the last frame to WebGL [ms]; in software this includes the drawing. */
  drawMs: number;
  drawTotalMs: number;
  geometries: number;
  textures: number;
}

export interface Watcher {
  picked(name: string | null): void;
  /** After each frame: for what lies over the canvas. */
  drawn(stage: Stage): void;
}

export class Stage {
  readonly eyes: Eyes;
  readonly statistics: Statistics = {
    frames: 0,
    calls: 0,
    updateMs: 0,
    updateTotalMs: 0,
    drawMs: 0,
    drawTotalMs: 0,
    geometries: 0,
    textures: 0,
  };
  views: View[] = [];
  private readonly renderer: WebGLRenderer;
  private readonly labels: Labels;
  private readonly observer: ResizeObserver;
  private subjects: Subjects | null = null;
  private key = "";
  private palette: Palette | null = null;
  private width = 1;
  private height = 1;
  private time = 0;
  private chosen: string | null = null;
  private followed: string | null = null;
  private visible: Shown = { names: true, trails: true, joints: true, effects: true, events: true, observed: true };
  private events: [Mark[], Mark[]] = [[], []];
  private stale = true;
  private waiting = 0;

  /** Raises an error where the browser has no WebGL 2. */
  constructor(
    private readonly host: HTMLElement,
    overlay: HTMLElement,
    private readonly watcher: Watcher,
  ) {
    this.renderer = new WebGLRenderer({ antialias: true, powerPreference: "high-performance" });
    this.renderer.info.autoReset = false;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.autoUpdate = false;
    this.renderer.setScissorTest(true);
    const canvas = this.renderer.domElement;
    canvas.setAttribute("aria-hidden", "true");
    host.prepend(canvas);
    this.eyes = new Eyes(canvas, () => this.request());
    this.labels = new Labels(overlay);
    this.listen(canvas);
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(host);
    this.resize();
    (globalThis as { __atw?: Statistics }).__atw = this.statistics;
  }

  private listen(canvas: HTMLCanvasElement): void {
    let down: [number, number] | null = null;
    canvas.addEventListener("pointerdown", (e) => (down = [e.clientX, e.clientY]));
    canvas.addEventListener("pointerup", (e) => {
      // a click, not the end of a turn of the eye
      if (down && Math.hypot(e.clientX - down[0], e.clientY - down[1]) < 5) this.watcher.picked(this.pick(e));
      else this.eyes.moved = true;
      down = null;
    });
    canvas.addEventListener("wheel", () => (this.eyes.moved = true), { passive: true });
    canvas.addEventListener("webglcontextrestored", () => {
      this.stale = true; // shadows too
      this.request();
    });
  }

  /**
   * Show rollouts. The eye stays where it is, unless nothing was shown before, or the views are laid out otherwise:
   * then all that both show is fitted into view.
   */
  show(subjects: Subjects, palette: Palette): void {
    // a document is often replaced by one that says the same of what is shown here
    const key = JSON.stringify([subjects.arrangement, palette, subjects.shown, subjects.other, subjects.tracks], (name, value) =>
      name === "offset" ? undefined : (value as unknown),
    );
    if (key === this.key) return;
    this.key = key;
    const rearranged = this.subjects !== null && this.subjects.arrangement !== subjects.arrangement;
    this.subjects = subjects;
    this.palette = palette;
    for (const view of this.views) view.dispose();
    const { opened, shown, other, arrangement, tracks } = subjects;
    let extent = extentOf(opened, shown.world, shown.rollout, tracks);
    if (other) extent = union(extent, extentOf(opened, other.world, other.rollout));
    const ghost = arrangement === "ghost" ? other : null;
    this.views = [new View({ opened, ...shown, ghost, against: other, tracks, extent: extent.box }, palette)];
    if (arrangement === "side" && other) {
      this.views.push(this.second(opened, subjects, extent.box, palette));
    }
    this.resize();
    this.eyes.look({ extent: extent.box, places: extent.places, normal: planeNormal(opened, shown.world, shown.rollout), camera: shown.world.camera });
    if (rearranged) {
      this.eyes.moved = false;
      this.eyes.reset();
    }
    for (const view of this.views) view.highlight(this.chosen);
    this.mark();
    this.renderer.setClearColor(palette.background);
    this.stale = true;
    this.request();
  }

  private second(opened: Opened, { shown, other }: Subjects, extent: Box3, palette: Palette): View {
    const against = shown.rollout ? { world: shown.world, rollout: shown.rollout } : null;
    return new View({ opened, ...other!, ghost: null, against, tracks: null, extent }, palette);
  }

  setTime(t: number): void {
    this.time = t;
    this.stale = true;
    this.request();
  }

  /** Events of the rollout shown and of the other one. */
  setEvents(shown: Mark[], other: Mark[]): void {
    this.events = [shown, other];
    this.mark();
    this.stale = true;
    this.request();
  }

  private mark(): void {
    const [shown, other] = this.events;
    const ghost = this.subjects?.arrangement === "ghost" ? other.filter((m) => m.change) : [];
    this.views[0]?.setEvents([...shown, ...ghost]);
    this.views[1]?.setEvents(other);
  }

  choose(name: string | null): void {
    this.chosen = name;
    for (const view of this.views) view.highlight(name);
    this.stale = true;
    this.request();
  }

  follow(name: string | null): void {
    this.followed = name;
    this.eyes.follow(null);
    this.stale = true;
    this.request();
  }

  setShown(shown: Shown): void {
    this.visible = shown;
    this.stale = true;
    this.request();
  }

  setEye(eye: Eye): void {
    this.eyes.choose(eye);
    this.eyes.follow(null);
    this.stale = true;
    this.request();
  }

  reset(): void {
    this.eyes.moved = false;
    this.eyes.reset();
    this.eyes.follow(null);
    this.stale = true;
    this.request();
  }

  /** Part of the host that a view fills [CSS px]. */
  window(index: number): Window {
    if (this.views.length < 2) return { x: 0, y: 0, width: this.width, height: this.height };
    // side by side where there is room, else one above the other
    if (this.width >= this.height) {
      const half = Math.floor(this.width / 2);
      return { x: index * half, y: 0, width: half, height: this.height };
    }
    const half = Math.floor(this.height / 2);
    return { x: 0, y: index * half, width: this.width, height: half };
  }

  get camera(): CameraView | null {
    return this.subjects?.shown.world.camera ?? null;
  }

  private resize(): void {
    const width = this.host.clientWidth;
    const height = this.host.clientHeight;
    if (!width || !height) return;
    [this.width, this.height] = [width, height];
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, FINEST));
    this.renderer.setSize(width, height);
    const part = this.window(0);
    this.eyes.resize(part.width, part.height);
    this.draw(); // at once: a canvas that has changed its size is empty
  }

  /** Where in the plane of motion a place of the canvas lies [m]; null where the eye looks along it. */
  metres(px: number, py: number): number[] | null {
    if (!this.subjects) return null;
    const { opened, shown } = this.subjects;
    const at = this.views.findLastIndex((_, i) => px >= this.window(i).x && py >= this.window(i).y);
    const { x, y, width, height } = this.window(Math.max(at, 0));
    const caster = new Raycaster();
    caster.setFromCamera(new Vector2((2 * (px - x)) / width - 1, 1 - (2 * (py - y)) / height), this.eyes.camera);
    const plane = planeOfMotion(opened, shown.world, shown.rollout);
    return caster.ray.intersectPlane(plane, new Vector3())?.toArray() ?? null;
  }

  /** The canvas, drawn in this moment: after it, WebGL may have cleared what is not yet displayed. */
  get picture(): HTMLCanvasElement {
    this.draw();
    return this.renderer.domElement;
  }

  /** Draw with the next frame of the display. */
  request(): void {
    this.waiting ||= requestAnimationFrame(() => {
      this.waiting = 0;
      const moving = this.eyes.update();
      this.draw();
      if (moving) this.request();
    });
  }

  private draw(): void {
    if (!this.views.length || !this.palette) return;
    const started = performance.now();
    if (this.stale) {
      for (const view of this.views) view.setTime(this.time, this.visible);
      this.renderer.shadowMap.needsUpdate = true;
      this.stale = false;
    }
    if (this.followed !== null) {
      const at = new Vector3();
      if (this.views[0]!.meshes.middle(this.followed, at)) this.eyes.follow(at);
    }
    const camera = this.eyes.camera;
    camera.updateMatrixWorld();
    const windows = this.views.map((_, i) => this.window(i));
    this.labels.place(this.views.map((view, i) => ({ labels: view.labels, camera, window: windows[i]! })));
    const updated = performance.now();
    this.renderer.info.reset();
    const lights = this.renderer.shadowMap.needsUpdate;
    this.views.forEach((view, i) => {
      const { x, y, width, height } = windows[i]!;
      this.renderer.setViewport(x, this.height - y - height, width, height);
      this.renderer.setScissor(x, this.height - y - height, width, height);
      view.seenFrom(camera);
      this.renderer.shadowMap.needsUpdate = lights;
      this.renderer.render(view.scene, camera);
    });
    const drawn = performance.now();
    const s = this.statistics;
    s.frames++;
    s.calls = this.renderer.info.render.calls;
    s.updateMs = updated - started;
    s.updateTotalMs += s.updateMs;
    s.drawMs = drawn - updated;
    s.drawTotalMs += s.drawMs;
    s.geometries = this.renderer.info.memory.geometries;
    s.textures = this.renderer.info.memory.textures;
    this.watcher.drawn(this);
  }

  private pick(event: PointerEvent): string | null {
    const bounds = this.host.getBoundingClientRect();
    const [px, py] = [event.clientX - bounds.left, event.clientY - bounds.top];
    for (const [i, view] of this.views.entries()) {
      const { x, y, width, height } = this.window(i);
      if (px < x || px > x + width || py < y || py > y + height) continue;
      const caster = new Raycaster();
      caster.params.Points.threshold = 0.02;
      caster.setFromCamera(new Vector2((2 * (px - x)) / width - 1, 1 - (2 * (py - y)) / height), this.eyes.camera);
      for (const hit of caster.intersectObject(view.meshes.group)) {
        const column = hit.object.userData.column as number | undefined;
        if (column !== undefined && column >= 0 && hit.object.visible) return hit.object.userData.name as string;
        if (column === -1 && hit.object.userData.shape !== "plane") return null;
      }
    }
    return null;
  }

  dispose(): void {
    cancelAnimationFrame(this.waiting);
    this.observer.disconnect();
    this.eyes.dispose();
    this.labels.dispose();
    for (const view of this.views) view.dispose();
    this.renderer.dispose();
    this.renderer.domElement.remove();
  }
}

