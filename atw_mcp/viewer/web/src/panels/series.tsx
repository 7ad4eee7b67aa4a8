// Series of objects over time, linked to the clock: the pointer reads values, a click goes to that moment.
import type uPlot from "uplot";
import { computed, signal, useSignalEffect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { RolloutView } from "../document";
import { digits, moment, words } from "../format";
import { legible } from "../legible";
import { drawn, PictureButton, TableButton, VectorButton } from "../save";
import { document, duration, object, observedRun as run, other, otherWorld, rollout, time, track, world } from "../state";
import { dark } from "../theme";
import { Chart, type ChartOf } from "./chart";
import { LargestResiduals } from "./largest_residuals";
import { along, axisText, Phase } from "./phase";
import {
  bandOf,
  holders,
  measures,
  nearestValue,
  observationsOf,
  pointsOf,
  valueAt,
  type Measure,
  type Points,
} from "./series_data";
import { plot, type Band, type Dots, type Line } from "./series_plot";
import { view, zoomed } from "./timeline_view";
import "./series.css";

/** Objects shown where none has been chosen: as many lines as can be distinguished at a glance. */
const AT_FIRST = 3;

const measureName = signal("speed");
/** Name of the measure along the horizontal axis; "": time. */
const acrossName = signal("");
/** Names added to the chosen object. */
const pinned = signal<ReadonlySet<string>>(new Set());
/** Moment under the pointer [s]. */
const pointed = signal<number | null>(null);

const rollouts = computed(() => {
  const found = [rollout.value, other.value].filter((r): r is RolloutView => r !== null);
  return found[0]?.id === found[1]?.id ? found.slice(0, 1) : found;
});
const tracks = computed(() => document.value?.tracks ?? []);
const choices = computed(() => measures(rollouts.value, tracks.value));
const measure = computed(() => choices.value.find((m) => m.name === measureName.value) ?? choices.value[0] ?? null);
const across = computed(() => choices.value.find((m) => m.name === acrossName.value) ?? null);
const names = computed(() => (measure.value ? holders(measure.value, rollouts.value, tracks.value) : []));
const shown = computed(() => {
  const picked = names.value.filter((name) => pinned.value.has(name) || object.value === name);
  return picked.length ? picked : names.value.slice(0, AT_FIRST);
});
const colors = computed(
  () =>
    new Map(
      [
        ...(document.value?.observed?.objects ?? []),
        ...(document.value?.worlds.at(-1)?.moving ?? []), // before a rollout
        ...(otherWorld.value?.moving ?? []),
        ...(world.value?.moving ?? []),
      ].map((m) => [m.name, m.color]),
    ),
);

interface Drawn extends Line {
  rollout: RolloutView;
}

const lines = computed<Drawn[]>(() =>
  rollouts.value.flatMap((r, k) =>
    shown.value.flatMap((name) => {
      const points = pointsOf(measure.value!, r, name);
      if (!points) return [];
      const label = k === 0 ? words(name) : `${words(name)} (compared)`;
      return [{ object: name, label, color: colorOf(name), dashed: k > 0, points, rollout: r }];
    }),
  ),
);
const dots = computed<Dots[]>(() =>
  shown.value.flatMap((name) => {
    const observed = track.value && measure.value ? observationsOf(measure.value, track.value, name) : null;
    return observed ? [{ object: name, color: colorOf(name), observed }] : [];
  }),
);

const bands = computed<Band[]>(() =>
  rollouts.value.flatMap((r) =>
    shown.value.flatMap((name) => {
      const band = measure.value && bandOf(measure.value, r, name);
      return band ? [{ ...band, color: colorOf(name) }] : [];
    }),
  ),
);
const traces = computed(() =>
  across.value && measure.value ? along(across.value, measure.value, rollouts.value, shown.value, colorOf) : [],
);

function colorOf(name: string): string {
  return colors.value.get(name) ?? "#808080";
}

export function Series() {
  if (!measure.value) return <p class="empty">There are neither rollouts nor tracks to draw.</p>;
  return (
    <div class="series">
      <Controls />
      <LargestResiduals />
      <div class="body">
        {across.value ? <Phase x={across.value} y={measure.value} traces={traces.value} /> : <Plot />}
        <Values measure={measure.value} />
      </div>
    </div>
  );
}

function Controls() {
  const several = tracks.value.length > 1 && measure.value?.coordinate !== undefined;
  return (
    <div class="bar controls">
      <label>
        <span class="soft">Quantity</span>
        <select
          name="quantity"
          value={measure.value!.name}
          onChange={(event) => (measureName.value = event.currentTarget.value)}
        >
          {choices.value.map((m) => (
            <option key={m.name} value={m.name}>
              {axisText(m)}
            </option>
          ))}
        </select>
      </label>
      <label>
        <span class="soft">against</span>
        <select name="against" value={across.value?.name ?? ""} onChange={(event) => (acrossName.value = event.currentTarget.value)}>
          <option value="">time [s]</option>
          {choices.value.map((m) => (
            <option key={m.name} value={m.name}>
              {axisText(m)}
            </option>
          ))}
        </select>
      </label>
      {several && (
        <label>
          <span class="soft">Observed run</span>
          <select value={String(run.value)} onChange={(event) => (run.value = Number(event.currentTarget.value))}>
            {tracks.value.map((t, k) => (
              <option key={k} value={String(k)}>
                {t.run || t.id}
              </option>
            ))}
          </select>
        </label>
      )}
      <div class="which scroll" role="group" aria-label="objects drawn">
        {names.value.map((name) => (
          <button key={name} aria-pressed={shown.value.includes(name)} data-object={name} onClick={() => toggle(name)}>
            <span class="swatch" style={{ background: colorOf(name) }} />
            {words(name)}
          </button>
        ))}
      </div>
      <span class="push" />
      {bands.value.length > 0 && !across.value && (
        <span class="small soft" data-members={rollouts.value.find((r) => r.spread)?.spread?.members}>
          band: 90 % of {rollouts.value.find((r) => r.spread)?.spread?.members} members
        </span>
      )}
      <TableButton name={fileName()} rows={rows} />
      <PictureButton
        name={fileName()}
        canvas={() => (across.value ? drawn(<Chart {...chart()} />) : window.document.querySelector<HTMLCanvasElement>(".series canvas"))}
      />
      <VectorButton name={fileName()} drawing={() => <Chart {...chart()} />} />
      {zoomed.value && !across.value && (
        <button onClick={() => (zoomed.value = null)}>
          All of time
        </button>
      )}
    </div>
  );
}

function fileName(): string {
  return across.value ? `${measure.value!.name} against ${across.value.name}` : measure.value!.name;
}

/** What is drawn, as a plot of its own. */
function chart(): ChartOf {
  const box = window.document.querySelector(".series .plot")!.getBoundingClientRect();
  const size = { width: Math.round(box.width), height: Math.round(box.height), y: axisText(measure.value!) };
  if (across.value) {
    const equal = across.value.unit === measure.value!.unit;
    return { ...size, x: axisText(across.value), traces: traces.value, equal };
  }
  const places = (times: ArrayLike<number>, values: ArrayLike<number>, sigma?: ArrayLike<number>) =>
    Array.from(times, (t, k) => ({ x: t, y: values[k]!, sy: sigma?.[k] }));
  return {
    ...size,
    x: "time [s]",
    range: view.value,
    areas: bands.value.map(({ times, ...band }) => ({ ...band, x: times })),
    traces: [
      ...lines.value.map(({ points, ...line }) => ({ ...line, places: places(points.times, points.values) })),
      ...dots.value.map(({ color, observed: { times, values, sigma } }) => ({
        label: "",
        color,
        dots: true,
        places: places(times, values, sigma),
      })),
    ],
  };
}

/** What is drawn as a table: simulated values, then measured ones with their standard deviation. */
function rows(): (string | number)[][] {
  const { title, unit } = measure.value!;
  if (across.value)
    return [
      ["source", "object", "t [s]", `${across.value.title} [${across.value.unit}]`, `${title} [${unit}]`],
      ...traces.value.flatMap(({ source, object: name, times, places }) =>
        places.map(({ x, y }, k) => [source, name, times[k]!, x, y]),
      ),
    ];
  return [
    ["source", "object", "t [s]", `${title} [${unit}]`, "sigma"],
    ...lines.value.flatMap(({ rollout: { label }, object: name, points: { times, values } }) =>
      Array.from(times, (t, k) => [label, name, t, values[k]!, NaN]),
    ),
    ...dots.value.flatMap(({ object: name, observed: { times, values, sigma } }) =>
      Array.from(times, (t, k) => ["observed", name, t, values[k]!, sigma[k]!]),
    ),
  ];
}

/** Add an object to those drawn or take it away; what was drawn by default stays until then. */
function toggle(name: string): void {
  const next = new Set(shown.value);
  if (!next.delete(name)) next.add(name);
  else if (object.value === name) object.value = null;
  pinned.value = next;
}

function Plot() {
  const into = useRef<HTMLDivElement>(null);
  const now = useRef<HTMLDivElement>(null);
  const made = useRef<uPlot | null>(null);
  const size = useRef(signal({ width: 0, height: 0 })).current;
  useEffect(() => {
    const observer = new ResizeObserver(([entry]) => {
      const { width, height } = entry!.contentRect;
      size.value = { width: Math.floor(width), height: Math.floor(height) };
    });
    observer.observe(into.current!);
    return () => observer.disconnect();
  }, []);
  const mark = () => {
    if (!made.current || !now.current) return;
    const over = made.current.over;
    const x = made.current.valToPos(time.peek(), "x");
    now.current.style.transform = `translate(${over.offsetLeft + x}px, ${over.offsetTop}px)`;
    now.current.style.height = `${over.clientHeight}px`;
    now.current.hidden = x < 0 || x > over.clientWidth;
  };
  useSignalEffect(() => {
    void dark.value;
    void view.value;
    if (!into.current || size.value.width < 50 || !measure.value) return;
    const hover = (t: number | null) => (pointed.value = t);
    made.current = plot(into.current, size.value, measure.value, lines.value, dots.value, bands.value, { hover, drawn: mark });
    return () => {
      made.current?.destroy();
      made.current = null;
    };
  });
  useSignalEffect(() => {
    void time.value;
    mark();
  });
  return (
    <div class="plot" ref={into} role="img" aria-label={`${measure.value!.title} over time; values in the table`}>
      <div class="now" ref={now} />
    </div>
  );
}

/** The values now and under the pointer. */
function Values({ measure: m }: { measure: Measure }) {
  const t = Math.min(time.value, duration.value);
  const at = pointed.value;
  const residual = m.name === "distance" || m.name === "sigmas";
  const read = (points: Points, when: number) => (residual ? nearestValue(points, when) : valueAt(points, when));
  return (
    <div class="scroll values">
      <table data-series={m.name} data-time={t}>
        <thead>
          <tr>
            <th>{axisText(m)}</th>
            <th class="number">{moment(t)}</th>
            <th class="number pointer">{at === null ? "pointer" : moment(at)}</th>
          </tr>
        </thead>
        <tbody>
          {lines.value.map((line) => {
            const value = read(line.points, t);
            return (
              <tr
                key={`${line.rollout.id} ${line.object}`}
                data-series={m.name}
                data-object={line.object}
                data-rollout={line.rollout.id}
                data-value={value}
              >
                <td class="who">
                  <span>
                    <Sample color={line.color} dashed={line.dashed} /> {words(line.object)}
                  </span>
                  {rollouts.value.length > 1 && <div class="small soft">{line.rollout.label}</div>}
                </td>
                <td class="number">{digits(value)}</td>
                <td class="number pointer">{at === null ? "" : digits(read(line.points, at))}</td>
              </tr>
            );
          })}
          {dots.value.map(({ object: name, color, observed }) => {
            const value = nearestValue(observed, t);
            return (
              <tr key={`observed ${name}`} data-series={m.name} data-object={name} data-observed data-value={value}>
                <td class="who">
                  <span>
                    <Dot color={color} /> {words(name)}
                  </span>
                  <div class="small soft">observed{track.value?.run && ` in run ${track.value.run}`}
                    {observed.sigma.some((s) => Number.isFinite(s)) && ", ± 1 σ"}
                    {track.value?.held_out_from != null && "; hollow: held out"}</div>
                </td>
                <td class="number">{withSpread(observed, t)}</td>
                <td class="number pointer">{at === null ? "" : withSpread(observed, at)}</td>
              </tr>
            );
          })}
          {absent().map(([name, r]) => (
            <tr key={`${name} ${r.id}`}>
              <td class="soft" colSpan={3}>
                {words(name)}: none in “{r.label}”
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

/** Objects drawn that a rollout does not have. */
function absent(): [string, RolloutView][] {
  return rollouts.value.flatMap((r) =>
    shown.value
      .filter((name) => !lines.value.some((line) => line.rollout === r && line.object === name))
      .map((name): [string, RolloutView] => [name, r]),
  );
}

function withSpread(observed: Dots["observed"], t: number): string {
  const value = nearestValue(observed, t);
  const sigma = nearestValue({ times: observed.times, values: observed.sigma }, t);
  if (Number.isNaN(value)) return "–";
  return Number.isNaN(sigma) ? digits(value) : `${digits(value)} ± ${digits(sigma, 2)}`;
}

function Sample({ color, dashed }: { color: string; dashed: boolean }) {
  return (
    <svg class="stroke" viewBox="0 0 24 8" aria-hidden="true">
      <path d="M0 4h24" stroke={legible(color)} stroke-width="2.5" stroke-dasharray={dashed ? "7 5" : undefined} />
    </svg>
  );
}

function Dot({ color }: { color: string }) {
  return (
    <svg class="stroke" viewBox="0 0 24 8" aria-hidden="true">
      <path d="M12 0v8" stroke={legible(color)} />
      <circle cx="12" cy="4" r="2.5" fill={legible(color)} />
    </svg>
  );
}
