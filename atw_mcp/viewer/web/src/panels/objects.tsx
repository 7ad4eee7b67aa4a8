// The objects of the worlds shown: choose one to highlight it, or let the eye follow it.
import type { Moving, WorldView } from "../document";
import { quantity, words } from "../format";
import { Icon } from "../icons";
import { follow } from "../keys";
import { document, followed, object, otherWorld, world } from "../state";
import "./objects.css";

export function Objects() {
  const shown = world.value ?? document.value?.worlds.at(-1); // without a rollout, the latest world's
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
            <Row key={m.name} moving={m} note={branch && !has(branch, m.name) ? "not in the compared world" : ""} />
          ))}
          {added.map((m) => (
            <Row key={m.name} moving={m} note={"only in the compared world"} />
          ))}
        </ul>
      </div>
    </section>
  );
}

function has(view: WorldView, name: string): boolean {
  return view.moving.some((m) => m.name === name);
}

function Row({ moving, note }: { moving: Moving; note: string }) {
  const { name } = moving;
  const kind = moving.kind === "rigid" && moving.shape ? moving.shape.kind : moving.kind;
  const about = [kind, moving.start_time > 0 ? `from ${moving.start_time.toFixed(2)} s` : "", note];
  return (
    <li data-object={name} data-kind={moving.kind} data-mass={moving.mass ?? ""}>
      <button
        class="pick"
        aria-pressed={object.value === name}
        onClick={() => (object.value = object.value === name ? null : name)}
      >
        <span class="swatch" style={{ background: moving.color }} />
        <span class="name">{words(name)}</span>
        <span class="number small soft">{moving.mass === null ? "" : quantity(moving.mass, "kg")}</span>
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
