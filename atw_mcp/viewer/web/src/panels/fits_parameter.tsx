// A fitted parameter: its value and 95% interval in words, and drawn with its sample inside the bounds of its search.
import type { FittedParameter } from "../document";
import { extent, isFitted, parts, place, withInterval } from "../fits/numbers";
import { quantity, words } from "../format";
import { object, opened, world } from "../state";

const LANE = 12; // px over which the dots of a sample are scattered, so that equal values stay apart

export function Parameter({ parameter }: { parameter: FittedParameter }) {
  const { name, value, interval95, unit } = parameter;
  return (
    <li
      class="parameter"
      data-parameter={name}
      data-value={value}
      data-low={interval95?.[0] ?? ""}
      data-high={interval95?.[1] ?? ""}
      data-unit={unit}
      data-at-bound={parameter.at_bound}
    >
      <Name name={name} />
      <span class="number value">{withInterval(parameter)}</span>
      <Strip parameter={parameter} />
      <span class="small remark">
        {parameter.at_bound && <b class="at-bound">at its bound</b>}
        {parameter.at_bound && parameter.note && "; "}
        {parameter.note}
        {isFitted(parameter) && interval95 === null && !parameter.note && "no interval: the data do not determine it"}
      </span>
    </li>
  );
}

/** The name of a parameter with the colour of its object. */
export function Name({ name }: { name: string }) {
  const { object: owner, rest } = parts(name);
  const color = world.value?.moving.find((m) => m.name === owner)?.color;
  return (
    <span class="name">
      {color && <span class="swatch" style={{ background: color }} />}
      {owner === null ? (
        rest
      ) : color ? (
        <>
          <button class="link" onClick={() => (object.value = owner)}>
            {words(owner)}
          </button>{" "}
          {rest}
        </>
      ) : (
        `${words(owner)} ${rest}`
      )}
    </span>
  );
}

function Strip({ parameter }: { parameter: FittedParameter }) {
  const { value, interval95, bounds, logarithmic, unit } = parameter;
  const sample = parameter.sample ? opened.value!.floats(parameter.sample) : new Float32Array();
  const ends = (interval95 ?? []).filter((end) => end !== null);
  const range = searched(bounds) ?? extent([value, ...ends, ...sample], 0.2);
  if (!range) return <span />;
  const at = (x: number) => `${(100 * Math.min(Math.max(place(x, range, logarithmic), 0), 1)).toFixed(2)}%`;
  const low = interval95?.[0] ?? range[0];
  const high = interval95?.[1] ?? range[1];
  return (
    <span class="strip">
      <svg width="100%" height="26" role="img" aria-label={`${withInterval(parameter)}, ${said(bounds, unit)}`}>
        <line class="range" x1="0%" x2="100%" y1="20" y2="20" />
        {interval95 && <line class="interval" x1={at(low)} x2={at(high)} y1="20" y2="20" />}
        {[...sample].map((x, i) => (
          <circle key={i} cx={at(x)} cy={3 + scatter(i) * LANE} r="2" />
        ))}
        <line class="best" x1={at(value)} x2={at(value)} y1="1" y2="25" />
      </svg>
      {bounds && (
        <span class="ends small soft">
          <span>{bounds[0] === null ? "" : quantity(bounds[0], unit, 3)}</span>
          {logarithmic && <span>log scale</span>}
          <span>{bounds[1] === null ? "" : quantity(bounds[1], unit, 3)}</span>
        </span>
      )}
    </span>
  );
}

function searched(bounds: FittedParameter["bounds"]): [number, number] | null {
  if (!bounds || bounds[0] == null || bounds[1] == null) return null;
  return [bounds[0], bounds[1]];
}

function said(bounds: FittedParameter["bounds"], unit: string): string {
  const found = searched(bounds);
  return found ? `searched from ${quantity(found[0], unit)} to ${quantity(found[1], unit)}` : "bounds not recorded";
}

/** Evenly scattered numbers 0 to 1 (the golden ratio's multiples), the same at each drawing. */
function scatter(i: number): number {
  return (i * 0.6180339887) % 1;
}
