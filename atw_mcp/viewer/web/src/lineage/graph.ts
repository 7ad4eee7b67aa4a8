// The provenance graph as it is drawn: what an answer rests on, what is folded, and which edges are left out.
import type { Edge, Node, Provenance } from "../document";

/** A node as drawn: a record, or records of one kind folded into one. */
export interface Item {
  id: string;
  kind: Node["kind"];
  title: string;
  members: Node[];
}

export interface Link {
  source: string;
  target: string;
}

export interface Graph {
  items: Item[];
  links: Link[];
  /** Key of the fold that each foldable record belongs to, by its id. */
  folds: Map<string, string>;
}

/** Records of a kind that no answer rests on are folded from this many on: branches are looked at one by one. */
const FOLDED: Partial<Record<Node["kind"], number>> = { evidence: 2, fit: 2, rollout: 4, world: 4 };

/** Ids of everything that a record rests on, itself included. */
export function upstream(edges: readonly Link[], id: string): Set<string> {
  return reached(neighbours(edges, (e) => [e.target, e.source]), id);
}

/** For each id, the ids at the other ends of its links. */
export function neighbours(links: readonly Link[], ends: (link: Link) => [string, string]): Map<string, string[]> {
  const found = new Map<string, string[]>();
  for (const link of links) {
    const [from, to] = ends(link);
    const known = found.get(from);
    if (known) known.push(to);
    else found.set(from, [to]);
  }
  return found;
}

function reached(next: Map<string, string[]>, id: string): Set<string> {
  const found = new Set([id]);
  for (const at of found) for (const to of next.get(at) ?? []) found.add(to); // a set grows while it is walked
  return found;
}

/** Everything that any answer rests on, the answers included. */
export function needed({ nodes, edges }: Provenance): Set<string> {
  const all = new Set<string>();
  for (const node of nodes) if (node.kind === "answer") for (const id of upstream(edges, node.id)) all.add(id);
  return all;
}

/** Fold records of a kind that no answer rests on, but those whose fold is open. */
export function folded(provenance: Provenance, open: ReadonlySet<string>): Graph {
  const kept = needed(provenance);
  const groups = new Map<string, Node[]>();
  for (const node of provenance.nodes) {
    if (kept.has(node.id) || FOLDED[node.kind] === undefined) continue;
    if (node.kind === "world" && !derived(provenance.edges, node.id, "intervention")) continue;
    const named = node.kind === "evidence" || node.kind === "fit";
    const key = named ? `${node.kind}:${node.title}` : node.kind;
    groups.set(key, [...(groups.get(key) ?? []), node]);
  }
  const folds = new Map<string, string>();
  for (const [key, members] of groups) {
    if (members.length < FOLDED[members[0]!.kind]!) continue;
    for (const node of members) folds.set(node.id, key);
  }
  const items = new Map<string, Item>();
  const drawn = new Map<string, string>(); // id of the item that shows a record
  for (const node of provenance.nodes) {
    const key = folds.get(node.id);
    const closed = key !== undefined && !open.has(key);
    const id = closed ? `fold:${key}` : node.id;
    drawn.set(node.id, id);
    const item = items.get(id);
    if (item) item.members.push(node);
    else items.set(id, { id, kind: node.kind, title: closed ? foldTitle(node) : node.title, members: [node] });
  }
  const links = new Map<string, Link>();
  for (const edge of provenance.edges) {
    const source = drawn.get(edge.source);
    const target = drawn.get(edge.target);
    if (source === undefined || target === undefined || source === target) continue;
    links.set(`${source} ${target}`, { source, target });
  }
  const answers = new Set([...items.values()].filter((item) => item.kind === "answer").map((item) => item.id));
  return { items: [...items.values()], links: reduced([...links.values()], answers), folds };
}

function derived(edges: readonly Edge[], id: string, how: string): boolean {
  return edges.some((edge) => edge.target === id && edge.how === how);
}

function foldTitle(node: Node): string {
  if (node.kind === "world") return "branches";
  return node.kind === "rollout" ? "rollouts" : node.title;
}

/** Leave out links whose ends are joined by a longer way too: what was derived from a rollout is from its world.
 * Those to answers stay: they name the evidence that was cited. */
export function reduced(links: readonly Link[], answers: ReadonlySet<string>): Link[] {
  const next = neighbours(links, (l) => [l.source, l.target]);
  return links.filter(({ source, target }) => {
    if (answers.has(target)) return true;
    const seen = new Set((next.get(source) ?? []).filter((id) => id !== target));
    for (const at of seen) {
      if (at === target) return false;
      for (const to of next.get(at) ?? []) if (to !== source) seen.add(to);
    }
    return true;
  });
}
