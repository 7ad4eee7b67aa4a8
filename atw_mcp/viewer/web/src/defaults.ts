// What a page shows until a person chooses: the motion that the case's latest answer rests on.
import type { RolloutView, ViewDocument } from "./document";

export interface Pair {
  chosen: string | null;
  compared: string | null;
}

/** The committed world's rollout and the branch of it, each the one that the latest answer rests on where it rests on one. */
export function defaults(doc: ViewDocument): Pair {
  const cited = new Set(doc.case.answers.at(-1)?.evidence ?? []);
  const used = new Set(doc.evidence.filter((row) => cited.has(row.id)).map((row) => row.rollout));
  const best = (runs: RolloutView[]) => runs.findLast((r) => used.has(r.id)) ?? runs.at(-1);
  const bases = doc.rollouts.filter((r) => r.edits.length === 0);
  const committed = bases.filter((r) => r.world === doc.case.committed_world);
  const base = best(committed.length ? committed : bases) ?? doc.rollouts.at(-1);
  const branches = doc.rollouts.filter((r) => r.edits.length > 0 && r.id !== base?.id);
  const own = branches.filter((r) => rootOf(doc, r.world) === base?.world);
  return { chosen: base?.id ?? null, compared: best(own.length ? own : branches)?.id ?? null };
}

/** The world that a branch was made from, past all edits. */
function rootOf(doc: ViewDocument, world: string): string {
  const found = doc.worlds.find((w) => w.id === world);
  return found?.origin === "intervention" && found.parent ? rootOf(doc, found.parent) : world;
}
