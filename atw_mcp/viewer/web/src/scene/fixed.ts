// Fixed solids that only one of two worlds has, or that stand elsewhere in the other.
import { Vector3 } from "three";
import type { RolloutView, Static, WorldView } from "../document";
import { words } from "../format";
import type { Opened } from "../unpack";
import { staticBox } from "./extent";
import type { Label } from "./labels";

export interface Side {
  world: WorldView;
  rollout: RolloutView;
}

/** Fixed solids of `here` that `there` lacks, or has elsewhere or in another shape. */
export function differing(here: WorldView, there: WorldView): { solid: Static; moved: boolean }[] {
  return here.statics.flatMap((solid) => {
    const same = there.statics.find((s) => s.name === solid.name);
    if (same && placeOf(same) === placeOf(solid)) return [];
    return [{ solid, moved: same !== undefined }];
  });
}

/** What an intervention did to a fixed solid that `here` has and `there` lacks, in two words with a sign. */
export function changeOf(name: string, here: RolloutView, there: RolloutView): { text: string; kind: "gone" | "new" } {
  const removed = there.edits.length > 0 && here.edits.length === 0;
  const added = here.edits.length > 0 && there.edits.length === 0;
  const text = removed ? `− ${words(name)} removed` : added ? `+ ${words(name)} added` : `${words(name)} only in ${here.label}`;
  return { text, kind: removed ? "gone" : "new" };
}

/** A label at each fixed solid that `here` has otherwise than `there`; half spaces have no place for one. */
export function fixedLabels(opened: Opened, here: Side, there: Side): Label[] {
  return differing(here.world, there.world).flatMap(({ solid, moved }): Label[] => {
    const box = staticBox(opened, solid);
    if (box.isEmpty()) return [];
    const at = box.getCenter(new Vector3()).setZ(box.max.z);
    const { text, kind } = moved
      ? { text: `${words(solid.name)} in ${here.rollout.label}`, kind: "new" as const }
      : changeOf(solid.name, here.rollout, there.rollout);
    return [{ key: `${solid.name} fixed ${here.rollout.id}`, object: solid.name, text, at, color: solid.color, kind }];
  });
}

function placeOf({ shape, position, orientation }: Static): string {
  // the same numbers may lie at two places of the document
  return JSON.stringify([shape, position, orientation], (name, value) => (name === "offset" && shape.kind === "mesh" ? undefined : (value as unknown)));
}
