// The plot of series with uPlot: lines of rollouts, dots of observations with error bars, labels at the lines' ends.
import uPlot from "uplot";
import { digits, unitText } from "../format";
import { legible } from "../legible";
import { seek } from "../state";
import { token } from "../theme";
import { drawn, type Measure, type Observations, type Points } from "./series_data";
import { showInterval, view, zoomed } from "./timeline_view";

export interface Line {
  /** name of the object */
  object: string;
  label: string;
  color: string;
  dashed: boolean;
  points: Points;
}

/** Where nine of ten members of an ensemble are. */
export interface Band {
  color: string;
  times: ArrayLike<number>;
  low: ArrayLike<number>;
  high: ArrayLike<number>;
}

export interface Dots {
  object: string;
  color: string;
  observed: Observations;
}

const FONT = '12px system-ui, "Segoe UI", Roboto, sans-serif';
/** Samples drawn for each pixel of width: the extremes of what falls on it. */
const PER_PIXEL = 2;
/** A pointer that moved less between press and release clicked [px]. */
const CLICK = 4;

/** What a plot reports: the moment under the pointer, null where it left, and that it was drawn. */
export interface Reports {
  hover: (t: number | null) => void;
  drawn: () => void;
}

/** Draw a plot into an element. */
export function plot(
  into: HTMLElement,
  size: { width: number; height: number },
  measure: Measure,
  lines: Line[],
  dots: Dots[],
  bands: Band[],
  reports: Reports,
): uPlot {
  const [from, to] = view.value;
  const most = Math.max(Math.round(size.width * PER_PIXEL), 100);
  const tables: uPlot.AlignedData[] = [
    ...lines.map((line) => table(drawn(line.points, from, to, most))),
    ...dots.map(({ observed }) => table(drawn(observed, from, to, most))),
  ];
  const data = tables.length ? uPlot.join(tables, tables.map(() => [2, 2])) : ([[from, to]] as uPlot.AlignedData);
  const ink = token("ink-soft");
  const grid = { stroke: token("line"), width: 1 };
  const axis = { stroke: ink, font: FONT, labelFont: FONT, grid, ticks: grid };
  const format = (_: uPlot, ticks: number[]) => ticks.map((t) => tickText(t, ticks));
  const options: uPlot.Options = {
    ...size,
    legend: { show: false },
    cursor: { drag: { x: true, y: false, setScale: false }, points: { size: 7 }, y: false },
    scales: { x: { time: false, range: () => view.peek() }, y: { range: padded(dots, bands) } },
    axes: [
      { ...axis, label: "time [s]", size: 34, labelSize: 18, values: format },
      {
        ...axis,
        label: `${measure.title}${measure.unit === "1" ? "" : ` [${unitText(measure.unit)}]`}`,
        size: 58,
        labelSize: 20,
        values: format,
      },
    ],
    series: [
      {},
      ...lines.map<uPlot.Series>((line) => ({
        stroke: legible(line.color),
        width: 2,
        dash: line.dashed ? [7, 5] : undefined,
        points: { show: false },
      })),
      ...dots.map<uPlot.Series>((dot) => ({ stroke: legible(dot.color), paths: () => null, points: { show: false } })),
    ],
    hooks: {
      drawAxes: [(u) => drawBands(u, bands)],
      draw: [(u) => drawDots(u, dots, [from, to]), (u) => drawLabels(u, lines), () => reports.drawn()],
      setCursor: [(u) => reports.hover((u.cursor.left ?? -1) < 0 ? null : u.posToVal(u.cursor.left!, "x"))],
      setSelect: [(u) => select(u)],
      ready: [(u) => u.over.addEventListener("dblclick", () => (zoomed.value = null))],
    },
  };
  const made = new uPlot(options, data, into);
  clicks(made);
  return made;
}

/** uPlot reads null as a gap and undefined, which joining leaves, as no sample. */
function table([x, y]: [number[], number[]]): uPlot.AlignedData {
  return [x, y.map((value) => (Number.isFinite(value) ? value : null))];
}

/** Range of the values with room for bands and error bars, and for a constant. */
function padded(dots: Dots[], bands: Band[]): uPlot.Scale.Range {
  return (u, low, high) => {
    const { min = -Infinity, max = Infinity } = u.scales.x ?? {};
    for (const band of bands)
      for (let k = 0; k < band.times.length; k++) {
        if (band.times[k]! < min! || band.times[k]! > max! || Number.isNaN(band.low[k]!)) continue;
        low = Math.min(low ?? Infinity, band.low[k]!);
        high = Math.max(high ?? -Infinity, band.high[k]!);
      }
    if (low === null || high === null) return [0, 1];
    let most = 0;
    for (const { observed } of dots) for (const s of Array.from(observed.sigma)) if (s > most) most = s;
    const span = high - low;
    const pad = Math.max(0.06 * span, Math.min(most, span), span === 0 ? Math.max(Math.abs(high) * 0.1, 1e-3) : 0);
    return [low - pad, high + pad];
  };
}

export function tickText(t: number, all: number[]): string {
  const step = all.length > 1 ? Math.abs(all[1]! - all[0]!) : Math.abs(t) || 1;
  const largest = Math.max(...all.map(Math.abs));
  if (largest >= 1e5 || (largest > 0 && largest < 1e-3)) return t === 0 ? "0" : digits(t, 2);
  let decimals = 0; // as many as a step needs: 0.25, not 0.3
  while (decimals < 6 && Math.abs(step - Number(step.toFixed(decimals))) > step * 1e-3) decimals++;
  return t.toFixed(decimals).replace("-", "−");
}

function select(u: uPlot): void {
  const { left, width } = u.select;
  if (width >= CLICK) showInterval(u.posToVal(left, "x"), u.posToVal(left + width, "x"));
}

function clicks(u: uPlot): void {
  let pressed = 0;
  u.over.addEventListener("pointerdown", (event) => (pressed = event.clientX));
  u.over.addEventListener("click", (event) => {
    if (Math.abs(event.clientX - pressed) >= CLICK) return;
    seek(u.posToVal(event.clientX - u.over.getBoundingClientRect().left, "x"));
  });
}

function drawBands(u: uPlot, bands: Band[]): void {
  const { ctx } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
  ctx.clip();
  ctx.globalAlpha = 0.2;
  for (const { color, times, low, high } of bands) {
    const kept = Array.from(times, (_, k) => k).filter((k) => Number.isFinite(low[k]! + high[k]!));
    const to = (k: number, values: ArrayLike<number>) =>
      ctx.lineTo(u.valToPos(times[k]!, "x", true), u.valToPos(values[k]!, "y", true));
    ctx.fillStyle = legible(color);
    ctx.beginPath();
    for (const k of kept) to(k, low);
    for (const k of kept.toReversed()) to(k, high);
    ctx.fill();
  }
  ctx.restore();
}

/** Observed positions with bars of one standard deviation; hollow where they were held out. */
function drawDots(u: uPlot, dots: Dots[], [from, to]: [number, number]): void {
  const { ctx } = u;
  const scale = devicePixelRatio;
  const surface = token("surface");
  ctx.save();
  ctx.beginPath();
  ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
  ctx.clip();
  ctx.lineWidth = scale;
  for (const { observed, color } of dots) {
    const { times, values, sigma, heldOutFrom } = observed;
    ctx.strokeStyle = legible(color);
    const spacing = (u.bbox.width * ((times[1] ?? to) - (times[0] ?? from))) / (to - from);
    const radius = Math.min(Math.max(spacing / 3, 1.2 * scale), 2.5 * scale); // apart where there is room
    for (let k = 0; k < times.length; k++) {
      if (times[k]! < from || times[k]! > to || Number.isNaN(values[k]!)) continue;
      const x = u.valToPos(times[k]!, "x", true);
      const y = u.valToPos(values[k]!, "y", true);
      ctx.fillStyle = times[k]! >= heldOutFrom ? surface : ctx.strokeStyle;
      ctx.beginPath();
      if (!Number.isNaN(sigma[k]!)) {
        ctx.moveTo(x, u.valToPos(values[k]! - sigma[k]!, "y", true));
        ctx.lineTo(x, u.valToPos(values[k]! + sigma[k]!, "y", true));
        ctx.stroke();
        ctx.beginPath();
      }
      ctx.arc(x, y, radius, 0, 2 * Math.PI);
      ctx.fill();
      ctx.stroke();
    }
  }
  ctx.restore();
}

/** The name of each object at the right end of its line, so that lines are not distinguished by colour alone. */
function drawLabels(u: uPlot, lines: Line[]): void {
  const { ctx } = u;
  const scale = devicePixelRatio;
  ctx.save();
  ctx.font = `600 ${11 * scale}px system-ui, sans-serif`;
  ctx.textAlign = "right";
  ctx.textBaseline = "middle";
  ctx.lineWidth = 4 * scale;
  ctx.strokeStyle = token("surface");
  const labels = lines.flatMap((line, k) => {
    const end = lastShown(u, k + 1);
    return end ? [{ line, x: end[0] - 4 * scale, y: end[1] - 10 * scale }] : [];
  });
  const [apart, margin] = [13 * scale, 8 * scale];
  labels.splice(Math.max(1, Math.floor((u.bbox.height - 2 * margin) / apart) + 1)); // the table names the others
  spread(labels, apart, u.bbox.top + margin, u.bbox.top + u.bbox.height - margin);
  for (const { line, x, y } of labels) {
    ctx.strokeText(line.label, x, y);
    ctx.fillStyle = legible(line.color);
    ctx.fillText(line.label, x, y);
  }
  ctx.restore();
}

/** Shift labels up or down until none is within `apart` of another, from `top` to `bottom` where there is room. */
function spread(labels: { y: number }[], apart: number, top: number, bottom: number): void {
  labels.sort((a, b) => a.y - b.y);
  let least = top;
  for (const label of labels) {
    label.y = Math.max(label.y, least);
    least = label.y + apart;
  }
  let most = bottom;
  for (const label of labels.toReversed()) {
    label.y = Math.min(label.y, most);
    most = label.y - apart;
  }
}

/** Place of the last value of a series in sight [canvas px]. */
function lastShown(u: uPlot, series: number): [number, number] | null {
  const [x, y] = [u.data[0], u.data[series]!];
  const right = u.scales.x!.max!;
  for (let k = x.length - 1; k >= 0; k--) {
    const value = y[k];
    if (value === null || value === undefined || x[k]! > right) continue;
    return [u.valToPos(x[k]!, "x", true), u.valToPos(value, "y", true)];
  }
  return null;
}
