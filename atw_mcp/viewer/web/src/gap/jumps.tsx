// Sudden changes of velocity that nothing known explains.
import { signal, type Signal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import type { Jump } from "../document";
import { digits, moment, quantity, words } from "../format";
import { document as shown, duration, seek, time } from "../state";
import { nameOf, planeOf, projected, ticks, tickText, type Plane, type Residuals } from "./data";
import { frameOf, frameTicks, heightFor, limitsOf, MARGIN, type Frame } from "./frame";

const CLEAR = 3; // standard deviations
const MOST = 240; // arrows that can be distinguished; the largest are drawn
const LONGEST = 0.16; // of the extent, the longest arrow
const BESIDE = 5; // between marks at one time [px]

export function Jumps({ jumps, items }: { jumps: Jump[]; items: Residuals[] }) {
  const chosen = useMemo(() => signal<Jump | null>(null), [jumps]);
  const drawn = useMemo(() => [...jumps].sort((a, b) => b.sigmas - a.sigmas).slice(0, MOST), [jumps]);
  if (!jumps.length) return null;
  const clear = jumps.filter((j) => j.sigmas >= CLEAR).length;
  return (
    <figure class="gap-figure" data-jumps={jumps.length}>
      <figcaption>
        <h3>Sudden changes of velocity</h3>
        <span class="soft small">
          where nothing known is in reach; {clear} of {jumps.length} exceed {CLEAR} σ
          {jumps.length > MOST && `; the ${MOST} largest are drawn`}
        </span>
      </figcaption>
      <ul class="gap-legend small" aria-label="objects">
        {[...new Set(jumps.map((j) => j.object))].map((name) => (
          <li key={name}>
            <span class="swatch" style={{ background: colorOf(name) }} /> {words(name)}
          </li>
        ))}
      </ul>
      <div class="gap-jumps">
        <Arrows jumps={drawn} items={items} chosen={chosen} />
        <AlongTime jumps={drawn} chosen={chosen} />
      </div>
      <Readout chosen={chosen} />
    </figure>
  );
}

function colorOf(object: string): string {
  const doc = shown.value;
  const found = doc?.worlds.flatMap((w) => w.moving).find((m) => m.name === object);
  return found?.color ?? "currentColor";
}

/** Width of an element in pixels, followed. */
function useWidth() {
  const place = useRef<HTMLDivElement>(null);
  const width = useMemo(() => signal(0), []);
  useEffect(() => {
    const seen = new ResizeObserver(() => (width.value = place.current?.clientWidth ?? 0));
    seen.observe(place.current!);
    return () => seen.disconnect();
  }, []);
  return { place, width: width.value };
}

function Grid({ frame, marks, across, up }: { frame: Frame; marks: ReturnType<typeof frameTicks>; across: string; up: string }) {
  const bottom = frame.top + frame.height;
  return (
    <g class="gap-grid" aria-hidden="true">
      {marks.x.map(([x, text]) => (
        <g key={`x${text}`}>
          <line x1={x} x2={x} y1={frame.top} y2={bottom} />
          <text x={x} y={bottom + 14} text-anchor="middle">
            {text}
          </text>
        </g>
      ))}
      {marks.y.map(([y, text]) => (
        <g key={`y${text}`}>
          <line x1={frame.left} x2={frame.left + frame.width} y1={y} y2={y} />
          <text x={frame.left - 5} y={y + 4} text-anchor="end">
            {text}
          </text>
        </g>
      ))}
      <text x={frame.left} y={bottom + 30}>
        {across}
      </text>
      <text transform={`translate(11 ${frame.top + frame.height / 2}) rotate(-90)`} text-anchor="middle">
        {up}
      </text>
    </g>
  );
}

function handlers(jump: Jump, chosen: Signal<Jump | null>, linked: boolean) {
  return {
    class: `jump${jump.sigmas < CLEAR ? " faint" : ""}${chosen.value === jump ? " chosen" : ""}`,
    "data-run": jump.run,
    "data-object": jump.object,
    "data-time": jump.time,
    "data-sigmas": jump.sigmas,
    onPointerEnter: () => (chosen.value = jump),
    onClick: () => {
      chosen.value = jump;
      if (linked && duration.value > 0) seek(jump.time);
    },
  };
}

function Arrows({ jumps, items, chosen }: { jumps: Jump[]; items: Residuals[]; chosen: Signal<Jump | null> }) {
  const { place, width } = useWidth();
  const plane = useMemo(() => planeOf(items), [items]);
  const placed = jumps.filter((j) => j.position && j.velocity_change);
  if (!plane.across || !placed.length) return null;
  const paths = items.map((i) => pathOf(i, plane));
  const changes = placed.map((j) => projected(plane, j.velocity_change!, 0, 0));
  const longest = Math.max(...changes.map(([x, y]) => Math.hypot(x, y)), 1e-12);
  const across = limitsOf(paths.flat(), false);
  const span = LONGEST * (across.high[0] - across.low[0]);
  const tips = placed.map((j, k): [number, number] => {
    const [x, y] = projected(plane, j.position!, 0, 0);
    return [x + (changes[k]![0] / longest) * span, y + (changes[k]![1] / longest) * span];
  });
  const limits = limitsOf([...paths.flat(), ...tips], true);
  const height = Math.min(heightFor(limits, width - MARGIN.left - MARGIN.right) + MARGIN.top + MARGIN.bottom, 420);
  const frame = frameOf(limits, width, height);
  const scale = (frame.x(span) - frame.x(0)) / longest; // [px per m/s]
  const key = keyOf(longest);
  return (
    <div ref={place}>
      {width > 0 && (
        <svg width={width} height={height} role="img" aria-label={`${placed.length} changes of velocity as arrows at their places`}>
          <Grid frame={frame} marks={frameTicks(frame, limits)} across={plane.acrossLabel} up={plane.upLabel} />
          {paths.map((path, k) => (
            <polyline key={k} class="path" points={path.map(([x, y]) => `${frame.x(x).toFixed(1)},${frame.y(y).toFixed(1)}`).join(" ")} />
          ))}
          {placed.map((jump, k) => {
            const [x, y] = projected(plane, jump.position!, 0, 0);
            const [u, v] = changes[k]!;
            return (
              <g key={k} {...handlers(jump, chosen, jump.run === "")} style={{ color: colorOf(jump.object) }}>
                <Arrow x={frame.x(x)} y={frame.y(y)} dx={u * scale} dy={-v * scale} />
              </g>
            );
          })}
          <g class="key">
            <Arrow x={width - MARGIN.right - 64 - key * scale} y={height - 10} dx={key * scale} dy={0} />
            <text x={width - MARGIN.right - 56} y={height - 6}>
              {quantity(key, "m/s", 1)}
            </text>
          </g>
        </svg>
      )}
    </div>
  );
}

/** A round speed not above the largest. */
function keyOf(longest: number): number {
  const power = 10 ** Math.floor(Math.log10(longest));
  return [5, 2, 1].map((m) => m * power).find((v) => v <= longest)!;
}

function pathOf(item: Residuals, plane: Plane): [number, number][] {
  const found: [number, number][] = [];
  item.times.forEach((t, i) => {
    const p = projected(plane, item.observed, 3 * i, t);
    if (Number.isFinite(p[0] + p[1])) found.push(p);
  });
  return found;
}

function Arrow({ x, y, dx, dy }: { x: number; y: number; dx: number; dy: number }) {
  const length = Math.hypot(dx, dy);
  const head = Math.min(7, 0.5 * length);
  const [ux, uy] = length > 0 ? [dx / length, dy / length] : [1, 0];
  const [tx, ty] = [x + dx, y + dy];
  const side = (s: number) => `${tx - head * ux + s * 0.5 * head * uy},${ty - head * uy - s * 0.5 * head * ux}`;
  const line = { x1: x, y1: y, x2: tx, y2: ty };
  return (
    <>
      <line class="halo" {...line} />
      <line class="shaft" {...line} />
      <polygon points={`${tx},${ty} ${side(1)} ${side(-1)}`} />
      <circle cx={x} cy={y} r={2.5} />
    </>
  );
}

function AlongTime({ jumps, chosen }: { jumps: Jump[]; chosen: Signal<Jump | null> }) {
  const { place, width } = useWidth();
  const top = Math.max(CLEAR * 1.5, ...jumps.map((j) => j.sigmas)) * 1.08;
  const points = jumps.map((j): [number, number] => [j.time, 0]);
  const limits = { ...limitsOf(points, false) };
  limits.low = [Math.min(limits.low[0], 0), 0];
  limits.high = [limits.high[0], top];
  const height = 190;
  const frame = frameOf(limits, width, height);
  const linked = jumps.every((j) => j.run === "");
  const up = ticks(0, top, 5);
  const marks = { ...frameTicks(frame, limits), y: up.map((v): [number, string] => [frame.y(v), `${tickText(v, up)} σ`]) };
  const objects = [...new Set(jumps.map((j) => j.object))].sort();
  // Objects that jump at one time stand side by side.
  const x = (jump: Jump) => frame.x(jump.time) + BESIDE * (objects.indexOf(jump.object) - (objects.length - 1) / 2);
  return (
    <div ref={place}>
      {width > 0 && (
        <svg width={width} height={height} role="img" aria-label="sizes of the changes of velocity over time, in standard deviations">
          <Grid frame={frame} marks={marks} across="time [s]" up="size" />
          <line class="clear" x1={frame.left} x2={frame.left + frame.width} y1={frame.y(CLEAR)} y2={frame.y(CLEAR)} />
          {jumps.map((jump, k) => (
            <g key={k} {...handlers(jump, chosen, jump.run === "")} style={{ color: colorOf(jump.object) }}>
              <line class="shaft" x1={x(jump)} x2={x(jump)} y1={frame.y(0)} y2={frame.y(jump.sigmas)} />
              <circle cx={x(jump)} cy={frame.y(jump.sigmas)} r={4} />
            </g>
          ))}
          <text class="clear" x={frame.left + frame.width} y={frame.y(CLEAR) - 4} text-anchor="end">
            {CLEAR} σ: noise is below
          </text>
          {linked && <Now frame={frame} end={limits.high[0]} />}
        </svg>
      )}
    </div>
  );
}

/** The present time, drawn by itself: it changes with every frame. */
function Now({ frame, end }: { frame: Frame; end: number }) {
  const x = frame.x(time.value);
  if (duration.value <= 0 || time.value > end) return null;
  return <line class="now" x1={x} x2={x} y1={frame.top} y2={frame.top + frame.height} />;
}

function Readout({ chosen }: { chosen: Signal<Jump | null> }) {
  const jump = chosen.value;
  if (!jump) return <p class="gap-readout small soft">Point at an arrow or a mark to read it.</p>;
  const size = Math.hypot(...(jump.velocity_change ?? [NaN]));
  return (
    <p class="gap-readout small number" role="status">
      {nameOf(jump)} at {moment(jump.time)}: {digits(size, 3)} ± {digits(size / jump.sigmas, 2)} m/s, {digits(jump.sigmas, 3)} σ
    </p>
  );
}
