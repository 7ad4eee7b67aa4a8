// The world in three dimensions: one rollout, two side by side, or one with the other as a ghost.
import { effect, signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { type Lane, visibleLanes } from "../events";
import { quantity, words } from "../format";
import { Ruler, RulerButton } from "../ruler";
import { PictureButton } from "../save";
import { Axes, axesOf } from "../scene/axes";
import { palette } from "../scene/palette";
import { Stage, type Statistics } from "../scene/stage";
import { videoFrame } from "../scene/eyes";
import { roundLength } from "../scene/floor";
import { CUT, type EffectKey, type Scale } from "../scene/pushes";
import { atStart, NO_WORLD } from "../scene/start";
import type { Shown } from "../scene/view";
import {
  eye,
  followed,
  followedTrack,
  layout,
  object,
  opened,
  other,
  otherWorld,
  rollout,
  time,
  world,
  type Eye,
} from "../state";
import "./scene.css";

const shown = signal<Shown>({ names: true, trails: true, joints: true, effects: true, events: true, observed: true });
const SWITCHES: { key: keyof Shown; title: string }[] = [
  { key: "names", title: "Names" },
  { key: "trails", title: "Paths" },
  { key: "joints", title: "Joints and regions" },
  { key: "effects", title: "Effects" },
  { key: "events", title: "Events" },
  { key: "observed", title: "Observed positions" },
];
const EYES: { value: Eye; title: string; hint: string }[] = [
  { value: "orbit", title: "Orbit", hint: "Turn freely (O): drag, or arrow keys; +, − to zoom, Shift to move" },
  { value: "video", title: "Camera", hint: "As the video's camera sees it (V)" },
  { value: "plan", title: "Plan", hint: "Straight on the plane of motion (P)" },
];

/** What lies over the canvas and depends on the eye. */
interface Over {
  axes: ReturnType<typeof axesOf> | null;
  bar: { pixels: number; text: string } | null;
  windows: { x: number; y: number; width: number; height: number }[];
  frame: [number, number, number, number] | null;
}
const over = signal<Over>({ axes: null, bar: null, windows: [], frame: null });
/** What the legend says. fast: speeds of the lightest particles of fluids [m/s]. */
interface Notes {
  keys: EffectKey[];
  missing: string[];
  grid: string;
  fast: [string, number][];
}
const notes = signal<Notes>({ keys: [], missing: [], grid: "", fast: [] });
/** Effects named in the legend: pulses of collisions may be many, and would cover the scene. */
const MOST_KEYS = 5;
/** Why there is no canvas; "" where there is one. */
const trouble = signal("");
const stage = signal<Stage | null>(null);
const measuring = signal(false);

export function Scene() {
  const host = useRef<HTMLDivElement>(null);
  const labels = useRef<HTMLDivElement>(null);
  useEffect(() => start(host.current!, labels.current!), []);
  const camera = world.value?.camera ?? null;
  const { axes, bar, windows, frame } = over.value;
  const { keys, missing, grid, fast } = notes.value;
  const listed = keys.length > MOST_KEYS ? keys.filter((k) => k.arrows || k.field).slice(0, MOST_KEYS) : keys;
  return (
    <section class="panel scene" aria-label="scene">
      <div class="bar">
        <div class="choice" role="group" aria-label="eye">
          {EYES.map(({ value, title, hint }) => (
            <button
              key={value}
              aria-pressed={eye.value === value}
              disabled={value === "video" && !camera}
              title={value === "video" && !camera ? "This world has no camera" : hint}
              onClick={() => (eye.value = value)}
            >
              {title}
            </button>
          ))}
        </div>
        <button title="Fit the whole motion into view (Home)" onClick={() => stage.value?.reset()}>
          Fit
        </button>
        {followed.value !== null && eye.value !== "video" && (
          <button class="follow" title="Stop following (F)" onClick={() => (followed.value = null)}>
            Following {words(followed.value)} ×
          </button>
        )}
        <span class="push" />
        <RulerButton on={measuring} />
        <PictureButton name="scene" canvas={() => stage.value?.picture} />
        <details class="show">
          <summary>Show</summary>
          <div>
            {SWITCHES.map(({ key, title }) => (
              <label key={key}>
                <input
                  type="checkbox"
                  checked={shown.value[key]}
                  onChange={(e) => (shown.value = { ...shown.value, [key]: e.currentTarget.checked })}
                />
                {title}
              </label>
            ))}
          </div>
        </details>
      </div>
      <div
        class="canvas"
        ref={host}
        tabIndex={0}
        role="application"
        aria-label={`Scene of ${world.value?.label ?? "the world"}: arrow keys turn, plus and minus zoom, Home fits`}
        onKeyDown={(e) => {
          if (e.target === e.currentTarget && stage.value?.eyes.press(e)) e.preventDefault();
        }}
      >
        <div class="labels" ref={labels} aria-hidden="true" />
        {frame &&
          windows.map((w, i) => (
            <div key={i} class="window" style={placed(w.x, w.y, w.width, w.height)}>
              <div class="frame" style={placed(...frame)} />
            </div>
          ))}
        {layout.value !== "one" &&
          other.value &&
          windows.map((w, i) => (
            <p
              key={i}
              class={`title ${i ? "branch" : "base"}`}
              style={{ left: `${w.x}px`, top: `${w.y}px`, maxWidth: `${w.width}px` }}
            >
              {i ? other.value!.label : rollout.value?.label}
              {windows.length === 1 && <span class="branch">ghost: {other.value!.label}</span>}
            </p>
          ))}
        {windows.length > 1 && (
          <div
            class={windows[1]!.x ? "divider" : "divider flat"}
            style={{ left: `${windows[1]!.x}px`, top: `${windows[1]!.y}px` }}
          />
        )}
        {axes && <Axes {...axes} />}
        {bar && (
          <p class="scale" data-pixels={bar.pixels}>
            <i style={{ width: `${bar.pixels}px` }} />
            {bar.text}
          </p>
        )}
        <div class="legend">
          {listed.flatMap((k) => [
            (k.arrows || !k.field) && (
              <p key={k.name} data-effect={k.name} data-full={k.arrows?.full}>
                <b>{words(k.name)}</b>
                {k.title && ` (${words(k.title)})`}
                {k.enabled ? "" : " (disabled)"} {k.arrows ? scaleText(k.arrows) : "pushes no object"}
                {k.arrows && <i class="arrow" style={{ color: k.color }} />}
              </p>
            ),
            k.field && !sameScale(k) && (
              <p key={`${k.name} field`} data-effect={k.name} data-field-full={k.field.full}>
                <b>{words(k.name)}</b>
                {k.title && !k.arrows && ` (${words(k.title)})`} in space {scaleText(k.field)}
                <i class="arrow pale" style={{ color: k.color }} />
              </p>
            ),
          ])}
          {listed.length < keys.length && <p>and {keys.length - listed.length} more effects</p>}
          {fast.map(([name, speed]) => (
            <p key={`${name} speed`} class="grid">
              {words(name)}: lighter where faster, lightest from {quantity(speed, "m/s", 2)}
            </p>
          ))}
          {grid && <p class="grid">{grid}</p>}
          {missing.map((m) => (
            <p key={m} class="missing">
              {m}
            </p>
          ))}
        </div>
        {measuring.value && stage.value && <Ruler key={eye.value} locate={(x, y) => stage.value!.metres(x, y)} />}
        {trouble.value && (
          <p class="trouble" role="alert">
            {trouble.value}
          </p>
        )}
      </div>
    </section>
  );
}

function placed(left: number, top: number, width: number, height: number) {
  return { left: `${left}px`, top: `${top}px`, width: `${width}px`, height: `${height}px` };
}

/** Whether arrows on objects and those in space are as long for as much: one line says both. */
function sameScale({ arrows, field }: EffectKey): boolean {
  return arrows !== null && field !== null && scaleText(arrows) === scaleText(field);
}

/** What the arrow beside it stands for, and that stronger ones are cut off. */
function scaleText({ full, most, unit }: Scale): string {
  const cut = most > 1.001 * CUT * full ? `, stronger cut off (most ${quantity(most, unit, 3)})` : "";
  return `scale: full arrow ${quantity(full, unit, 3)}${cut}`;
}

/** Put a canvas into `host` and keep it in step with the page; returns what ends that. */
function start(host: HTMLElement, labels: HTMLElement): () => void {
  let made: Stage;
  try {
    made = new Stage(host, labels, { picked: (name) => (object.value = name), drawn });
  } catch (error) {
    const why = error instanceof Error ? error.message : String(error);
    trouble.value = `The scene needs WebGL 2, which this browser does not offer (${why}). All other panels work without it.`;
    return () => {};
  }
  trouble.value = "";
  stage.value = made;
  const ends = [
    effect(() => {
      const [doc, here, there] = [opened.value, world.value, otherWorld.value];
      if (!doc) return;
      const [run, tracks] = [rollout.value, followedTrack.value];
      const last = here ?? NO_WORLD;
      const compared = other.value && there ? { world: there, rollout: other.value } : null;
      made.show(
        {
          opened: doc,
          shown: { world: last, rollout: run ?? atStart(last) },
          other: compared,
          arrangement: compared ? layout.value : "one",
          tracks,
        },
        palette(),
      );
      const missing = [...new Set(made.views.flatMap((v) => v.missing))];
      if (!run && here) missing.unshift(`not run yet: objects of “${here.label}” are where they begin`);
      const first = made.views[0];
      const grid = first ? `grid ${quantity(first.cell, "m", 1)} ${first.gridNote}` : "";
      const keys = made.views.flatMap((v) => v.keys);
      const once = keys.filter((k, i) => keys.findIndex((o) => o.name === k.name) === i);
      notes.value = { keys: once, missing, grid, fast: [...(first?.meshes.speeds ?? [])] };
    }),
    effect(() => {
      const of = (role: Lane["role"]) => visibleLanes.value.find((lane) => lane.role === role)?.marks ?? [];
      made.setEvents(of("base"), of("branch"));
    }),
    effect(() => made.setTime(time.value)),
    effect(() => made.choose(object.value)),
    effect(() => made.follow(followed.value)),
    effect(() => made.setShown(shown.value)),
    effect(() => made.setEye(eye.value)),
  ];
  return () => {
    for (const end of ends) end();
    stage.value = null;
    made.dispose();
  };
}

/** A scale bar of a round length near this many pixels. */
const BAR = 90;

let before = "";
function drawn(made: Stage): void {
  const camera = made.eyes.camera;
  const first = made.window(0);
  const metres = made.eyes.metresPerPixel;
  const round = roundLength(BAR * metres);
  const view = made.camera;
  const next: Over = {
    axes: axesOf(camera, world.value?.gravity ?? null),
    bar: { pixels: Math.round((10 * round) / metres) / 10, text: quantity(round, "m", 1) },
    windows: made.views.map((_, i) => made.window(i)),
    frame: made.eyes.kind === "video" && view ? videoFrame(view, first.width, first.height) : null,
  };
  const text = JSON.stringify(next);
  if (text === before) return;
  before = text;
  over.value = next;
}

declare global {
  // for tests and measurements: frames drawn, draw calls, milliseconds
  var __atw: Statistics | undefined;
}
