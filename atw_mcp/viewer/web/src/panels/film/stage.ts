// The film with what is drawn over it: follows the signals of the page and draws when one of them changes.
import { computed, effect, signal } from "@preact/signals";
import type { RolloutView, WorldView } from "../../document";
import { words } from "../../format";
import {
  duration,
  frame,
  frameClock,
  nearestFrame,
  object,
  other,
  otherWorld,
  playing,
  rollout,
  speed,
  world,
} from "../../state";
import { planeOfMotion } from "../../scene/plane_of_motion";
import type { Opened } from "../../unpack";
import { COMPARED, DASHES, OBSERVED, SHOWN, Sheet, type Ink } from "./drawing";
import { FrameTimes } from "./frame_times";
import { KEPT, Labeller, SimulatedOutlines, type SeenObject } from "./labels";
import { Outlines, type Outline } from "./outlines";
import { Paths } from "./paths";
import { Pinhole, type Motion } from "./pinhole";
import { Player } from "./player";
import { nameLayer, observedLayer, pathLayer, worldLayer } from "./shown";

export interface Size {
  width: number;
  height: number;
}

/** What is drawn now. */
export interface Drawn {
  /** Frame of the video; null beyond it. */
  frame: number | null;
  /** Time for which the simulated worlds are drawn [s]. */
  time: number;
  observed: string[];
  simulated: string[];
  /** Why something that was asked for is not drawn; "" where nothing is missing. */
  missing: string;
}

/** What is under the pointer. */
export interface Hit {
  name: string;
  lines: string[];
}

interface Run {
  world: WorldView;
  rollout: RolloutView;
  ink: Ink;
  outlines: SimulatedOutlines | null;
  paths: Paths;
}

export class Stage {
  readonly drawn = signal<Drawn>({ frame: 0, time: 0, observed: [], simulated: [], missing: "" });
  readonly size: Size;
  private readonly outlines: Outlines | null;
  private readonly times: FrameTimes | null;
  private readonly ended: (() => void)[] = [];
  private readonly player = signal<Player | null>(null);
  private readonly screen = signal({ width: 0, height: 0, ratio: 1 });
  private readonly probe = new OffscreenCanvas(1, 1).getContext("2d")!;
  private labeller: Labeller | null = null;
  private noLabels = "";
  private runs: Run[] = [];
  private seen: { outlines: Outline[]; simulated: [Run, SeenObject[]][] } = { outlines: [], simulated: [] };

  /** Frames of the film, or those that were observed where there is no film. */
  private readonly count: number;
  /** The frame shown: the one on screen while there is one, else the one nearest to the clock, also beyond the video. */
  private readonly place = computed(() => {
    const nearest = nearestFrame.value;
    return nearest > this.count - 1 ? nearest : (this.player.value?.frame.value ?? nearest);
  });
  /** Counts outlines of the world that came in after they were asked for. */
  private readonly arrived = signal(0);
  private making = false;
  private gone = false;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly opened: Opened,
  ) {
    const doc = opened.document;
    this.outlines = doc.observed && new Outlines(opened, doc.observed);
    this.times = doc.film && new FrameTimes(opened.numbers(doc.film.media_times));
    this.size = sizeOf(opened, this.outlines);
    this.count = doc.film?.frame_count ?? lastFrame(opened) + 1;
    const resize = new ResizeObserver(() => this.measure());
    resize.observe(canvas);
    this.measure();
    this.ended.push(
      () => resize.disconnect(),
      effect(() => this.lead()),
      effect(() => this.draw()),
    );
  }

  /** Play a video element in step with the page's clock; null: there is none, or it cannot be played. */
  attach(video: HTMLVideoElement | null): void {
    this.player.peek()?.dispose();
    this.player.value = video && this.times && new Player(video, this.times);
  }

  dispose(): void {
    this.gone = true;
    for (const end of this.ended) end();
    this.player.peek()?.dispose();
    for (const run of this.runs) run.outlines?.dispose();
    this.labeller?.dispose();
  }

  /** What is at a place of the canvas [px of the screen from its corner]. */
  hit(x: number, y: number): Hit | null {
    const scale = this.screen.peek().width / this.size.width;
    if (!(scale > 0)) return null;
    const [u, v] = [x / scale - 0.5, y / scale - 0.5];
    const inside = (path: Path2D) => this.probe.isPointInPath(path, u, v, "evenodd");
    const outline = this.seen.outlines.find((o) => inside(o.path));
    const simulated = this.seen.simulated.flatMap(([run, objects]) =>
      objects.filter((o) => inside(o.path)).map((o) => ({ run, name: o.name })),
    );
    const name = simulated[0]?.name ?? (outline && this.objectOf(outline.name));
    if (!name) return null;
    const lines = simulated.filter((s) => s.name === name).map((s) => `simulated ${s.run.rollout.label}`);
    if (outline) {
      const sure = Number.isFinite(outline.confidence) ? `, confidence ${outline.confidence.toFixed(2)}` : "";
      const as = this.objectOf(outline.name) === name ? "" : ` as ${outline.name}`;
      lines.unshift(`observed${as}: ${outline.status}${sure}`);
    }
    return { name, lines };
  }

  /** Where in the plane of motion a place of the canvas lies [m]; null where no camera says. */
  metres(x: number, y: number): number[] | null {
    const [run, its] = [rollout.peek(), world.peek()];
    if (!its?.camera) return null;
    const scale = this.screen.peek().width / this.size.width;
    const eye = new Pinhole(its.camera, this.motion(this.place.peek()));
    return eye.meets(x / scale - 0.5, y / scale - 0.5, planeOfMotion(this.opened, its, run))?.toArray() ?? null;
  }

  /** Name in the world of a track. */
  private objectOf(track: string): string {
    const bound = this.opened.document.case.bindings.find((b) => b.track === track && b.object);
    return bound?.object ?? track;
  }

  private measure(): void {
    const box = this.canvas.getBoundingClientRect();
    const ratio = Math.min(window.devicePixelRatio || 1, 3);
    const before = this.screen.peek();
    if (before.width === box.width && before.height === box.height && before.ratio === ratio) return;
    this.canvas.width = Math.max(1, Math.round(box.width * ratio));
    this.canvas.height = Math.max(1, Math.round(box.height * ratio));
    this.screen.value = { width: box.width, height: box.height, ratio };
  }

  /** Keep the video in step with the clock. */
  private lead(): void {
    const step = frameClock.value.interval;
    this.player.value?.follow(frame.value, playing.value ? speed.value / step : 0);
  }

  private draw(): void {
    const context = this.canvas.getContext("2d");
    const { width, ratio } = this.screen.value;
    if (!context || width === 0) return;
    const place = this.place.value;
    const shown = place < this.count ? place : null;
    const t = frameClock.value.time(place);
    void this.arrived.value;
    const sheet = new Sheet(context, width / this.size.width, this.size.width, this.size.height);
    sheet.clear(ratio);
    if (shown === null) sheet.dim();
    const missing: string[] = [];
    this.seen = {
      outlines: observedLayer.on.value ? this.observedAt(shown, missing) : [],
      simulated: this.simulatedAt(t, missing),
    };
    this.paint(sheet, t, this.motion(place));
    void this.makeAhead();
    const next: Drawn = {
      frame: shown,
      time: t,
      observed: this.seen.outlines.map((o) => o.name),
      simulated: this.seen.simulated.flatMap(([, objects]) => objects.map((o) => o.name)),
      missing: missing.join("; "),
    };
    queueMicrotask(() => (this.drawn.value = next));
  }

  private observedAt(shown: number | null, missing: string[]): Outline[] {
    if (!this.outlines || shown === null) return [];
    if (!this.outlines.has(shown)) missing.push(`frame ${shown} was not looked at`);
    return this.outlines.at(shown);
  }

  /** Outlines of the rollouts shown; paths and names need them prepared as well. */
  private simulatedAt(t: number, missing: string[]): [Run, SeenObject[]][] {
    const wanted: [RolloutView | null, WorldView | null, Ink][] = [
      [rollout.value, world.value, { color: SHOWN, dash: DASHES.shown, width: 2 }],
      [other.value, otherWorld.value, { color: COMPARED, dash: DASHES.compared, width: 2 }],
    ];
    const runs: Run[] = [];
    for (const [run, its, ink] of wanted) {
      if (!run || !its) continue;
      if (its.camera) runs.push(this.run(run, its, ink));
      else if (worldLayer.on.value || pathLayer.on.value) missing.push("the world has no camera: it cannot be drawn over the video");
    }
    for (const old of this.runs) if (!runs.includes(old)) old.outlines?.dispose();
    this.runs = runs;
    if (!worldLayer.on.value) return runs.map((run) => [run, []]);
    if (this.noLabels) missing.push(this.noLabels);
    return runs.map((run) => [run, run.outlines?.at(t) ?? []]);
  }

  /** Make outlines of the world that are missing, one after another: of the frame shown, then of those that follow. */
  private async makeAhead(): Promise<void> {
    if (this.making) return;
    this.making = true;
    for (let next = this.nextMissing(); next && !this.gone; next = this.nextMissing()) {
      const { run, place } = next;
      try {
        await run.outlines!.make(frameClock.peek().time(place), this.motion(place));
      } catch {
        // the context of WebGL is gone: with this stage, as another document is shown, or by the browser's doing
        if (!this.gone) this.noLabels = "the world is not drawn over the video: the browser gave up WebGL";
        break;
      }
      if (place === this.place.peek()) this.arrived.value++;
    }
    this.making = false;
  }

  private nextMissing(): { run: Run; place: number } | null {
    if (!worldLayer.on.peek()) return null;
    const from = this.place.peek();
    const clock = frameClock.peek();
    const count = Math.min(KEPT - 1, Math.round(clock.frame(duration.peek())) + 1);
    for (let ahead = 0; ahead < count; ahead++) {
      const place = (from + ahead) % Math.max(count, from + 1);
      const run = this.runs.find((r) => r.outlines && !r.outlines.at(clock.time(place)));
      if (run) return { run, place };
    }
    return null;
  }

  private run(view: RolloutView, its: WorldView, ink: Ink): Run {
    const known = this.runs.find((r) => r.rollout === view && r.ink.color === ink.color);
    if (known) return known;
    let outlines: SimulatedOutlines | null = null;
    try {
      this.labeller ??= new Labeller(this.size.width, this.size.height);
      outlines = new SimulatedOutlines(this.labeller, this.opened, its, view);
    } catch {
      this.noLabels = "this browser has no WebGL: outlines of the world are not drawn";
    }
    return { world: its, rollout: view, ink, outlines, paths: new Paths(this.opened, its, view) };
  }

  private paint(sheet: Sheet, t: number, motion: Motion | undefined): void {
    const picked = object.value;
    for (const outline of this.seen.outlines) {
      if (this.objectOf(outline.name) === picked) sheet.fill(outline.path, OBSERVED, 0.22);
    }
    const runs = [...this.seen.simulated].reverse(); // the rollout shown over the one it is compared with
    for (const [run, objects] of runs) {
      for (const { name, path } of objects) {
        if (name === picked) sheet.fill(path, run.ink.color, 0.22);
        sheet.stroke(path, name === picked ? { ...run.ink, width: run.ink.width + 1.5 } : run.ink);
      }
    }
    if (pathLayer.on.value) for (const [run] of runs) this.paintPaths(sheet, run, t, motion);
    const dashed: Ink = { color: OBSERVED, dash: DASHES.observed, width: 2 };
    for (const { name, path } of this.seen.outlines) {
      sheet.stroke(path, this.objectOf(name) === picked ? { ...dashed, width: 3.5 } : dashed);
    }
    if (nameLayer.on.value) this.paintNames(sheet, picked);
  }

  private paintPaths(sheet: Sheet, run: Run, t: number, motion: Motion | undefined): void {
    const eye = new Pinhole(run.world.camera!, motion);
    for (const { path, end } of run.paths.until(t, eye)) {
      sheet.stroke(path, { ...run.ink, width: 1.2 });
      if (end) sheet.dot(end[0], end[1], run.ink.color);
    }
  }

  private paintNames(sheet: Sheet, picked: string | null): void {
    const written = new Set<string>();
    const write = (name: string, box: Outline["box"], color: string) => {
      if (written.has(name)) return;
      written.add(name);
      sheet.name(words(name), box, color, name === picked);
    };
    for (const { name, box } of this.seen.outlines) write(this.objectOf(name), box, OBSERVED);
    for (const [run, objects] of this.seen.simulated) {
      for (const { name, box } of objects) write(name, box, run.ink.color);
    }
  }

  /** How the camera has moved by a frame: as in the last one before it that was looked at. */
  private motion(place: number): Motion | undefined {
    const observed = this.opened.document.observed;
    if (!observed?.camera_motion || !this.outlines) return undefined;
    const at = Math.min(place, this.count - 1);
    const frames = this.opened.numbers(observed.frames);
    let row = this.outlines.row(at);
    if (row === undefined) row = Math.max(0, frames.findLastIndex((f: number) => f <= at));
    return this.motions.get(row) ?? this.readMotion(row);
  }

  private readonly motions = new Map<number, Motion>();

  private readMotion(row: number): Motion {
    const moved = this.opened.floats(this.opened.document.observed!.camera_motion!).slice(6 * row, 6 * row + 6);
    this.motions.set(row, moved);
    return moved;
  }
}

/** Size of the frames that pixels refer to, as far as the document says [px]. */
function sizeOf(opened: Opened, outlines: Outlines | null): Size {
  const doc = opened.document;
  const known = doc.film ?? doc.worlds.findLast((w) => w.camera)?.camera;
  if (known) return { width: known.width, height: known.height };
  const [width, height] = outlines?.extent ?? [16, 9];
  return { width, height };
}

function lastFrame(opened: Opened): number {
  const observed = opened.document.observed;
  const frames = observed ? opened.numbers(observed.frames) : [];
  return frames.length ? frames[frames.length - 1]! : -1;
}
