// What an effect is worth: the gap without and with it, beside the noise.
import type { GapView } from "../document";
import { digits, quantity } from "../format";

export function Proof({ view }: { view: GapView }) {
  const { gap_before: before, gap_after: after, noise, gap_unit: unit } = view;
  if (before === null || after === null) return null;
  const rows = [
    { name: "without", value: before, kind: "before" },
    { name: "with", value: after, kind: "after" },
    ...(noise === null ? [] : [{ name: "noise", value: noise, kind: "noise" }]),
  ];
  const most = Math.max(...rows.map((r) => r.value), 1e-300);
  const closed = before > 0 ? 1 - after / before : null;
  const place = view.gap_held_out ? "on held-out data, which no fit has seen" : "on the data that were fitted; none were held out";
  return (
    <figure class="gap-figure gap-proof" data-held-out={view.gap_held_out}>
      <figcaption>
        <h3>The gap without and with the effect</h3>
        <span class="soft small">root mean square residual beyond the noise, {place}</span>
      </figcaption>
      <dl>
        {rows.map(({ name, value, kind }) => (
          <div key={kind} class={kind} data-gap={kind} data-value={value} data-unit={unit}>
            <dt>{name}</dt>
            <dd>
              <span class="bar-of" style={{ width: `${(100 * value) / most}%` }} />
            </dd>
            <dd class="number">{quantity(value, unit)}</dd>
          </div>
        ))}
      </dl>
      {closed !== null && (
        <p data-closed={closed}>
          {closed >= 0 ? `${digits(100 * closed, 3)} % of the gap is closed.` : `The gap grows by ${digits(-100 * closed, 3)} %.`}
        </p>
      )}
    </figure>
  );
}
