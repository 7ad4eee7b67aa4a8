// How far the world that answers rest on is from what was measured: whether to believe it.
import type { RolloutView, ViewDocument } from "../document";
import { quantity, words } from "../format";
import { document, opened } from "../state";
import type { Opened } from "../unpack";

export function Agreement() {
  const doc = document.value!;
  if (doc.tracks.length === 0 || doc.worlds.length === 0) return null; // nothing to compare, or nothing to compare with
  const found = compared(doc);
  if (!found)
    return (
      <p class="small soft agreement" data-agreement="">
        No rollout here is compared with the measured positions.
      </p>
    );
  const { distance, noise } = agreement(opened.value!, doc, found);
  const worst = found.misfits.reduce((a, b) => ((b.rms ?? 0) > (a.rms ?? 0) ? b : a));
  return (
    <p class="small agreement" data-agreement={distance} data-noise={noise ?? ""} data-rollout={found.id}>
      Rollout “{found.label}” is <b>{quantity(distance, "m", 3)}</b> rms from the measured positions
      {found.misfits.length > 1 && ` (most: ${words(worst.object)}, ${quantity(worst.rms, "m", 3)})`}
      {noise !== null && `; a measured coordinate is uncertain by ${quantity(noise, "m", 2)} (1 σ)`}.
    </p>
  );
}

/** The rollout to judge by: of the committed world, else the latest that is compared with what was measured. */
function compared(doc: ViewDocument): RolloutView | null {
  const all = doc.rollouts.filter((r) => r.misfits.length > 0);
  const committed = doc.worlds.find((w) => w.committed)?.id;
  return all.findLast((r) => r.world === committed) ?? (committed ? null : all.at(-1)) ?? null;
}

/** Root mean square distance over all objects and times, and the median standard deviation of a measurement [m]. */
function agreement(source: Opened, doc: ViewDocument, { misfits }: RolloutView) {
  const squares = misfits.flatMap((m) => [...source.floats(m.distance)]).filter((d) => !Number.isNaN(d));
  const sum = squares.reduce((total, d) => total + d * d, 0);
  const names = new Set(misfits.map((m) => m.object));
  const track = doc.tracks.findLast((t) => t.names.some((name) => names.has(name)));
  const sigmas = track ? [...source.floats(track.sigma)].filter((s) => s > 0).sort((a, b) => a - b) : [];
  return { distance: Math.sqrt(sum / squares.length), noise: sigmas[sigmas.length >> 1] ?? null };
}
