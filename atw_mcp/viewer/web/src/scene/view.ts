// One rollout in a three.js scene of its own: solids, marks, paths, arrows, light; and what its labels say.
import {
  type Box3,
  type Camera,

  DirectionalLight,
  HemisphereLight,
  Mesh,
  MeshStandardMaterial,
  type Object3D,
  Scene,
  Vector3,
} from "three";
import { quantity, words } from "../format";
import { happening, type Mark } from "../events";
import type { EventMark, Plane, RolloutView, Tracks, WorldView } from "../document";
import type { Opened } from "../unpack";
import { Ghost } from "./compare";
import { Cutaway } from "./cutaway";
import { EVENT_COLORS, Flashes } from "./flashes";
import { differing, fixedLabels } from "./fixed";
import { floorMesh, roundLength } from "./floor";
import { Marks } from "./joints";
import type { Label } from "./labels";
import { Observed } from "./observed";
import { outline } from "./outline";
import type { Palette } from "./palette";
import { Pushes, type EffectKey } from "./pushes";
import { boundingRadius } from "./shapes";
import { Trails } from "./trails";
import { buildWorld, disposeAll, type WorldMeshes } from "./world_meshes";

/** What a person may switch off. */
export interface Shown {
  names: boolean;
  trails: boolean;
  joints: boolean;
  effects: boolean;
  events: boolean;
  observed: boolean;
}

export interface ViewOf {
  opened: Opened;
  world: WorldView;
  rollout: RolloutView | null;
  /** A rollout shown as a ghost in the same scene. */
  ghost: { world: WorldView; rollout: RolloutView } | null;
  /** The rollout that it is compared with, in this scene or in another. */
  against: { world: WorldView; rollout: RolloutView } | null;
  tracks: Tracks | null;
  extent: Box3;
}

/** Labels of names are shown for so many objects at most: beyond, only the chosen one's. */
const NAMES = 60;
/** Objects that fixed solids are kept from hiding, at most. */
const TARGETS = 8;
/** Events that are named at once: the strongest. */
const NAMED = 3;
/** Before an event that only one of two rollouts has. */
const CHANGES: Record<Mark["change"], string> = { "": "", gone: "− gone: ", new: "+ new: " };

/** What happened, in a few words; the ring says where. */
function brief(event: EventMark): string {
  if (event.kind !== "contact_begin") return happening(event);
  const strength = event.impulse === null ? "" : ` ${quantity(event.impulse, "N s", 3)}`;
  return `${event.participants.map(words).join(" × ")}${strength}`;
}

function rolledOut(rollout: RolloutView | null): boolean {
  return (rollout?.times.shape[0] ?? 0) > 1;
}

export class View {
  readonly scene = new Scene();
  readonly keys: EffectKey[];
  readonly missing: string[];
  readonly cell: number;
  /** What the grid lies on, for the legend. */
  readonly gridNote: string;
  readonly meshes: WorldMeshes;
  labels: Label[] = [];
  private readonly ghost: Ghost | null = null;
  private readonly ghostTrails: Trails | null = null;
  private readonly trails: Trails | null = null;
  private readonly observed: Observed | null = null;
  private readonly marks: Marks;
  private readonly pushes: Pushes;
  private readonly flashes: Flashes;
  private readonly size: number;
  private readonly cutaway: Cutaway;
  private readonly radii: Map<string, number>;
  private highlighted: string | null = null;
  private edge: Object3D | null = null;
  private seen: Mark[] = [];
  private differences: Label[] = [];
  private measured: Label[] = [];
  private fixed: Label[] = [];

  constructor(
    private readonly of: ViewOf,
    private readonly palette: Palette,
  ) {
    const { opened, world, rollout, extent } = of;
    const span = extent.getSize(new Vector3());
    this.size = span.length();
    this.cell = roundLength(0.12 * this.size);
    this.radii = new Map(world.moving.map((m) => [m.name, m.shape ? boundingRadius(opened, m.shape) : 0]));
    const against = rollout ? of.against : null;
    const lacking = against ? differing(world, against.world).map(({ solid }) => solid.name) : [];
    this.meshes = buildWorld(opened, world, rollout, { lacking: new Set(of.ghost ? lacking : []) });
    if (against && rollout) {
      this.fixed = fixedLabels(opened, { world, rollout }, against);
      if (of.ghost) this.fixed.push(...fixedLabels(opened, against, { world, rollout }));
    }
    this.scene.add(this.meshes.group);
    this.missing = [...this.meshes.missing];
    this.gridNote = this.floors();
    this.light();
    const solids = world.statics.filter((s) => s.shape.kind !== "plane" && !(of.ghost && lacking.includes(s.name))).map((s) => this.meshes.byName.get(s.name) as Mesh);
    this.cutaway = new Cutaway(solids);
    this.marks = new Marks(world, this.meshes, this.size, palette);
    this.pushes = new Pushes(opened, world, rollout, this.meshes, this.size);
    this.keys = this.pushes.keys;
    this.scene.add(this.marks.object, this.pushes.object);
    if (rollout) {
      this.trails = new Trails(opened, world, rollout, this.size, palette.floor, false);
      this.scene.add(this.trails.object);
    }
    if (of.tracks) {
      this.observed = new Observed(opened, of.tracks, world.moving, palette.floor, palette.rim);
      this.scene.add(this.observed.object);
    }
    this.flashes = new Flashes(palette.rim);
    this.scene.add(this.flashes.object);
    if (of.ghost && rollout) {
      this.ghost = new Ghost(opened, { world, rollout }, of.ghost, this.meshes, this.size, palette.branch);
      this.ghostTrails = new Trails(opened, of.ghost.world, of.ghost.rollout, this.size, palette.floor, true);
      this.scene.add(this.ghost.object, this.ghostTrails.object);
    }
  }

  /** Floors with a grid; where the world has none, a grid below the motion so that heights can be read. */
  private floors(): string {
    const { world, extent } = this.of;
    const up = new Vector3(0, 0, 1);
    const found: { plane: Plane; at: Vector3; name: string }[] = [];
    if (world.floor) found.push({ plane: world.floor, at: new Vector3(), name: "floor" });
    for (const fixed of world.statics) {
      if (fixed.shape.kind !== "plane") continue;
      found.push({ plane: fixed.shape, at: new Vector3().fromArray(fixed.position), name: fixed.name });
      const solid = this.meshes.byName.get(fixed.name);
      if (solid) solid.visible = false; // drawn here, with its grid
    }
    const centre = extent.getCenter(new Vector3());
    const reach = 1.6 * this.size;
    const colors = { surface: this.palette.floor, line: this.palette.grid };
    let note = "";
    for (const { plane, at, name } of found) {
      const normal = new Vector3().fromArray(plane.normal);
      const length = normal.length() || 1;
      normal.divideScalar(length);
      const solid = this.meshes.byName.get(name);
      if (solid) normal.applyQuaternion(solid.quaternion);
      const offset = plane.offset / length + normal.dot(at);
      const flat = normal.dot(up) > 0.999;
      this.scene.add(floorMesh(normal, offset, centre, reach, this.cell, colors, flat ? 1 : 0.6));
      if (flat) note ||= `on ${words(name)}`;
    }
    if (!note) {
      const height = extent.min.z;
      this.scene.add(floorMesh(up, height, centre, reach, this.cell, colors, 0.35));
      note = `at z = ${quantity(height, "m", 3)}, not a floor`;
    }
    return note;
  }

  /** Soft light from all sides and one lamp nearly overhead, so that a shadow lies below what casts it. */
  private light(): void {
    const { extent } = this.of;
    const centre = extent.getCenter(new Vector3());
    this.scene.add(new HemisphereLight(0xffffff, this.palette.bounce, this.palette.ambient));
    const lamp = new DirectionalLight(0xffffff, this.palette.lamp);
    lamp.position.copy(centre).add(new Vector3(-0.3, -0.45, 1).normalize().multiplyScalar(1.5 * this.size));
    lamp.target.position.copy(centre);
    lamp.castShadow = true;
    lamp.shadow.mapSize.set(2048, 2048);
    const half = 0.62 * this.size;
    const depth = { near: 0.2 * this.size, far: 3.5 * this.size };
    Object.assign(lamp.shadow.camera, { left: -half, right: half, top: half, bottom: -half, ...depth });
    lamp.shadow.normalBias = (2 * half) / 2048;
    lamp.shadow.bias = -2e-4;
    lamp.shadow.radius = 4;
    lamp.shadow.intensity = this.palette.shadow;
    const fill = new DirectionalLight(0xffffff, 0.35 * this.palette.lamp);
    fill.position.copy(centre).add(new Vector3(0.7, -0.6, 0.35).multiplyScalar(this.size));
    fill.target.position.copy(centre);
    this.scene.add(lamp, lamp.target, fill, fill.target);
  }

  /** Events of the rollout, and of a ghost those that it does not share. */
  setEvents(marks: Mark[]): void {
    this.flashes.show(marks);
  }

  setTime(t: number, shown: Shown): void {
    this.meshes.setTime(t);
    this.marks.update();
    if (shown.effects) this.pushes.setTime(t);
    this.trails?.setTime(t);
    this.ghostTrails?.setTime(t);
    this.seen = this.flashes.setTime(t);
    this.differences = this.ghost?.setTime(t) ?? [];
    const measured = this.observed?.setTime(t) ?? [];
    if (this.observed) this.observed.object.visible = shown.observed;
    this.measured = shown.observed && !rolledOut(this.of.rollout) ? measured : []; // else the ring beside the object says it
    this.marks.object.visible = shown.joints;
    this.pushes.object.visible = shown.effects;
    if (this.trails) this.trails.object.visible = shown.trails;
    if (this.ghostTrails) this.ghostTrails.object.visible = shown.trails;
    this.flashes.object.visible = shown.events;
    this.write(shown);
  }

  /** Before each frame, once the eye has its place. */
  seenFrom(camera: Camera): void {
    if (!this.of.world.statics.length) return;
    const targets: Vector3[] = [];
    for (const name of this.of.rollout?.names ?? []) {
      const at = new Vector3();
      if (targets.length < TARGETS && this.meshes.middle(name, at)) targets.push(at);
    }
    this.cutaway.update(camera, targets);
  }

  /** The chosen object gets an outline; what has no rigid surface shines. */
  highlight(name: string | null): void {
    if (name === this.highlighted) return;
    this.glow(this.highlighted, 0);
    if (this.edge) disposeAll(this.edge);
    this.edge = null;
    this.highlighted = name;
    const object = name === null ? undefined : this.meshes.byName.get(name);
    if (!object) return;
    const closed = this.of.world.moving.find((m) => m.name === name)?.kind === "soft" ? object.children[0] : object;
    if (closed instanceof Mesh) {
      this.edge = outline(closed, this.palette.chosen, closed !== object);
      closed.add(this.edge);
    }
    this.glow(name, closed instanceof Mesh ? 0.12 : 0.4);
  }

  private glow(name: string | null, strength: number): void {
    if (name === null) return;
    this.meshes.byName.get(name)?.traverse((part) => {
      const material = (part as Mesh).material;
      if (!(material instanceof MeshStandardMaterial)) return;
      material.emissive.copy(material.color);
      material.emissiveIntensity = strength;
    });
  }

  /** Most important first: where two would cover each other the first is shown. */
  private write(shown: Shown): void {
    const { world, rollout } = this.of;
    const labels: Label[] = [];
    const names = rollout?.names ?? [];
    const label = (name: string) => {
      const at = new Vector3();
      if (!this.meshes.middle(name, at)) return;
      const color = world.moving.find((m) => m.name === name)?.color ?? null;
      const above = 0.75 * (this.radii.get(name) ?? 0); // of a box less than its corners
      const chosen = name === this.highlighted;
      labels.push({ key: name, object: name, text: words(name), at, above, color, kind: "name", chosen });
    };
    if (this.highlighted !== null) label(this.highlighted);
    labels.push(...this.differences, ...this.fixed, ...(shown.names ? this.measured : []));
    if (shown.events) {
      // what lies on the ground touches it again and again: rings are enough
      for (const { event, change } of this.seen.filter((m) => !m.ground || m.change).slice(0, NAMED)) {
        const text = `${CHANGES[change]}${brief(event)}`;
        const at = new Vector3().fromArray(event.position!);
        const color = `#${EVENT_COLORS[event.kind].getHexString()}`;
        const key = `${event.kind}@${event.time}${event.participants.join()}${change}`;
        labels.push({ key, text, at, color, kind: change || "event" });
      }
    }
    if (shown.names && names.length <= NAMES) {
      for (const name of names) if (name !== this.highlighted) label(name);
      for (const region of world.regions) {
        const at = new Vector3().fromArray(region.lower).lerp(new Vector3().fromArray(region.upper), 0.5);
        at.z = region.upper[2]!;
        labels.push({ key: `region ${region.name}`, text: words(region.name), at, color: null, kind: "region" });
      }
    }
    // after the names: of fifty objects those that have room
    if (shown.effects) labels.push(...this.pushes.labels);
    this.labels = labels;
  }

  dispose(): void {
    this.highlight(null);
    this.ghost?.dispose();
    this.meshes.dispose();
    this.scene.traverse((part) => {
      if (part instanceof DirectionalLight) part.dispose();
    });
    disposeAll(this.scene);
  }
}

