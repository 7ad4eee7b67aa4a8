// One quantity of an object against another, along its motion: the rollouts' lines, and what was measured.
import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { RolloutView } from "../document";
import { unitText, words } from "../format";
import { seek, time, track } from "../state";
import { axesOf, Chart, type ChartOf, type Place, type Trace } from "./chart";
import { observationsOf, pointsOf, valueAt, type Measure } from "./series_data";

export interface Along extends Trace {
  object: string;
  source: string;
  times: ArrayLike<number>;
}

/** x and y of each object over the samples of y; null where it has but one of them. */
export function along(x: Measure, y: Measure, rollouts: RolloutView[], names: string[], color: (name: string) => string): Along[] {
  const found: Along[] = [];
  rollouts.forEach((rollout, k) => {
    for (const name of names) {
      const [across, up] = [pointsOf(x, rollout, name), pointsOf(y, rollout, name)];
      if (!across || !up) continue;
      const at = (t: number): Place => ({ x: valueAt(across, t), y: valueAt(up, t) });
      const places = Array.from(up.times, (t, i) => ({ x: valueAt(across, t), y: up.values[i]! }));
      const label = k === 0 ? words(name) : `${words(name)} (compared)`;
      const own = { object: name, source: rollout.label, times: up.times };
      found.push({ ...own, label, color: color(name), dashed: k > 0, places, now: at(time.value) });
    }
  });
  for (const name of names) {
    const [across, up] = track.value ? [observationsOf(x, track.value, name), observationsOf(y, track.value, name)] : [];
    if (!across || !up) continue;
    const places = Array.from(up.times, (_, i) => ({
      x: across.values[i]!,
      y: up.values[i]!,
      sx: across.sigma[i]!,
      sy: up.sigma[i]!,
    }));
    found.push({ object: name, source: "observed", times: up.times, label: "", color: color(name), dots: true, places });
  }
  return found;
}

export function axisText({ title, unit }: Measure): string {
  return unit === "1" ? title : `${title} [${unitText(unit)}]`;
}

export function Phase({ x, y, traces }: { x: Measure; y: Measure; traces: Along[] }) {
  const into = useRef<HTMLDivElement>(null);
  const size = useRef(signal({ width: 600, height: 300 })).current;
  useEffect(() => {
    const observer = new ResizeObserver(([entry]) => {
      const { width, height } = entry!.contentRect;
      size.value = { width: Math.floor(width), height: Math.floor(height) };
    });
    observer.observe(into.current!);
    return () => observer.disconnect();
  }, []);
  const of: ChartOf = { ...size.value, x: axisText(x), y: axisText(y), traces, equal: x.unit === y.unit };
  const go = (event: MouseEvent) => {
    const box = into.current!.getBoundingClientRect();
    const at = axesOf(of);
    let [nearest, moment] = [Infinity, 0];
    for (const { places, times } of traces)
      places.forEach((p, k) => {
        const away = Math.hypot(at.x(p.x) - (event.clientX - box.left), at.y(p.y) - (event.clientY - box.top));
        if (away < nearest) [nearest, moment] = [away, times[k]!];
      });
    if (Number.isFinite(nearest)) seek(moment);
  };
  return (
    <div class="plot" ref={into} role="img" aria-label={`${y.title} against ${x.title}`} title="Click: to that moment" onClick={go}>
      <Chart {...of} />
    </div>
  );
}
