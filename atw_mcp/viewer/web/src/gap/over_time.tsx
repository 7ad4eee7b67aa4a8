// Residuals over time: one small plot for every run and object, the largest first, all with equal scales.
import { effect, signal, type Signal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import uPlot from "uplot";
import { digits, moment } from "../format";
import { duration, seek, time } from "../state";
import { dark, token } from "../theme";
import { AXES, AXIS_TOKENS, isHeldOut, nameOf, nearest, tickText, type Residuals } from "./data";

const AT_FIRST = 6;
const HEIGHT = 170; // [px]
const LETTERS = 16; // room for them at the right [px]
const NOISE = 2; // standard deviations: 95 % of noise is within

export function OverTime({ items, effectName }: { items: Residuals[]; effectName: string }) {
  const all = useMemo(() => signal(false), [items]);
  const shown = all.value ? items : items.slice(0, AT_FIRST);
  const most = useMemo(() => largest(items), [items]);
  const axes = AXES.map((_, a) => a).filter((a) => items.some((i) => i.axes.includes(a)));
  const after = items.some((i) => i.after);
  return (
    <figure class="gap-figure">
      <figcaption>
        <h3>Residuals over time</h3>
        <span class="soft small">simulated less observed, in standard deviations σ of the noise; equal scales</span>
      </figcaption>
      <ul class="gap-legend small" aria-label="legend">
        {axes.map((a) => (
          <li key={a}>
            <Stroke color={`var(--${AXIS_TOKENS[a]})`} /> {AXES[a]}
          </li>
        ))}
        {after && (
          <li>
            <Stroke color="currentColor" /> without {effectName}
          </li>
        )}
        {after && (
          <li>
            <Stroke color="currentColor" dashed /> with {effectName}
          </li>
        )}
        <li>
          <span class="gap-key noise" /> ±2 σ
        </li>
        {items.some((i) => i.heldOut.length) && (
          <li>
            <span class="gap-key held-out" /> held out of the fit
          </li>
        )}
      </ul>
      <div class="gap-multiples">
        {shown.map((item) => (
          <Small key={`${item.run}/${item.object}/${item.kind}`} item={item} most={most} />
        ))}
      </div>
      {items.length > AT_FIRST && (
        <button onClick={() => (all.value = !all.value)} aria-expanded={all.value}>
          {all.value ? `Show the ${AT_FIRST} largest` : `Show all ${items.length}`}
        </button>
      )}
    </figure>
  );
}

function Stroke({ color, dashed }: { color: string; dashed?: boolean }) {
  return (
    <svg class="gap-stroke" viewBox="0 0 24 8" aria-hidden="true">
      <line x1="0" x2="24" y1="4" y2="4" style={{ stroke: color, strokeDasharray: dashed ? "4 3" : undefined }} />
    </svg>
  );
}

function largest(items: Residuals[]): number {
  let most = NOISE * 1.5;
  for (const item of items)
    for (const values of [item.before, item.after])
      for (const v of values ?? []) if (Number.isFinite(v)) most = Math.max(most, Math.abs(v));
  return most * 1.08;
}

function Small({ item, most }: { item: Residuals; most: number }) {
  const place = useRef<HTMLDivElement>(null);
  const readout = useRef<HTMLParagraphElement>(null);
  const hovered = useMemo(() => signal<number | null>(null), [item]);
  useEffect(() => effect(() => drawn(place.current!, item, most, hovered)), [item, most]);
  useEffect(
    () =>
      effect(() => {
        const at = hovered.value ?? (item.linked && duration.value > 0 ? within(item, time.value) : null);
        write(readout.current!, item, at);
      }),
    [item],
  );
  return (
    <div
      class="gap-small"
      data-run={item.run}
      data-object={item.object}
      data-kind={item.kind}
      data-rms={item.rms}
      data-rms-after={item.rmsAfter ?? undefined}
    >
      <h4>
        {nameOf(item)}
        <span class="soft number">
          {" "}
          rms {digits(item.rms, 3)}
          {item.rmsAfter === null ? "" : ` → ${digits(item.rmsAfter, 3)}`} σ
        </span>
      </h4>
      <div class="gap-plot" ref={place} role="img" aria-label={`residuals of ${nameOf(item)} over time`} />
      <p class="gap-readout small number" ref={readout} />
    </div>
  );
}

/** Index of the instant at a time; null outside of what was compared. */
function within(item: Residuals, t: number): number | null {
  const { times } = item;
  if (!times.length || t < times[0]! - 0.02 || t > times[times.length - 1]! + 0.02) return null;
  return nearest(times, t);
}

function write(line: HTMLElement, item: Residuals, at: number | null): void {
  for (const key of Object.keys(line.dataset)) delete line.dataset[key];
  if (at === null) {
    line.textContent = "\u00a0";
    return;
  }
  const t = item.times[at]!;
  line.dataset.time = String(t);
  const parts = item.axes.map((a) => {
    const before = item.before[3 * at + a]!;
    line.dataset[AXES[a]!] = String(before);
    if (!item.after) return `${AXES[a]} ${digits(before, 3)}`;
    const after = item.after[3 * at + a]!;
    line.dataset[`${AXES[a]}After`] = String(after);
    return `${AXES[a]} ${digits(before, 3)} → ${digits(after, 3)}`;
  });
  line.textContent = `${moment(t)}: ${parts.join(", ")} σ${isHeldOut(item, t) ? ", held out" : ""}`;
}

/** Draw the plot into its place, and again when the theme changes; returns how to remove it. */
function drawn(place: HTMLElement, item: Residuals, most: number, hovered: Signal<number | null>): () => void {
  void dark.value;
  const ink = token("ink-soft");
  const line = token("line");
  const band = token("line");
  const shade = token("held-out");
  const colors = AXIS_TOKENS.map(token);
  const { data, rows } = columns(item);
  const font = `11px ${getComputedStyle(document.body).fontFamily}`;
  const axis = { stroke: ink, grid: { stroke: line, width: 1 }, ticks: { stroke: line, size: 4 }, font };
  const area = (u: uPlot, x0: number, x1: number, y0: number, y1: number) => {
    const box = u.bbox;
    const left = Math.max(u.valToPos(x0, "x", true), box.left);
    const right = Math.min(u.valToPos(x1, "x", true), box.left + box.width);
    const top = Math.max(u.valToPos(y1, "y", true), box.top);
    const bottom = Math.min(u.valToPos(y0, "y", true), box.top + box.height);
    u.ctx.fillRect(left, top, right - left, bottom - top);
    return left;
  };
  const options: uPlot.Options = {
    width: place.clientWidth || 300,
    height: HEIGHT,
    legend: { show: false },
    padding: [null, LETTERS, null, null],
    cursor: { y: false, drag: { x: false, y: false }, points: { size: 6 } },
    scales: { x: { time: false }, y: { range: [-most, most] } },
    axes: [
      { ...axis, size: 30, values: (_, values) => values.map((v) => `${tickText(v, values)} s`) },
      { ...axis, size: 44, values: (_, values) => values.map((v) => `${v} σ`.replace("-", "−")) },
    ],
    series: [
      {},
      ...item.axes.map((a) => ({ label: AXES[a]!, stroke: colors[a]!, width: 1.5, points: { show: false } })),
      ...(item.after
        ? item.axes.map((a) => ({ label: `${AXES[a]} after`, stroke: colors[a]!, width: 1.5, dash: [5, 4], points: { show: false } }))
        : []),
    ],
    hooks: {
      drawClear: [
        (u) => {
          u.ctx.save();
          u.ctx.fillStyle = band;
          area(u, u.scales.x!.min!, u.scales.x!.max!, -NOISE, NOISE);
          for (const [from, to] of item.heldOut) {
            u.ctx.fillStyle = shade;
            const left = area(u, from, to, -most, most);
            u.ctx.fillStyle = ink;
            u.ctx.font = `${11 * devicePixelRatio}px ${getComputedStyle(document.body).fontFamily}`;
            u.ctx.textBaseline = "top";
            u.ctx.fillText("held out", left + 4 * devicePixelRatio, u.bbox.top + 3 * devicePixelRatio);
          }
          u.ctx.restore();
        },
      ],
      draw: [(u) => letters(u, item, colors)],
      setCursor: [(u) => (hovered.value = typeof u.cursor.idx === "number" ? (rows[u.cursor.idx] ?? null) : null)],
    },
  };
  const plot = new uPlot(options, data, place);
  plot.over.addEventListener("mouseleave", () => (hovered.value = null));
  if (item.linked) plot.over.addEventListener("click", () => seek(plot.posToVal(plot.cursor.left ?? 0, "x")));
  const cursor = window.document.createElement("div");
  cursor.className = "gap-cursor";
  plot.over.append(cursor);
  const follow = effect(() => {
    const t = time.value;
    const seen = item.linked && duration.value > 0 && within(item, t) !== null;
    cursor.hidden = !seen;
    if (seen) cursor.style.transform = `translateX(${plot.valToPos(t, "x")}px)`;
  });
  const resized = new ResizeObserver(() => plot.setSize({ width: place.clientWidth, height: HEIGHT }));
  resized.observe(place);
  return () => {
    resized.disconnect();
    follow();
    plot.destroy();
  };
}

/** Write the letter of each component beside the end of its line: colours alone do not distinguish them. */
function letters(u: uPlot, item: Residuals, colors: string[]): void {
  const apart = 10 * devicePixelRatio;
  const ends = item.axes
    .map((a) => {
      let i = item.times.length - 1;
      while (i > 0 && !Number.isFinite(item.before[3 * i + a]!)) i--;
      return { a, y: u.valToPos(item.before[3 * i + a]!, "y", true) };
    })
    .sort((one, other) => one.y - other.y);
  u.ctx.save();
  u.ctx.font = `${11 * devicePixelRatio}px ${getComputedStyle(document.body).fontFamily}`;
  u.ctx.textBaseline = "middle";
  u.ctx.textAlign = "left";
  let last = -Infinity;
  const first = ends.map((e) => (last = Math.max(e.y, last + apart)));
  const middle = (v: number[]) => v.reduce((x, y) => x + y, 0) / v.length;
  const shift = middle(ends.map((e) => e.y)) - middle(first);
  ends.forEach(({ a }, k) => {
    u.ctx.fillStyle = colors[a]!;
    u.ctx.fillText(AXES[a]!, u.bbox.left + u.bbox.width + 4 * devicePixelRatio, first[k]! + shift);
  });
  u.ctx.restore();
}

/** Columns for uPlot, broken where a held-out interval begins or ends, and the instant of each row. */
function columns(item: Residuals): { data: uPlot.AlignedData; rows: (number | null)[] } {
  const rows: (number | null)[] = [];
  const times: number[] = [];
  item.times.forEach((t, i) => {
    if (i && isHeldOut(item, t) !== isHeldOut(item, item.times[i - 1]!)) {
      rows.push(null);
      times.push((t + item.times[i - 1]!) / 2);
    }
    rows.push(i);
    times.push(t);
  });
  const column = (values: Float32Array, a: number) =>
    rows.map((i) => (i === null || !Number.isFinite(values[3 * i + a]!) ? null : values[3 * i + a]!));
  const after = item.after;
  const data = [times, ...item.axes.map((a) => column(item.before, a)), ...(after ? item.axes.map((a) => column(after, a)) : [])];
  return { data: data as uPlot.AlignedData, rows };
}
