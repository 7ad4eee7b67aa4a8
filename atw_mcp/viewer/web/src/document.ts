// Generated from atw_mcp/viewer/document.py by `python -m atw_mcp.viewer.typescript`. Do not edit.

/** An answer to a question of the case. */
export interface Answer {
  question: string;
  /** null: unresolved */
  answer: string | null;
  confidence: number | null;
  /** ids of the evidence it rests on */
  evidence: string[];
  /** why it is unresolved; empty where it is not */
  missing: string;
  /** of its evidence */
  chances: Chance[];
}

/** The meaning of a name in a question. */
export interface Binding {
  name: string;
  track: string | null;
  object: string | null;
}

/** An array in the binary section of a packed document, in C order, little-endian; float32 may hold NaN. */
export interface Block {
  dtype: "float32" | "int32" | "uint16" | "uint8";
  shape: number[];
  /** of its first byte in the binary section, a multiple of 4 */
  offset: number;
}

/** A box centred on the origin of its body. */
export interface Box {
  kind: "box";
  /** [m] */
  half_extents: number[];
}

/** A pinhole camera: pixel ~ K (R X + t). */
export interface CameraView {
  width: number;
  height: number;
  intrinsics: number[][];
  rotation: number[][];
  translation: number[];
}

/** A hypothesis about what is missing. */
export interface Candidate {
  title: string;
  /** nats of evidence below the best; null where it diverges or was not compared */
  behind: number | null;
  explains: boolean;
  values: FittedParameter[];
}

/** A cylinder about z with half-spheres on its ends. */
export interface Capsule {
  kind: "capsule";
  /** [m] */
  radius: number;
  /** half the distance of the caps' centres [m] */
  half_height: number;
}

/** The case itself. */
export interface CaseView {
  id: string;
  /** none: a case opened by name, without a file */
  kind: "video" | "data" | "none";
  /** name of its file; empty without one */
  file: string;
  questions: string[];
  /** oldest first */
  answers: Answer[];
  bindings: Binding[];
  committed_world: string | null;
  /** by the rate that the video's file states [s], which is not always physical time */
  file_seconds_per_frame: number | null;
  /** when each frame was taken, in units of the time between frames; null where frame f was at f */
  clock: number[] | null;
}

/** The probability of a statement that an ensemble was asked about. */
export interface Chance {
  evidence: string;
  /** in words */
  statement: string;
  /** that it is true */
  probability: number;
  interval90: (number | null)[] | null;
  /** why it is nearer to chance than the count; empty where it is not */
  less_sure_because: string;
}

/** Two rollouts compared. */
export interface ComparisonView {
  base: string;
  edited: string;
  evidence: string | null;
  summary: string;
  displaced: Displaced[];
  /** events of base that edited lacks */
  gone: EventMark[];
  new: EventMark[];
  /** by more than base's time between two samples */
  shifted: ShiftedEvent[];
}

/** The error over the course of a search. */
export interface Curve {
  /** what is counted: generation, evaluation, iteration */
  step: string;
  steps: number[];
  current: (number | null)[];
  best: (number | null)[];
  unit: string;
}

/** A cylinder about z. */
export interface Cylinder {
  kind: "cylinder";
  /** [m] */
  radius: number;
  /** [m] */
  half_height: number;
}

/** Points of a deformable object. */
export interface Deformed {
  name: string;
  /** float32 (T, k, 3) [m], NaN for particles that are not there */
  points: Block;
}

/** How far an object is from where it was in another rollout. */
export interface Displaced {
  object: string;
  /** greatest distance [m] */
  most: number;
  /** when [s] */
  time: number;
}

/** One record derived from another. */
export interface Edge {
  /** id of the node it was derived from */
  source: string;
  /** id of the node derived */
  target: string;
  how: string;
}

/** An intervention that made a branch. */
export interface EditWords {
  action: string;
  object: string | null;
  text: string;
}

/** A law beyond the base model. */
export interface EffectMark {
  name: string;
  kind: string;
  /** standard name of the effect where that is not its kind: tilt */
  title: string;
  /** its formula, in words */
  law: string;
  enabled: boolean;
  /** null: all */
  objects: string[] | null;
  parameters: Value[];
  /** null where it has no field in space, or none that was evaluated */
  field: Field3 | null;
}

/** The acceleration that an effect gives each object. */
export interface EffectPush {
  effect: string;
  /** float32 (T, n, 3) [m/s^2]; 0 where it does not act */
  accelerations: Block;
}

/** An event of a rollout. */
export interface EventMark {
  kind: "contact_begin" | "contact_end" | "entry" | "exit" | "rest" | "release";
  /** [s] */
  time: number;
  participants: string[];
  position: number[] | null;
  /** [N s] */
  impulse: number | null;
  /** [m/s] */
  speed: number | null;
}

/** A result of a tool. */
export interface EvidenceRow {
  id: string;
  tool: string;
  status: "running" | "completed" | "failed" | "cancelled" | "diverged";
  summary: string;
  world: string | null;
  rollout: string | null;
  observation: string | null;
  objects: string[];
  /** [s] */
  interval: (number | null)[] | null;
}

/** The field of an effect in space, at the start, on a regular grid. */
export interface Field3 {
  /** float32 (k, 3) [m] */
  points: Block;
  /** float32 (k, 3) */
  vectors: Block;
  unit: string;
  /** what the vectors are, in words */
  what: string;
  /** the same everywhere */
  uniform: boolean;
}

/** The video of the case as a browser can play it. */
export interface Film {
  mime: string;
  /** uint8, the file; null where `url` says where it is */
  data: Block | null;
  url: string | null;
  /** of the original frames, to which all pixels refer [px] */
  width: number;
  /** [px] */
  height: number;
  frame_count: number;
  /** float32 (frame_count,): when each frame begins in this file [s] */
  media_times: Block;
  /** how it was made from the case's file */
  note: string;
}

/** A fit. */
export interface FitView {
  evidence: string;
  source_world: string | null;
  world: string | null;
  summary: string;
  parameters: FittedParameter[];
  curve: Curve | null;
}

/** A fitted parameter with its spread. */
export interface FittedParameter {
  name: string;
  value: number;
  unit: string;
  interval95: (number | null)[] | null;
  /** of its search */
  bounds: (number | null)[] | null;
  at_bound: boolean;
  /** float32 (k,): values that the data allow */
  sample: Block | null;
  /** searched on a logarithmic scale */
  logarithmic: boolean;
  /** why the data do not determine it; empty where they do */
  note: string;
}

/** How well a world follows the data that it was fitted to. */
export interface Following {
  /** id of the FitWorld or ModelVideo that judged it */
  evidence: string;
  verdict: "good" | "doubtful" | "poor";
  /** root mean square distance on the data fitted [m] */
  rms: number | null;
  /** the same on data held out of the fit [m] */
  rms_held_out: number | null;
  /** what is wrong or doubtful, worst first */
  doubts: string[];
}

/** Residuals of one kind of one object in one run, before an effect was added and after. */
export interface GapSeries {
  /** empty where there is but one: its times are then those of the worlds and the film */
  run: string;
  object: string;
  /** float32 (T,) [s] since the start of the run */
  times: Block;
  /** float32 (T, 3) where the object was [m] */
  observed: Block;
  /** float32 (T, 3) simulated without the effect [m]; NaN for rotations and spins */
  before: Block;
  /** float32 (T, 3) in standard deviations of the noise */
  residual_before: Block;
  /** float32 (T, 3) simulated with the effect [m] */
  after: Block | null;
  residual_after: Block | null;
  kind: "position" | "rotation" | "spin";
  /** intervals of time held out of the fit [s], each fitted a start only */
  held_out: ((number | null)[])[];
}

/** A step of the gap workflow: a discrepancy found, effects proposed, or an effect added. */
export interface GapView {
  evidence: string;
  tool: "FindDiscrepancy" | "ProposeEffects" | "AddEffect";
  world: string | null;
  /** in plain words */
  verdict: string;
  summary: string;
  series: GapSeries[];
  jumps: Jump[];
  /** best first */
  candidates: Candidate[];
  /** residuals beyond the noise, root mean square, in `gap_unit` */
  gap_before: number | null;
  /** the same with the effect */
  gap_after: number | null;
  /** in `gap_unit` */
  noise: number | null;
  /** m, rad or rad/s */
  gap_unit: string;
  /** measured on held-out data; false: on the data fitted */
  gap_held_out: boolean;
}

/** A joint, an attachment or a pulley, where it is at the start. `anchor` moves with `object` where that is rigid, else with `other` where that is; else it stays. `other_anchor` moves with `other`, else stays. An attachment is where the points of `object` that it holds are. */
export interface JointMark {
  name: string;
  /** hinge, slider, ball, fixed, spring, attachment, pulley, ... */
  kind: string;
  object: string;
  /** null: the world */
  other: string | null;
  /** in world axes at the start [m] */
  anchor: number[];
  /** of a spring [m] */
  other_anchor: number[] | null;
  /** of a hinge, slider or pulley, world axes at the start */
  axis: number[] | null;
  /** of a pulley [m] */
  radius: number | null;
  /** points of `object` that an attachment holds */
  held: number[];
}

/** A sudden change of velocity that nothing known explains. */
export interface Jump {
  /** as in the series */
  run: string;
  object: string;
  /** [s] since the start of the run */
  time: number;
  /** its size, in its standard deviations */
  sigmas: number;
  /** [m] */
  position: number[] | null;
  /** 0 along axes that were not measured [m/s] */
  velocity_change: number[] | null;
}

/** Triangles. */
export interface Mesh {
  kind: "mesh";
  /** float32 (k, 3) in body axes [m] */
  vertices: Block;
  /** int32 (t, 3), counter-clockwise from outside */
  triangles: Block;
}

/** How far a rollout is from what was observed of an object. */
export interface Misfit {
  object: string;
  /** float32 (F,) [s] */
  times: Block;
  /** float32 (F,) [m], NaN where nothing was observed */
  distance: Block;
  /** float32 (F,) in standard deviations of the measurement, NaN where unknown */
  sigmas: Block;
  /** root mean square distance [m] */
  rms: number | null;
}

/** An object that moves: a column of every rollout. */
export interface Moving {
  name: string;
  kind: "rigid" | "rope" | "cloth" | "soft" | "fluid";
  /** #rrggbb */
  color: string;
  /** [kg] */
  mass: number | null;
  /** of a rigid object */
  shape: Sphere | Box | Cylinder | Capsule | Mesh | Plane | null;
  /** its shape in words, where that says more than `shape`: 5 boxes */
  form: string;
  /** of a rope's line or a fluid's particle [m] */
  radius: number | null;
  /** int32 (s, 2): points that a rope joins */
  segments: Block | null;
  /** int32 (t, 3): points that are corners of cloth or of a soft surface */
  triangles: Block | null;
  /** when it joins the world [s] */
  start_time: number;
}

/** A record that results rest on. */
export interface Node {
  id: string;
  kind: "case" | "observation" | "world" | "fit" | "rollout" | "evidence" | "answer";
  /** a word or two */
  title: string;
  /** a sentence */
  detail: string;
}

/** Outlines of all objects seen in the video. */
export interface Observed {
  id: string;
  /** int32 (F,): frame numbers that were looked at */
  frames: Block;
  objects: Outlined[];
  /** float32 (F, 2, 3): maps from the first frame's pixels to each frame's; null: none */
  camera_motion: Block | null;
}

/** The outlines of one observed object. */
export interface Outlined {
  name: string;
  /** #rrggbb */
  color: string;
  /** uint16 (p, 2): corners of polygons, pixels of the original frame */
  points: Block;
  /** int32 (q + 1,): where each polygon begins in points */
  starts: Block;
  /** int32 (q,): the frame of each polygon, ascending */
  frames: Block;
  /** one a frame of `Observed.frames` */
  status: string[];
  /** float32 (F,) */
  confidence: Block;
}

/** A half space; points with normal · p <= offset are solid. */
export interface Plane {
  kind: "plane";
  normal: number[];
  /** [m] */
  offset: number;
}

/** From the answers back to the pixels. */
export interface Provenance {
  nodes: Node[];
  edges: Edge[];
}

/** A series of a rollout. */
export interface Quantity {
  /** kinetic_energy, potential_energy, largest_tension, volume, ... */
  name: string;
  object: string;
  unit: string;
  /** float32 (T,) */
  values: Block;
}

/** A box of space that means something: a fluid's grid, a container, an emitter, a drain. */
export interface Region {
  name: string;
  kind: string;
  /** [m] */
  lower: number[];
  /** [m] */
  upper: number[];
  /** rigid object that carries it; null: it stays */
  object: string | null;
}

/** A world run forward. */
export interface RolloutView {
  id: string;
  world: string;
  label: string;
  /** rollout of the unedited world; null where this is one, or it was not run */
  base: string | null;
  /** empty where it is no branch */
  edits: EditWords[];
  status: "completed" | "diverged" | "truncated";
  why_ended: string | null;
  /** [s] */
  horizon: number;
  /** columns: all of the world's moving objects */
  names: string[];
  /** float32 (T,) [s] */
  times: Block;
  /** float32 (T, n, 3) [m] */
  positions: Block;
  /** float32 (T, n, 4) w, x, y, z */
  orientations: Block;
  /** float32 (T, n, 3) [m/s] */
  velocities: Block;
  /** float32 (T, n, 3) [rad/s] */
  spins: Block;
  /** uint8 (T, n) */
  active: Block;
  deformed: Deformed[];
  quantities: Quantity[];
  events: EventMark[];
  pushes: EffectPush[];
  /** empty for branches, which are meant to differ */
  misfits: Misfit[];
  /** empty, or how the samples shown were chosen from those stored */
  sampled: string;
  /** null where no ensemble of the world is stored */
  spread: Spread | null;
}

/** Work that is not finished. */
export interface Running {
  evidence: string;
  tool: string;
  message: string;
  done: number;
  total: number | null;
  seconds_left: number | null;
  curve: Curve | null;
}

/** An event that both rollouts have, at different times. */
export interface ShiftedEvent {
  /** as it is in base */
  event: EventMark;
  /** how much later it is in edited [s] */
  shift: number;
}

/** A ball. */
export interface Sphere {
  kind: "sphere";
  /** [m] */
  radius: number;
}

/** Where the members of an ensemble of the same world are: the 5% and 95% quantiles of each coordinate. */
export interface Spread {
  members: number;
  /** float32 (S,) [s] */
  times: Block;
  /** float32 (S, n, 3) [m], NaN where no member has the object */
  low: Block;
  /** float32 (S, n, 3) [m] */
  high: Block;
}

/** All objects of a world where they begin: one sample, as of a rollout. */
export interface Start {
  /** all of the world's moving objects */
  names: string[];
  /** float32 (1,), 0 */
  times: Block;
  /** float32 (1, n, 3) [m], NaN where the world does not say where */
  positions: Block;
  /** float32 (1, n, 4) w, x, y, z */
  orientations: Block;
  /** uint8 (1, n), all 1: those too that join the world later */
  active: Block;
  deformed: Deformed[];
}

/** A fixed solid. */
export interface Static {
  name: string;
  color: string;
  shape: Sphere | Box | Cylinder | Capsule | Mesh | Plane;
  /** [m] */
  position: number[];
  /** w, x, y, z */
  orientation: number[];
}

/** Measured positions of one run. */
export interface Tracks {
  id: string;
  /** empty where there is but one */
  run: string;
  names: string[];
  /** float32 (T,) [s], in the time base of the worlds that model it */
  times: Block;
  /** float32 (T, n, 3) [m], NaN where there is none */
  positions: Block;
  /** float32 (T, n) standard deviation of a coordinate [m], NaN where unknown */
  sigma: Block;
  /** time from which on they were held out of fits [s] */
  held_out_from: number | null;
}

/** A number with its unit. */
export interface Value {
  name: string;
  value: number;
  /** 1 where it has none */
  unit: string;
}

/** A world. */
export interface WorldView {
  id: string;
  /** a few words: as built, as fitted, without blue_cube */
  label: string;
  /** built, fitted, intervention, effect, ... */
  origin: string;
  parent: string | null;
  committed: boolean;
  planar: boolean;
  seconds_per_frame: number;
  /** observed frames that it models; 0: none */
  frame_count: number;
  gravity: number[];
  camera: CameraView | null;
  moving: Moving[];
  statics: Static[];
  joints: JointMark[];
  regions: Region[];
  effects: EffectMark[];
  /** the plane that planar objects slide on; null where there is none */
  floor: Plane | null;
  /** of objects, joints, effects: ball.mass, ... */
  parameters: Value[];
  /** null where no fit made it */
  follows: Following | null;
  /** null where a rollout of it is shown, which has its start */
  start: Start | null;
}

/** Everything that the viewer shows of one case. */
export interface ViewDocument {
  format: "atw-view/1";
  /** atw-mcp and its version */
  made_by: string;
  case: CaseView;
  /** what is not shown, and why; one sentence each */
  missing: string[];
  film: Film | null;
  observed: Observed | null;
  tracks: Tracks[];
  /** oldest first */
  worlds: WorldView[];
  /** oldest first */
  rollouts: RolloutView[];
  comparisons: ComparisonView[];
  fits: FitView[];
  gaps: GapView[];
  /** oldest first */
  evidence: EvidenceRow[];
  provenance: Provenance;
  running: Running[];
  /** ids of one or two rollouts to open with; empty: the viewer chooses */
  shown: string[];
}
