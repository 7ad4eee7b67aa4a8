// Hypotheses about what is missing, best first.
import type { Candidate, FittedParameter } from "../document";
import { digits, unitText, words } from "../format";

export function Candidates({ candidates, compared }: { candidates: Candidate[]; compared: boolean }) {
  if (!candidates.length) return null;
  return (
    <figure class="gap-figure">
      <figcaption>
        <h3>{compared ? "Hypotheses" : "The effect"}</h3>
        {compared && (
          <span class="soft small">
            nats behind: evidence from the prediction of data left out, below the best; 3 are 20 to 1
          </span>
        )}
      </figcaption>
      <div class="scroll">
        <table class="gap-candidates">
          <thead>
            <tr>
              <th scope="col">effect</th>
              {compared && (
                <th scope="col" class="number">
                  nats behind
                </th>
              )}
              <th scope="col">explains the data</th>
              <th scope="col">values, with 95 % intervals</th>
            </tr>
          </thead>
          <tbody>
            {candidates.map((c) => (
              <tr key={c.title} data-candidate={c.title} data-behind={c.behind ?? undefined} data-explains={c.explains}>
                <th scope="row">{words(c.title)}</th>
                {compared && <td class="number" data-label="nats behind">{c.behind === null ? "–" : digits(Math.abs(c.behind) < 1e-3 ? 0 : c.behind)}</td>}
                <td data-label="explains the data">{c.explains ? "✓ yes" : "✗ no"}</td>
                <td>
                  {c.values.map((v) => (
                    <Value key={v.name} value={v} />
                  ))}
                </td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </figure>
  );
}

function Value({ value: v }: { value: FittedParameter }) {
  const unit = v.unit === "SI" ? "(SI)" : v.unit;
  const [low, high] = v.interval95 ?? [null, null];
  return (
    <div class="number" data-parameter={v.name} data-value={v.value} data-low={low ?? undefined} data-high={high ?? undefined}>
      {words(v.name)} {digits(v.value)} {unitText(unit)}
      {v.interval95 && (
        <span class="soft">
          {" "}
          {low === null ? "−∞" : digits(low)} to {high === null ? "∞" : digits(high)} {unitText(unit)}
        </span>
      )}
    </div>
  );
}
