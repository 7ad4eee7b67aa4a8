// Two rollouts in one scene: the second as a ghost, with a line from each object to where it is there.
import { Color, Group, Vector3 } from "three";
import type { RolloutView, WorldView } from "../document";
import { quantity } from "../format";
import type { Opened } from "../unpack";
import type { Label } from "./labels";
import { changeOf, differing } from "./fixed";
import { Lines } from "./lines";
import { buildWorld, disposeAll, type WorldMeshes } from "./world_meshes";

/** Distances that are not marked, as a part of the size of the scene: nothing that an eye could see. */
const UNSEEN = 0.004;

export interface Compared {
  world: WorldView;
  rollout: RolloutView;
}

export class Ghost {
  readonly object = new Group();
  readonly meshes: WorldMeshes;
  private readonly lines: Lines;
  private readonly names: string[];

  constructor(
    opened: Opened,
    private readonly shown: Compared,
    private readonly other: Compared,
    private readonly solid: WorldMeshes,
    private readonly size: number,
    private readonly color: Color,
  ) {
    this.meshes = buildWorld(opened, other.world, other.rollout, {
      style: "ghost",
      statics: new Set(differing(other.world, shown.world).map(({ solid }) => solid.name)),
    });
    this.names = [...new Set([...shown.rollout.names, ...other.rollout.names])];
    this.lines = new Lines(this.names.length, { over: true });
    this.object.add(this.meshes.group, this.lines.object);
  }

  setTime(t: number): Label[] {
    this.meshes.setTime(t);
    this.lines.clear();
    const labels: Label[] = [];
    const here = new Vector3();
    for (const name of this.names) {
      const there = new Vector3();
      const color = this.shown.world.moving.find((m) => m.name === name)?.color ?? this.colorThere(name);
      const solid = this.shown.rollout.names.includes(name);
      const ghost = this.other.rollout.names.includes(name);
      if (solid && ghost) {
        if (!this.solid.middle(name, here) || !this.meshes.middle(name, there)) continue;
        const apart = here.distanceTo(there);
        if (apart < UNSEEN * this.size) continue;
        this.lines.add(here.toArray(), 0, there.toArray(), 0, this.color, 2.5);
        const at = there.lerp(here, 0.5);
        const text = quantity(apart, "m", 3);
        labels.push({ key: `${name}>`, object: name, value: apart, text, at, color, kind: "distance" });
      } else if (ghost) {
        if (this.meshes.middle(name, there)) labels.push(this.lone(name, there, this.other, this.shown, color));
      } else if (this.solid.middle(name, there)) labels.push(this.lone(name, there, this.shown, this.other, color));
    }
    this.lines.done();
    return labels;
  }

  private colorThere(name: string): string {
    return this.other.world.moving.find((m) => m.name === name)?.color ?? "#888888";
  }

  /** An object that only `having` has: removed by an intervention, added by one, or neither is known. */
  private lone(name: string, at: Vector3, having: Compared, lacking: Compared, color: string): Label {
    const change = changeOf(name, having.rollout, lacking.rollout);
    return { key: `${name}!`, object: name, at, above: 0.05 * this.size, color, ...change };
  }

  dispose(): void {
    this.meshes.dispose();
    disposeAll(this.object);
  }
}
