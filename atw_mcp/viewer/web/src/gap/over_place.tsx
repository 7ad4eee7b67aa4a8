// Where residuals are large: every observed place, coloured by the size of its residual; without an effect and with it.
import { effect, signal, type Signal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { digits, moment } from "../format";
import { duration, seek } from "../state";
import { dark, token } from "../theme";
import { cividis } from "./colormap";
import { isHeldOut, KINDS, nameOf, planeOf, projected, tickText, ticks, type Kind, type Plane, type Residuals } from "./data";
import { frameOf, frameTicks, heightFor, limitsOf, MARGIN, type Frame, type Limits } from "./frame";

const RADIUS = 3; // of a dot [px]
const REACH = 14; // of the pointer [px]
const LEAST_TOP = 3; // standard deviations at the top of the scale: below, only noise is to be seen
const QUANTILE = 0.98; // of the sizes, at the top of the scale: single outliers do not set it

interface Dot {
  item: Residuals;
  index: number;
  place: [number, number];
}

export function OverPlace({ items, effectName }: { items: Residuals[]; effectName: string }) {
  const placed = useMemo(() => items.filter((i) => i.observed.some((v) => Number.isFinite(v))), [items]);
  const kinds = (Object.keys(KINDS) as Kind[]).filter((kind) => placed.some((i) => i.kind === kind));
  const kind = useMemo(() => signal(placed[0]?.kind ?? "position"), [placed]); // that of the largest residuals
  const own = useMemo(() => placed.filter((i) => i.kind === kind.value), [placed, kind.value]);
  const plane = useMemo(() => planeOf(own), [own]);
  const dots = useMemo(() => dotsOf(own, plane), [own]);
  const limits = useMemo(() => limitsOf(dots.map((d) => d.place), plane.across !== null), [dots]);
  const top = useMemo(() => topOf(own), [own]);
  const hovered = useMemo(() => signal<Dot | null>(null), [own]);
  const after = own.some((i) => i.sizeAfter);
  if (!dots.length) return null;
  const shared = { dots, plane, limits, top, hovered };
  return (
    <figure class="gap-figure">
      <figcaption>
        <h3>Residuals over place</h3>
        <span class="soft small">each dot an observed place, coloured by the size of its residual</span>
      </figcaption>
      {kinds.length > 1 && (
        <div class="choice" role="group" aria-label="residuals of">
          {kinds.map((k) => (
            <button key={k} aria-pressed={k === kind.value} onClick={() => (kind.value = k)}>
              {KINDS[k]}
            </button>
          ))}
        </div>
      )}
      <div class="gap-places" data-panels={after ? 2 : 1}>
        <Map {...shared} title={after ? `without ${effectName}` : ""} />
        {after && <Map {...shared} title={`with ${effectName}`} after />}
      </div>
      <ColorBar top={top} />
      <Readout hovered={hovered} />
    </figure>
  );
}

function dotsOf(items: Residuals[], plane: Plane): Dot[] {
  const found: Dot[] = [];
  for (const item of items)
    item.times.forEach((t, index) => {
      if (!Number.isFinite(item.sizeBefore[index]!)) return;
      const place = projected(plane, item.observed, 3 * index, t);
      if (Number.isFinite(place[0] + place[1])) found.push({ item, index, place });
    });
  return found;
}

function topOf(items: Residuals[]): number {
  const all = items.flatMap((i) => [...i.sizeBefore]).filter(Number.isFinite);
  all.sort((a, b) => a - b);
  return Math.max(all[Math.floor(QUANTILE * (all.length - 1))] ?? 0, LEAST_TOP);
}

interface MapProps {
  dots: Dot[];
  plane: Plane;
  limits: Limits;
  top: number;
  hovered: Signal<Dot | null>;
  title: string;
  after?: boolean;
}

function Map({ dots, plane, limits, top, hovered, title, after = false }: MapProps) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const width = useMemo(() => signal(0), []);
  useEffect(() => {
    const place = canvas.current!.parentElement!;
    const seen = new ResizeObserver(() => (width.value = place.clientWidth));
    seen.observe(place);
    return () => seen.disconnect();
  }, []);
  useEffect(
    () =>
      effect(() => {
        if (width.value > 0) draw(canvas.current!, width.value, { dots, plane, limits, top, hovered, title, after });
      }),
    [dots, plane, limits, top, title],
  );
  const at = (event: PointerEvent | MouseEvent) => nearestDot(canvas.current!, event, dots, limits);
  const walk = (event: KeyboardEvent) => {
    const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
    if (event.key === "Enter" && hovered.value) go(hovered.value);
    if (step === 0) return;
    event.preventDefault();
    event.stopPropagation();
    const from = hovered.value ? dots.indexOf(hovered.value) : step > 0 ? -1 : 0;
    hovered.value = dots[(from + step + dots.length) % dots.length]!;
  };
  return (
    <div class="gap-map">
      {title && <h4>{title}</h4>}
      <canvas
        ref={canvas}
        tabIndex={0}
        role="img"
        aria-label={`sizes of residuals over ${plane.acrossLabel} and ${plane.upLabel}${title && `, ${title}`}; arrow keys walk through the dots`}
        data-dots={dots.length}
        onPointerMove={(event) => (hovered.value = at(event))}
        onPointerLeave={() => (hovered.value = null)}
        onClick={(event) => {
          const dot = at(event);
          hovered.value = dot;
          if (dot) go(dot);
        }}
        onKeyDown={walk}
      />
    </div>
  );
}

function go(dot: Dot): void {
  if (dot.item.linked && duration.value > 0) seek(dot.item.times[dot.index]!);
}

function sizeOf(dot: Dot, after: boolean): number {
  return (after ? dot.item.sizeAfter : dot.item.sizeBefore)?.[dot.index] ?? NaN;
}

function nearestDot(canvas: HTMLCanvasElement, event: MouseEvent, dots: Dot[], limits: Limits): Dot | null {
  const box = canvas.getBoundingClientRect();
  const frame = frameOf(limits, box.width, box.height);
  const [x, y] = [event.clientX - box.left, event.clientY - box.top];
  let best: Dot | null = null;
  let least = REACH ** 2;
  for (const dot of dots) {
    const d = (frame.x(dot.place[0]) - x) ** 2 + (frame.y(dot.place[1]) - y) ** 2;
    if (d < least) [best, least] = [dot, d];
  }
  return best;
}

function draw(canvas: HTMLCanvasElement, width: number, props: Required<MapProps>): void {
  const { dots, plane, limits, top, hovered, after } = props;
  const onDark = dark.value;
  const inner = width - MARGIN.left - MARGIN.right;
  const height = Math.min(heightFor(limits, inner) + MARGIN.top + MARGIN.bottom, 420);
  const ratio = window.devicePixelRatio || 1;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  canvas.style.width = `${width}px`;
  canvas.style.height = `${height}px`;
  const context = canvas.getContext("2d")!;
  context.scale(ratio, ratio);
  const frame = frameOf(limits, width, height);
  axes(context, frame, limits, plane);
  const order = dots.map((dot) => ({ dot, size: sizeOf(dot, after) })).sort((a, b) => a.size - b.size);
  for (const { dot, size } of order) {
    if (!Number.isFinite(size)) continue;
    context.beginPath();
    context.arc(frame.x(dot.place[0]), frame.y(dot.place[1]), RADIUS, 0, 2 * Math.PI);
    context.fillStyle = cividis(size / top, onDark);
    context.fill();
  }
  const chosen = hovered.value;
  if (chosen) {
    context.beginPath();
    context.arc(frame.x(chosen.place[0]), frame.y(chosen.place[1]), RADIUS + 3, 0, 2 * Math.PI);
    context.strokeStyle = token("ink");
    context.lineWidth = 2;
    context.stroke();
  }
}

function axes(context: CanvasRenderingContext2D, frame: Frame, limits: Limits, plane: Plane): void {
  const marks = frameTicks(frame, limits);
  const [bottom, right] = [frame.top + frame.height, frame.left + frame.width];
  context.font = `11px ${getComputedStyle(document.body).fontFamily}`;
  context.strokeStyle = token("line");
  context.fillStyle = token("ink-soft");
  context.lineWidth = 1;
  context.beginPath();
  context.textAlign = "center";
  context.textBaseline = "top";
  for (const [x, text] of marks.x) {
    context.moveTo(x, frame.top);
    context.lineTo(x, bottom);
    context.fillText(text, x, bottom + 4);
  }
  context.fillText(plane.acrossLabel, frame.left + frame.width / 2, bottom + 20);
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const [y, text] of marks.y) {
    context.moveTo(frame.left, y);
    context.lineTo(right, y);
    context.fillText(text, frame.left - 5, y);
  }
  context.stroke();
  context.save();
  context.translate(9, frame.top + frame.height / 2);
  context.rotate(-Math.PI / 2);
  context.textAlign = "center";
  context.fillText(plane.upLabel, 0, 0);
  context.restore();
}

function ColorBar({ top }: { top: number }) {
  const marks = ticks(0, top, 6);
  const onDark = dark.value;
  const stops = Array.from({ length: 11 }, (_, k) => cividis(k / 10, onDark)).join(", ");
  return (
    <div class="gap-colorbar small" role="img" aria-label={`colours from 0 to ${digits(top, 3)} standard deviations and more`}>
      <div class="gradient" style={{ background: `linear-gradient(to right, ${stops})` }} />
      <div class="marks number" aria-hidden="true">
        {marks.map((v) => (
          <span key={v} style={{ left: `${(100 * v) / top}%` }}>
            {tickText(v, marks)}
          </span>
        ))}
      </div>
      <span class="soft">size of the residual [σ of the noise]; larger ones than {digits(top, 3)} σ have the colour at the end</span>
    </div>
  );
}

function Readout({ hovered }: { hovered: Signal<Dot | null> }) {
  const dot = hovered.value;
  if (!dot) return <p class="gap-readout small soft">Point at a dot to read it{duration.value > 0 ? "; click to go to its time" : ""}.</p>;
  const [t, before, after] = [dot.item.times[dot.index]!, sizeOf(dot, false), sizeOf(dot, true)];
  return (
    <p class="gap-readout small number" role="status" data-object={dot.item.object} data-run={dot.item.run} data-time={t} data-size={before} data-size-after={dot.item.sizeAfter ? after : undefined}>
      {nameOf(dot.item)} at {moment(t)}: {digits(before, 3)}
      {dot.item.sizeAfter ? ` → ${digits(after, 3)}` : ""} σ{isHeldOut(dot.item, t) ? ", held out" : ""}
    </p>
  );
}
