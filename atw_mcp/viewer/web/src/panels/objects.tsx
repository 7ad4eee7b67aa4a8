// The objects of the worlds shown: choose one to highlight it, or let the eye follow it.
import type { Moving, WorldView } from "../document";
import { isFitted, withInterval } from "../fits/numbers";
import { quantity, words } from "../format";
import { Icon } from "../icons";
import { follow } from "../keys";
import { document, followed, object, otherWorld, rollout, world, worldOf } from "../state";
import { FixedSolids } from "./objects_fixed";
import "./objects.css";

export function Objects() {
  const shown = world.value;
  if (!shown) return null;
  const branch = otherWorld.value;
  const added = branch?.moving.filter((m) => !has(shown, m.name)) ?? [];
  return (
    <section class="panel objects" aria-label="objects">
      <div class="bar">
        <h2>Objects</h2>
        <span class="soft small">{shown.label}</span>
      </div>
      <div class="scroll">
        <ul>
          {shown.moving.map((m) => (
            <Row key={m.name} moving={m} of={shown} note={branch && !has(branch, m.name) ? "not in the compared world" : ""} />
          ))}
          {added.map((m) => (
            <Row key={m.name} moving={m} of={branch!} note={"only in the compared world"} />
          ))}
        </ul>
        <FixedSolids />
      </div>
    </section>
  );
}

function has(view: WorldView, name: string): boolean {
  return view.moving.some((m) => m.name === name);
}

/** The mass with its 95% interval where it was fitted, and a note where the fit of its world left it out. */
function massOf(of: WorldView, { name, mass }: Moving): { text: string; note: string } {
  if (mass === null) return { text: "", note: "" };
  const plain = quantity(mass, "kg");
  for (let from: WorldView | null = of; from; from = worldOf(from.parent)) {
    const fit = document.value!.fits.findLast((one) => one.world === from!.id);
    if (!fit) continue;
    const found = fit.parameters.find((p) => isFitted(p) && /^mass of (.*)$/.exec(p.name)?.[1]!.split(", ").includes(name));
    if (!found) return { text: quantity(mass, "kg", 3), note: " (not fitted)" };
    const same = Math.abs(found.value - mass) < 1e-6 * mass; // an edit may have changed it since
    return { text: same ? withInterval(found) : plain, note: same ? "" : " (changed after the fit)" };
  }
  return { text: plain, note: "" };
}

function Row({ moving, of, note }: { moving: Moving; of: WorldView; note: string }) {
  const { name } = moving;
  const kind = moving.form || (moving.kind === "rigid" && moving.shape ? moving.shape.kind : moving.kind);
  const mass = massOf(of, moving);
  const misfit = of === world.value ? rollout.value?.misfits.find((m) => m.object === name) : undefined;
  const about = [
    kind,
    `${mass.text}${mass.note}`,
    moving.start_time > 0 ? `from ${moving.start_time.toFixed(2)} s` : "",
    misfit?.rms == null ? "" : `${quantity(misfit.rms, "m", 3)} rms from measured`,
    note,
  ];
  return (
    <li data-object={name} data-kind={moving.kind} data-mass={moving.mass ?? ""} data-rms={misfit?.rms ?? ""}>
      <button
        class="pick"
        aria-pressed={object.value === name}
        onClick={() => (object.value = object.value === name ? null : name)}
      >
        <span class="swatch" style={{ background: moving.color }} />
        <span class="name">{words(name)}</span>
        <span class="about small">{about.filter(Boolean).join(", ")}</span>
      </button>
      <button
        class="quiet icon"
        aria-label={`Follow ${words(name)}`}
        title="Let the view follow it (F)"
        aria-pressed={followed.value === name}
        onClick={() => follow(name)}
      >
        <Icon name="follow" />
      </button>
    </li>
  );
}
