// The page: a header, the film beside the scene, the timeline with its controls, and panels below.
import { document, failure } from "./state";
import { Film } from "./panels/film";
import { Fits } from "./panels/fits";
import { Gap } from "./panels/gap";
import { Provenance } from "./panels/provenance";
import { Scene } from "./panels/scene";
import { Series } from "./panels/series";
import { Timeline } from "./panels/timeline";

export function Shell() {
  if (failure.value) return <p role="alert">{failure.value}</p>;
  const doc = document.value;
  if (!doc) return <p aria-busy="true">Loading …</p>;
  return (
    <main>
      <h1>{doc.case.id}</h1>
      <Film />
      <Scene />
      <Timeline />
      <Series />
      <Gap />
      <Fits />
      <Provenance />
    </main>
  );
}
