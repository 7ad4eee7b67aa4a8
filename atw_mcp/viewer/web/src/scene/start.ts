// A world that was not run, as a rollout of one sample: all objects where they begin.
import type { RolloutView, WorldView } from "../document";

/** Null where a rollout of the world is shown. The scene looks at neither its velocities nor its spins. */
export function atStart(world: WorldView): RolloutView | null {
  const start = world.start;
  return (
    start && {
      ...start,
      id: "",
      world: world.id,
      label: "at the start",
      base: null,
      edits: [],
      status: "completed",
      why_ended: null,
      horizon: 0,
      velocities: start.positions,
      spins: start.positions,
      quantities: [],
      events: [],
      pushes: [],
      misfits: [],
      sampled: "",
      spread: null,
    }
  );
}

/** What is shown of a case that has measured positions and no world yet. */
export const NO_WORLD: WorldView = {
  id: "",
  label: "what was observed",
  origin: "",
  parent: null,
  committed: false,
  planar: false,
  seconds_per_frame: 0,
  frame_count: 0,
  gravity: [0, 0, 0],
  camera: null,
  moving: [],
  statics: [],
  joints: [],
  regions: [],
  effects: [],
  floor: null,
  parameters: [],
  start: null,
  follows: null,
};
