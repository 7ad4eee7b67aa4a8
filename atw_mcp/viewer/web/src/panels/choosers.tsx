// Which rollout is shown, which one it is compared with, and how the two are laid out.
import type { RolloutView } from "../document";
import { digits } from "../format";
import { Icon } from "../icons";
import { chooseLayout } from "../keys";
import { chosen, compared, document, layout, other, rollout, type Layout } from "../state";
import "./choosers.css";

const LAYOUTS: { value: Layout; title: string; hint: string }[] = [
  { value: "one", title: "One", hint: "Show one rollout (1)" },
  { value: "side", title: "Side by side", hint: "Show the two rollouts side by side (2)" },
  { value: "ghost", title: "Ghost", hint: "Show the compared rollout as a ghost over the other (3)" },
];

export function Choosers() {
  const all = document.value!.rollouts;
  if (all.length === 0) return null; // a notice says so
  const titles = titled(all);
  return (
    <section class="choosers" aria-label="rollouts">
      <label>
        <span>
          <i class="line" aria-hidden="true" /> Rollout
        </span>
        <select
          name="rollout"
          value={chosen.value ?? ""}
          onChange={(event) => chooseBase(event.currentTarget.value)}
        >
          {all.map((r) => (
            <option key={r.id} value={r.id}>
              {titles.get(r.id)}
            </option>
          ))}
        </select>
      </label>
      {all.length > 1 && (
        <>
          <button class="icon" aria-label="Exchange the two rollouts" title="Exchange" disabled={!compared.value} onClick={exchange}>
            <Icon name="swap" />
          </button>
          <label>
            <span>
              <i class="line branch" aria-hidden="true" /> Compared with
            </span>
            <select
              name="compared"
              value={compared.value ?? ""}
              onChange={(event) => chooseCompared(event.currentTarget.value || null)}
            >
              <option value="">nothing</option>
              {all
                .filter((r) => r.id !== chosen.value)
                .map((r) => (
                  <option key={r.id} value={r.id}>
                    {titles.get(r.id)}
                  </option>
                ))}
            </select>
          </label>
          <div class="choice" role="group" aria-label="layout">
            {LAYOUTS.map(({ value, title, hint }) => (
              <button
                key={value}
                aria-pressed={layout.value === value}
                title={hint}
                disabled={value !== "one" && !compared.value}
                onClick={() => chooseLayout(value)}
              >
                {title}
              </button>
            ))}
          </div>
        </>
      )}
      {[rollout.value, other.value].map((r) => r && r.status !== "completed" && <Ended key={r.id} rollout={r} />)}
      {[rollout.value, other.value].map(
        (r) =>
          r?.sampled && (
            <p key={`${r.id} sampled`} class="why small soft">
              {r.label}: {r.sampled}
            </p>
          ),
      )}
    </section>
  );
}

function Ended({ rollout: r }: { rollout: RolloutView }) {
  return (
    <p class="why" data-status={r.status}>
      <span class={r.status === "diverged" ? "chip bad" : "chip warn"}>{r.status}</span> {r.label}: {r.why_ended ?? ""}
    </p>
  );
}

/** Labels of rollouts, with the horizon and then the id where two are alike, whether committed, and how they ended. */
export function titled(all: RolloutView[]): Map<string, string> {
  const label = (r: RolloutView) => r.label;
  const longer = (r: RolloutView) => `${r.label}, ${digits(r.horizon)} s`;
  const unique = (text: (r: RolloutView) => string, r: RolloutView) =>
    all.filter((o) => text(o) === text(r)).length === 1;
  return new Map(
    all.map((r) => {
      const text = unique(label, r) ? label(r) : unique(longer, r) ? longer(r) : `${longer(r)}, ${r.id}`;
      const committed = r.world === document.value?.case.committed_world ? " · committed" : "";
      return [r.id, text + committed + (r.status === "completed" ? "" : ` (${r.status})`)];
    }),
  );
}

export function chooseBase(id: string): void {
  if (id === compared.value) exchange();
  else chosen.value = id;
}

/** Compare with a rollout, as a ghost where only one was shown. */
export function chooseCompared(id: string | null): void {
  compared.value = id;
  if (!id) layout.value = "one";
  else if (layout.value === "one") layout.value = "ghost";
}

function exchange(): void {
  [chosen.value, compared.value] = [compared.value, chosen.value];
}
