// Where the scene is seen from: an orbiting eye, the video's own camera, or straight down on the plane of motion.
import { type Box3, Matrix4, OrthographicCamera, PerspectiveCamera, Vector3, type Vector4 } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { CameraView } from "../document";
import type { Eye } from "../state";
import { calm } from "../theme";

/** Field of view of the orbiting eye, up and down [deg]. */
const VIEW = 34;
/** Room around what is fitted into view. */
const MARGIN = 1.12;
/** Least angle between the floor and where the orbiting eye looks at first [rad]: flatter, it shows no places on it. */
const LEAST_HEIGHT = 0.35;
/** One press of an arrow key [rad]. */
const PRESS = Math.PI / 24;

/** What the eyes look at. */
export interface Subject {
  extent: Box3;
  /** Balls (x, y, z, radius) to be seen [m]. */
  places: Vector4[];
  /** Unit vector towards an eye that looks straight down on the plane of motion. */
  normal: Vector3;
  camera: CameraView | null;
}

export class Eyes {
  kind: Eye = "orbit";
  private readonly orbit = new PerspectiveCamera(VIEW);
  private readonly plan = new OrthographicCamera();
  private readonly video = new PerspectiveCamera();
  private readonly turning: OrbitControls;
  private readonly shifting: OrbitControls;
  private subject: Subject | null = null;
  private size: [number, number] = [1, 1];
  private readonly followed = new Vector3();
  private following = false;

  constructor(dom: HTMLElement, changed: () => void) {
    for (const camera of [this.orbit, this.plan]) camera.up.set(0, 0, 1);
    this.turning = new OrbitControls(this.orbit, dom);
    this.turning.enableDamping = !calm;
    this.turning.dampingFactor = 0.12;
    this.turning.zoomToCursor = true;
    this.turning.maxPolarAngle = Math.PI;
    this.shifting = new OrbitControls(this.plan, dom);
    this.shifting.enableRotate = false;
    this.shifting.zoomToCursor = true;
    this.shifting.screenSpacePanning = true;
    this.shifting.mouseButtons.LEFT = this.shifting.mouseButtons.RIGHT; // there is nothing to turn: move
    this.shifting.touches.ONE = 1; // TOUCH.PAN
    for (const controls of [this.turning, this.shifting]) controls.addEventListener("change", changed);
    this.choose("orbit");
  }

  get camera(): PerspectiveCamera | OrthographicCamera {
    return { orbit: this.orbit, plan: this.plan, video: this.video }[this.kind];
  }

  /** The eye shown; the video's needs a camera. */
  choose(kind: Eye): void {
    this.kind = kind === "video" && !this.subject?.camera ? "orbit" : kind;
    this.turning.enabled = this.kind === "orbit";
    this.shifting.enabled = this.kind === "plan";
  }

  /** Look at something else, from where the eye is; `fit` it into view where the eye was not yet set. */
  look(subject: Subject): void {
    const first = this.subject === null;
    this.subject = subject;
    if (first) this.reset();
    this.aim();
  }

  /** Fit the whole motion into view. */
  reset(): void {
    if (!this.subject) return;
    this.following = false; // what is followed is put into the middle again, as when it is chosen
    const { extent, normal } = this.subject;
    const centre = extent.getCenter(new Vector3());
    for (const controls of [this.turning, this.shifting]) {
      const damped = controls.enableDamping;
      controls.enableDamping = false; // an update without it ends a movement that is running out
      controls.update();
      controls.enableDamping = damped;
    }
    const direction = this.direction();
    this.orbit.position.copy(direction);
    this.orbit.lookAt(0, 0, 0);
    const { target, away } = this.fit(extent.getCenter(new Vector3()));
    this.turning.target.copy(target);
    this.orbit.position.copy(target).addScaledVector(direction, away);
    this.turning.update();

    this.shifting.target.copy(centre);
    this.plan.up.set(0, Math.abs(normal.z) > 0.7 ? 1 : 0, Math.abs(normal.z) > 0.7 ? 0 : 1);
    // OrbitControls takes the axis that it turns about from the camera once: no turning here
    this.plan.position.copy(centre).addScaledVector(normal, extent.getSize(new Vector3()).length());
    this.plan.zoom = 1;
    this.plan.lookAt(centre);
    this.aim();
  }

  /** From the middle of the subject to the orbiting eye, a unit vector. */
  private direction(): Vector3 {
    const { normal, camera } = this.subject!;
    if (camera) {
      // as the video sees it, but neither from below nor flat
      const away = new Vector3().fromArray(camera.rotation[2]!).negate();
      const height = Math.min(Math.max(Math.asin(Math.min(1, Math.max(-1, away.z))), LEAST_HEIGHT), 0.8);
      const around = Math.atan2(away.y, away.x);
      return new Vector3(Math.cos(around) * Math.cos(height), Math.sin(around) * Math.cos(height), Math.sin(height));
    }
    const upright = Math.abs(normal.z) < 0.7; // the plane of motion, such as a pendulum's
    const around = (upright ? Math.atan2(normal.y, normal.x) + 0.35 : -Math.PI / 3);
    const height = upright ? LEAST_HEIGHT : 0.5;
    return new Vector3(Math.cos(around) * Math.cos(height), Math.sin(around) * Math.cos(height), Math.sin(height));
  }

  /** Where the orbiting eye, turned as it is, must look and from how far [m] so that all places fill the view. */
  private fit(centre: Vector3): { target: Vector3; away: number } {
    const up = Math.tan((VIEW * Math.PI) / 360);
    const side = up * (this.size[0] / this.size[1]);
    const [right, above, back] = [new Vector3(), new Vector3(), new Vector3()];
    this.orbit.updateMatrixWorld();
    this.orbit.matrixWorld.extractBasis(right, above, back);
    const target = centre.clone();
    const place = new Vector3();
    let away = 1e-3;
    // the middle of what is seen depends on the distance, and the distance on the middle: a few rounds settle both
    for (let round = 0; round < 5; round++) {
      away = 1e-3;
      for (const { x, y, z, w } of this.subject!.places) {
        place.set(x, y, z).sub(target);
        const depth = place.dot(back) + w;
        away = Math.max(away, (Math.abs(place.dot(right)) + w) / side + depth, (Math.abs(place.dot(above)) + w) / up + depth);
      }
      const [low, high] = [new Vector3(Infinity, Infinity, 0), new Vector3(-Infinity, -Infinity, 0)];
      for (const { x, y, z, w } of this.subject!.places) {
        place.set(x, y, z).sub(target);
        const depth = Math.max(away - place.dot(back), 1e-6);
        const [u, v] = [place.dot(right), place.dot(above)];
        low.min(place.set((u - w) / depth, (v - w) / depth, 0));
        high.max(place.set((u + w) / depth, (v + w) / depth, 0));
      }
      target.addScaledVector(right, (away * (low.x + high.x)) / 2).addScaledVector(above, (away * (low.y + high.y)) / 2);
    }
    return { target, away: MARGIN * away };
  }

  /** width, height: of one view [CSS px]. */
  resize(width: number, height: number): void {
    const before = this.size[0] / this.size[1];
    this.size = [Math.max(1, width), Math.max(1, height)];
    if (this.subject && Math.abs(before - width / height) > 0.3 && this.untouched) this.reset();
    this.aim();
  }

  private get untouched(): boolean {
    return this.size[0] > 1 && !this.moved;
  }
  /** True once a person has moved the eye. */
  moved = false;

  /** Projections for the present sizes and places. */
  private aim(): void {
    if (!this.subject) return;
    const [width, height] = this.size;
    const { extent, camera } = this.subject;
    const span = extent.getSize(new Vector3()).length();
    const away = this.orbit.position.distanceTo(this.turning.target);
    this.orbit.aspect = width / height;
    this.orbit.near = Math.max(0.02 * away, 1e-4 * span);
    this.orbit.far = away + 8 * span;
    this.orbit.updateProjectionMatrix();

    const centre = extent.getCenter(new Vector3());
    this.plan.updateMatrixWorld();
    const view = this.plan.matrixWorld.clone().setPosition(0, 0, 0).invert();
    const half = extent.getSize(new Vector3()).multiplyScalar(0.5);
    const e = view.elements;
    const reach = (row: number) => Math.abs(e[row]!) * half.x + Math.abs(e[4 + row]!) * half.y + Math.abs(e[8 + row]!) * half.z;
    const tall = MARGIN * Math.max(reach(1), (reach(0) * height) / width, 1e-6);
    this.plan.top = tall;
    this.plan.bottom = -tall;
    this.plan.right = (tall * width) / height;
    this.plan.left = -this.plan.right;
    this.plan.near = -4 * span;
    this.plan.far = 6 * span;
    this.plan.updateProjectionMatrix();

    if (camera) aimAsVideo(this.video, camera, width, height, centre, span);
  }

  /** Move with a point that is followed; null: stay. */
  follow(at: Vector3 | null): void {
    if (at && this.following && this.kind !== "video") {
      const step = at.clone().sub(this.followed);
      const controls = this.kind === "plan" ? this.shifting : this.turning;
      controls.target.add(step);
      this.camera.position.add(step);
      this.camera.updateMatrixWorld();
    } else if (at && !this.following && this.kind !== "video") {
      // from now on in the middle
      const controls = this.kind === "plan" ? this.shifting : this.turning;
      this.camera.position.add(at.clone().sub(controls.target));
      controls.target.copy(at);
      this.camera.updateMatrixWorld();
    }
    this.following = at !== null;
    if (at) this.followed.copy(at);
  }

  /** Let movement run out; true while it goes on. */
  update(): boolean {
    if (this.kind === "video") return false;
    const on = this.kind === "plan" ? this.shifting.update() : this.turning.update();
    this.aim();
    return on;
  }

  /** Metres that a CSS pixel at the middle of the view is wide. */
  get metresPerPixel(): number {
    const [, height] = this.size;
    if (this.kind === "plan") return (this.plan.top - this.plan.bottom) / this.plan.zoom / height;
    if (this.kind === "orbit") {
      const away = this.orbit.position.distanceTo(this.turning.target);
      return (2 * away * Math.tan((VIEW * Math.PI) / 360)) / height;
    }
    const centre = this.subject!.extent.getCenter(new Vector3()).applyMatrix4(this.video.matrixWorldInverse);
    return (2 * -centre.z) / this.video.projectionMatrix.elements[5]! / height;
  }

  /** Turn, move or zoom by a key; false where the key means nothing here. */
  press(event: KeyboardEvent): boolean {
    const controls = this.kind === "plan" ? this.shifting : this.turning;
    if (this.kind === "video" || event.ctrlKey || event.metaKey || event.altKey) return false;
    const [x, y] = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key] ?? [0, 0];
    if (x || y) {
      if (event.shiftKey || this.kind === "plan") controls.pan(40 * x!, 40 * y!);
      else {
        controls.rotateLeft(PRESS * x!);
        controls.rotateUp(PRESS * y!);
      }
    } else if (event.key === "+" || event.key === "=") controls.dollyIn(1.15);
    else if (event.key === "-") controls.dollyOut(1.15);
    else if (event.key === "Home") this.reset();
    else return false;
    this.moved = event.key !== "Home";
    controls.update();
    return true;
  }

  dispose(): void {
    this.turning.dispose();
    this.shifting.dispose();
  }
}

/**
 * Aim a camera so that the video's frame fills as much as it can of a view of `width` by `height`, centred, and a point X
 * is seen where the video sees it: pixel ~ K (R X + t), pixels from the frame's upper left corner.
 */
export function aimAsVideo(
  eye: PerspectiveCamera,
  camera: CameraView,
  width: number,
  height: number,
  centre: Vector3,
  span: number,
): void {
  const [r0, r1, r2] = camera.rotation as [number[], number[], number[]];
  const [tx, ty, tz] = camera.translation as [number, number, number];
  // the video's camera looks along z with y down; three.js looks along -z with y up
  const view = new Matrix4().set(
    r0[0]!, r0[1]!, r0[2]!, tx,
    -r1[0]!, -r1[1]!, -r1[2]!, -ty,
    -r2[0]!, -r2[1]!, -r2[2]!, -tz,
    0, 0, 0, 1,
  );
  view.clone().invert().decompose(eye.position, eye.quaternion, eye.scale);
  eye.updateMatrixWorld();
  const away = -centre.clone().applyMatrix4(view).z;
  const near = Math.max(0.02 * Math.abs(away), 1e-3 * span);
  const far = Math.abs(away) + 8 * span;
  const [k0, k1] = camera.intrinsics as [number[], number[]];
  const shown = Math.min(width / camera.width, height / camera.height);
  const sx = (shown * camera.width) / width;
  const sy = (shown * camera.height) / height;
  eye.projectionMatrix.set(
    (2 * sx * k0[0]!) / camera.width, (-2 * sx * k0[1]!) / camera.width, sx * (1 - (2 * k0[2]!) / camera.width), 0,
    0, (2 * sy * k1[1]!) / camera.height, sy * ((2 * k1[2]!) / camera.height - 1), 0,
    0, 0, -(far + near) / (far - near), (-2 * far * near) / (far - near),
    0, 0, -1, 0,
  );
  eye.projectionMatrixInverse.copy(eye.projectionMatrix).invert();
}

/** The frame of the video within a view of `width` by `height` [CSS px]: left, top, width, height. */
export function videoFrame(camera: CameraView, width: number, height: number): [number, number, number, number] {
  const shown = Math.min(width / camera.width, height / camera.height);
  const [w, h] = [shown * camera.width, shown * camera.height];
  return [(width - w) / 2, (height - h) / 2, w, h];
}
