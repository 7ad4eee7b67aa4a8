// The fixed solids of the worlds shown, and which of them an intervention removed, added or moved.
import type { Static } from "../document";
import { words } from "../format";
import { differing } from "../scene/fixed";
import { object, otherWorld, world } from "../state";

export function FixedSolids() {
  const shown = world.value;
  const branch = otherWorld.value;
  if (!shown) return null;
  const changed = branch ? differing(shown, branch) : [];
  const added = branch ? differing(branch, shown).filter((d) => !d.moved) : [];
  const note = (solid: Static) => {
    const found = changed.find((d) => d.solid === solid);
    return !found ? "" : found.moved ? "elsewhere in the compared world" : "not in the compared world";
  };
  if (!shown.statics.length && !added.length) return null;
  return (
    <ul aria-label="fixed solids">
      {shown.statics.map((s) => (
        <Row key={s.name} solid={s} note={note(s)} />
      ))}
      {added.map(({ solid }) => (
        <Row key={solid.name} solid={solid} note="only in the compared world" />
      ))}
    </ul>
  );
}

function Row({ solid, note }: { solid: Static; note: string }) {
  const about = ["fixed", solid.shape.kind === "mesh" ? "" : solid.shape.kind, note];
  return (
    <li data-static={solid.name} data-note={note}>
      <button
        class="pick"
        aria-pressed={object.value === solid.name}
        onClick={() => (object.value = object.value === solid.name ? null : solid.name)}
      >
        <span class="swatch" style={{ background: solid.color }} />
        <span class="name">{words(solid.name)}</span>
        <span class="about small">{about.filter(Boolean).join(", ")}</span>
      </button>
    </li>
  );
}
