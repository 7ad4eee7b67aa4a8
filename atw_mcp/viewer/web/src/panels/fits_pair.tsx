// Two parameters of a fit against each other, over the worlds that the data allow.
import { useMemo } from "preact/hooks";
import { useSignal } from "@preact/signals";
import type { FittedParameter } from "../document";
import { correlation, extent, isFitted, isState, mostCorrelated, parts, place } from "../fits/numbers";
import { digits, quantity, words } from "../format";
import { opened } from "../state";

const SIZE = 240; // px
const STRONG = 0.7; // |correlation| from which half of the variance of one is that of the other

/** parameters: of a fit; those without a sample are left out. */
export function Pair({ parameters }: { parameters: FittedParameter[] }) {
  const sampled = useMemo(() => parameters.filter((p) => p.sample !== null), [parameters]);
  const samples = sampled.map((p) => opened.value!.floats(p.sample!));
  // To begin with, those of what was fitted that depend on each other most, before initial states.
  const first = useMemo(() => {
    const own = sampled.flatMap((p, k) => (isFitted(p) && !isState(p) ? [k] : []));
    const all = sampled.map((_, k) => k);
    const among = own.length > 1 ? own : all;
    return (mostCorrelated(among.map((k) => samples[k]!)) ?? [0, 0]).map((k) => among[k]!);
  }, [sampled]);
  const x = useSignal<number | null>(null);
  const y = useSignal<number | null>(null);
  const [i, j] = [x.value ?? first[0]!, y.value ?? first[1]!];
  const [a, b] = [sampled[i], sampled[j]];
  if (!a || !b) return null;
  const r = correlation(samples[i]!, samples[j]!);
  const choose = (chosen: typeof x, at: number, name: string) => (
    <label class="small">
      <span class="soft">{name} </span>
      <select aria-label={name} value={at} onChange={(e) => (chosen.value = Number(e.currentTarget.value))}>
        {sampled.map((p, k) => (
          <option key={p.name} value={k}>
            {titleOf(p)}
          </option>
        ))}
      </select>
    </label>
  );
  return (
    <figure class="pair" data-x={a.name} data-y={b.name} data-correlation={r ?? ""}>
      <figcaption>
        <h3>two parameters together</h3>
      </figcaption>
      <div class="pair-choice">
        {choose(y, j, "upwards")}
        {choose(x, i, "rightwards")}
      </div>
      <Scatter a={a} b={b} xs={samples[i]!} ys={samples[j]!} />
      <p class="small">
        {r === null
          ? "One of them does not vary."
          : `Correlation ${digits(r, 2)} over ${samples[i]!.length} worlds${meaning(r)}.`}
      </p>
    </figure>
  );
}

function meaning(r: number): string {
  if (Math.abs(r) < STRONG) return "";
  return `: the data allow more of one with ${r > 0 ? "more" : "less"} of the other`;
}

interface ScatterProps {
  a: FittedParameter;
  b: FittedParameter;
  xs: Float32Array;
  ys: Float32Array;
}

function Scatter({ a, b, xs, ys }: ScatterProps) {
  const [rx, ry] = [extent([a.value, ...xs])!, extent([b.value, ...ys])!];
  const px = (x: number) => SIZE * place(x, rx, false);
  const py = (y: number) => SIZE * (1 - place(y, ry, false));
  const [cx, cy] = [px(a.value), py(b.value)];
  const most = Math.min(xs.length, ys.length);
  return (
    <div class="scatter">
      <span class="small soft top">{quantity(ry[1], b.unit, 3)}</span>
      <span class="small soft bottom">{quantity(ry[0], b.unit, 3)}</span>
      <svg viewBox={`0 0 ${SIZE} ${SIZE}`} role="img" aria-label={`${titleOf(b)} against ${titleOf(a)}`}>
        <rect width={SIZE} height={SIZE} />
        {Array.from({ length: most }, (_, k) => (
          <circle key={k} cx={px(xs[k]!)} cy={py(ys[k]!)} r="3" />
        ))}
        <path d={`M${cx - 8} ${cy}H${cx + 8}M${cx} ${cy - 8}V${cy + 8}`}>
          <title>the fit</title>
        </path>
      </svg>
      <span class="small soft left">{quantity(rx[0], a.unit, 3)}</span>
      <span class="small soft right">{quantity(rx[1], a.unit, 3)}</span>
    </div>
  );
}

function titleOf({ name }: FittedParameter): string {
  const { object, rest } = parts(name);
  return object === null ? rest : `${words(object)} ${rest}`;
}
