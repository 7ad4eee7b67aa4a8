// Fits, latest first: each parameter with its spread inside what was searched, pairs of them, the course of the search.
import type { FittedParameter, FitView } from "../document";
import { isFitted, isState } from "../fits/numbers";
import { document, record, tab, worldOf } from "../state";
import { Pair } from "./fits_pair";
import { Parameter } from "./fits_parameter";
import { cite } from "./head";
import { errorWords } from "./error_words";
import { SearchCurve } from "./search_curve";
import "./fits.css";

export function Fits() {
  const fits = document.value!.fits.toReversed();
  return (
    <section class="fits" aria-label="fits">
      {fits.map((fit, i) => (
        <Fit key={fit.evidence} fit={fit} open={i === 0 || (i === 1 && fits[0]!.curve === null)} />
      ))}
    </section>
  );
}

function Fit({ fit, open }: { fit: FitView; open: boolean }) {
  const fitted = fit.parameters.filter(isFitted);
  const states = fitted.filter(isState);
  const physical = fitted.filter((p) => !isState(p));
  const varied = fit.parameters.filter((p) => !isFitted(p));
  return (
    <details open={open} data-fit={fit.evidence}>
      <summary>
        <b>{label(fit.world)}</b> <span class="soft">fitted from {label(fit.source_world)}</span>
      </summary>
      <p class="small">
        {fit.summary}{" "}
        <button class="link" onClick={() => cite(fit.evidence)}>
          {fit.evidence}
        </button>
        {fit.world && (
          <>
            {" · "}
            <button class="link" onClick={() => trace(fit.world!)}>
              its provenance
            </button>
          </>
        )}
      </p>
      <p class="small soft">
        Value with its 95% interval, the thick line.
        {fitted.some((p) => p.bounds) && " The thin line is what was searched."}
        {fitted.some((p) => p.sample) && " Each dot is a world that the data allow."}
      </p>
      <Group parameters={physical} />
      {states.length > 0 && (
        <details open={physical.length === 0}>
          <summary class="small">initial states ({states.length})</summary>
          <Group parameters={states} />
        </details>
      )}
      {varied.length > 0 && (
        <details>
          <summary class="small">not fitted, varied in the sample ({varied.length})</summary>
          <Group parameters={varied} />
        </details>
      )}
      <div class="fits-more">
        {fit.parameters.filter((p) => p.sample).length > 1 && <Pair parameters={fit.parameters} />}
        {fit.curve && (
          <figure>
            <figcaption>
              <h3>course of the search</h3>
            </figcaption>
            <SearchCurve curve={fit.curve} />
            <p class="small soft">
              How far the simulated motion is from the observed{errorWords(fit.curve.unit)}. A new line begins where the search goes on
              to more of the observed frames or starts once more: errors compare along one line.
            </p>
          </figure>
        )}
      </div>
    </details>
  );
}

function Group({ parameters }: { parameters: FittedParameter[] }) {
  return (
    <ul class="parameters">
      {parameters.map((parameter) => (
        <Parameter key={parameter.name} parameter={parameter} />
      ))}
    </ul>
  );
}

function label(world: string | null): string {
  return worldOf(world)?.label ?? world ?? "a world";
}

function trace(id: string): void {
  record.value = id;
  tab.value = "provenance";
}
