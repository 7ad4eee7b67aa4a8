// The error over the course of a search, on a logarithmic scale: of the present generation, and the best so far.
import { useSignalEffect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import type { Curve } from "../document";
import { digits } from "../format";
import { token } from "../theme";

const HEIGHT = 200; // px

export function SearchCurve({ curve }: { curve: Curve }) {
  const place = useRef<HTMLDivElement>(null);
  const drawn = useRef<uPlot | null>(null);
  const shown = useRef(curve);
  shown.current = curve;
  useSignalEffect(() => {
    // Drawn once more when the theme changes, which token() follows.
    const box = place.current;
    if (!box) return;
    const plot = new uPlot(options(shown.current, box.clientWidth), data(shown.current), box);
    drawn.current = plot;
    const watch = new ResizeObserver(() => plot.setSize({ width: box.clientWidth, height: HEIGHT }));
    watch.observe(box);
    return () => {
      watch.disconnect();
      plot.destroy();
    };
  });
  useEffect(() => drawn.current?.setData(data(curve)), [curve]);
  const last = curve.best.findLast((value) => value !== null);
  return (
    <div
      class="search-curve"
      ref={place}
      role="img"
      aria-label={`error over ${curve.steps.length} steps, at last ${digits(last)} ${curve.unit}`}
      data-best={last ?? ""}
    />
  );
}

/** Values that a logarithmic scale can show. */
function data(curve: Curve): uPlot.AlignedData {
  const above = (values: (number | null)[]) => values.map((v) => (v !== null && v > 0 ? v : null));
  return [curve.steps, above(curve.current), above(curve.best)];
}

function sameThroughout({ current, best }: Curve): boolean {
  return current.every((value, k) => value === best[k]);
}

/** A best error that rises is of more data than before: the line ends there, and another begins. */
function rises(u: uPlot, series: number, from: number, to: number, gaps: uPlot.Series.Gaps): uPlot.Series.Gaps {
  const [x, y] = [u.data[0], u.data[series]!];
  for (let k = from + 1; k <= to; k++)
    if (y[k]! > y[k - 1]!) gaps.push([u.valToPos(x[k - 1]!, "x", true), u.valToPos(x[k]!, "x", true)]);
  return gaps;
}

function options(curve: Curve, width: number): uPlot.Options {
  const [ink, line] = [token("ink-soft"), token("line")];
  const axis = { stroke: ink, grid: { stroke: line, width: 1 }, ticks: { stroke: line, width: 1 } };
  return {
    width,
    height: HEIGHT,
    cursor: { y: false },
    legend: { live: true },
    scales: { x: { time: false }, y: { distr: 3 } },
    axes: [
      { ...axis, label: curve.step, labelSize: 18, size: 30 },
      { ...axis, label: `error [${curve.unit}]`, labelSize: 18, size: 56, values: (_, ticks) => ticks.map((t) => (t ? digits(t, 1) : "")) },
    ],
    series: [
      { label: curve.step, value: (_, x) => (x === null ? "–" : String(x)) },
      { label: "present", stroke: token("branch"), dash: [4, 3], show: !sameThroughout(curve), value: (_, v) => digits(v) },
      { label: "best", stroke: token("base"), width: 2, gaps: rises, value: (_, v) => digits(v) },
    ],
  };
}
