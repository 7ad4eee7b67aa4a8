// Joints, springs, attachments and pulleys, drawn over what hides them, and the boxes of regions.
import { Color, Group, Quaternion, Vector3 } from "three";
import type { JointMark, WorldView } from "../document";
import { carried, turned, type Carried } from "./anchors";
import { Dots } from "./dots";
import { Lines } from "./lines";
import type { WorldMeshes } from "./world_meshes";

/** Turns of a spring's coil, and straight pieces a turn. */
const TURNS = 9;
const PIECES = 10;
const RIM = 36; // pieces of a pulley's rim

export interface MarkColors {
  joint: Color;
  region: Color;
  rim: Color;
}

/** A mark: draws itself into the lines and dots at the present state of the meshes. */
type Draw = () => void;

export class Marks {
  readonly object = new Group();
  private readonly lines: Lines;
  private readonly boxes: Lines;
  private readonly dots: Dots;
  private readonly draws: Draw[] = [];

  /** Call with the meshes at the start. size: of the scene [m]. */
  constructor(
    world: WorldView,
    meshes: WorldMeshes,
    private readonly size: number,
    private readonly colors: MarkColors,
  ) {
    this.lines = new Lines(Math.max(1, world.joints.length) * (TURNS * PIECES + RIM), { over: true, opacity: 0.9 });
    this.boxes = new Lines(12 * Math.max(1, world.regions.length), { opacity: 0.75, dash: 8 });
    this.dots = new Dots(Math.max(1, 2 * world.joints.length), colors.rim);
    for (const joint of world.joints) this.draws.push(this.joint(joint, meshes));
    for (const region of world.regions) this.draws.push(this.region(region, meshes));
    this.object.add(this.lines.object, this.boxes.object, this.dots.object);
  }

  update(): void {
    this.lines.clear();
    this.boxes.clear();
    this.dots.clear();
    for (const draw of this.draws) draw();
    this.lines.done();
    this.boxes.done();
    this.dots.done();
  }

  private joint(joint: JointMark, meshes: WorldMeshes): Draw {
    const { lines, dots } = this;
    const color = this.colors.joint;
    // a pulley hangs on what carries it, not on its rope
    const holder = joint.kind === "pulley" ? joint.other : joint.object;
    const here: Carried = carried(meshes, holder, joint.anchor, holder === joint.object ? joint.held : []);
    const there = carried(meshes, joint.other, joint.other_anchor ?? joint.anchor);
    const turn = turned(meshes, joint.other ?? holder);
    const q = new Quaternion();
    const [a, b, u, v, w, p, last] = Array.from({ length: 7 }, () => new Vector3()) as Vector3[];
    const line = (from: Vector3, to: Vector3, width: number) => {
      lines.add(from.toArray(), 0, to.toArray(), 0, color, width);
    };
    const dot = (at: Vector3, diameter: number) => dots.add(at.x, at.y, at.z, color, diameter);
    return () => {
      if (!here(a!) || !there(b!)) return;
      if (joint.kind === "spring") {
        w!.subVectors(b!, a!);
        across(w!, u!, v!);
        const radius = Math.min(0.012 * this.size, 0.12 * w!.length());
        last!.copy(a!);
        for (let i = 1; i <= TURNS * PIECES; i++) {
          const part = i / (TURNS * PIECES);
          const ends = Math.min(1, 8 * part, 8 * (1 - part)); // straight where it is fastened
          const angle = 2 * Math.PI * TURNS * part;
          p!.copy(a!).addScaledVector(w!, part);
          p!.addScaledVector(u!, radius * ends * Math.cos(angle)).addScaledVector(v!, radius * ends * Math.sin(angle));
          line(last!, p!, 1.6);
          last!.copy(p!);
        }
        dot(a!, 7);
        dot(b!, 7);
        return;
      }
      if (joint.axis) {
        turn(q);
        w!.fromArray(joint.axis).applyQuaternion(q).normalize();
        if (joint.kind === "pulley" && joint.radius) {
          across(w!, u!, v!);
          for (let i = 0; i <= RIM; i++) {
            const angle = (2 * Math.PI * i) / RIM;
            p!.copy(a!).addScaledVector(u!, joint.radius * Math.cos(angle));
            p!.addScaledVector(v!, joint.radius * Math.sin(angle));
            if (i) line(last!, p!, 1.6);
            if (i && i % (RIM / 4) === 0) line(a!, p!, 1.2);
            last!.copy(p!);
          }
        } else {
          const half = (joint.kind === "slider" ? 0.14 : 0.05) * this.size;
          line(p!.copy(a!).addScaledVector(w!, -half), last!.copy(a!).addScaledVector(w!, half), joint.kind === "slider" ? 1.6 : 3);
        }
      }
      if (a!.distanceTo(b!) > 1e-3 * this.size) {
        line(a!, b!, 1.6); // an attachment, or a joint that has been pulled apart
        dot(b!, 6);
      }
      dot(a!, joint.kind === "ball" ? 11 : 8);
    };
  }

  private region(region: WorldView["regions"][number], meshes: WorldMeshes): Draw {
    const corners = Array.from({ length: 8 }, (_, i) =>
      carried(
        meshes,
        region.object,
        [0, 1, 2].map((k) => (i & (1 << k) ? region.upper : region.lower)[k]!),
      ),
    );
    const places = corners.map(() => new Vector3());
    return () => {
      if (!corners.every((corner, i) => corner(places[i]!))) return;
      for (let i = 0; i < 8; i++) {
        for (let k = 0; k < 3; k++) {
          const j = i | (1 << k);
          if (j !== i) this.boxes.add(places[i]!.toArray(), 0, places[j]!.toArray(), 0, this.colors.region, 1.4);
        }
      }
    };
  }
}

/** Two unit vectors across `w` and each other. */
function across(w: Vector3, u: Vector3, v: Vector3): void {
  u.set(0, 0, 1);
  if (Math.abs(w.z) > 0.9 * w.length()) u.set(1, 0, 0);
  u.cross(w).normalize();
  v.crossVectors(w, u).normalize();
}
