// A layered drawing, left to right: layers from the kinds of records, crossings reduced by barycentres (Sugiyama,
// Tagawa and Toda 1981), places across a layer by least squares with a least distance (pool adjacent violators).
import { neighbours, type Graph, type Item, type Link } from "./graph";

export const NODE = { width: 126, height: 40, gap: 10, between: 24 } as const; // px at zoom 1
const BEND = 12; // px across a layer that a passing link takes
const SWEEPS = 6; // passes over all layers; more change no drawing of the demos

export interface Placed {
  item: Item;
  layer: number;
  x: number;
  y: number;
}

export interface Drawn {
  nodes: Map<string, Placed>;
  /** Points that each link passes, from the right of its source to the left of its target. */
  links: { link: Link; points: [number, number][] }[];
  /** Where each stage begins and ends [px], in order. */
  stages: { name: string; from: number; to: number }[];
  width: number;
  height: number;
}

const STAGES = ["case", "observations", "worlds and fits", "rollouts", "evidence", "answers"];
const STAGE: Record<Item["kind"], number> = {
  case: 0,
  observation: 1,
  world: 2,
  fit: 2,
  rollout: 3,
  evidence: 4,
  answer: 5,
};

interface Cell {
  key: string;
  size: number;
  y: number;
}

export function layout(graph: Graph): Drawn {
  const forward = acyclic(graph);
  const layers = layersOf(graph, forward);
  const rows: Cell[][] = [];
  const put = (layer: number, key: string, size: number) => {
    (rows[layer] ??= []).push({ key, size, y: 0 });
  };
  for (const item of graph.items) put(layers.get(item.id)!, item.id, NODE.height);
  const chains: { link: Link; keys: string[] }[] = [];
  const pieces: Link[] = [];
  for (const link of forward) {
    const keys = [link.source];
    for (let layer = layers.get(link.source)! + 1; layer < layers.get(link.target)!; layer++) {
      const key = `${link.source} ${link.target} ${layer}`;
      put(layer, key, BEND);
      keys.push(key);
    }
    keys.push(link.target);
    for (let i = 1; i < keys.length; i++) pieces.push({ source: keys[i - 1]!, target: keys[i]! });
    chains.push({ link, keys });
  }
  arrange(rows, pieces);
  return drawn(graph, layers, rows, chains);
}

/** Leave out links that close a circle, as two worlds that are edits of each other make. */
function acyclic(graph: Graph): Link[] {
  const next = neighbours(graph.links, (l) => [l.source, l.target]);
  const state = new Map<string, "open" | "done">();
  const closing = new Set<string>();
  const visit = (id: string) => {
    state.set(id, "open");
    for (const to of next.get(id) ?? []) {
      if (state.get(to) === "open") closing.add(`${id} ${to}`);
      else if (!state.has(to)) visit(to);
    }
    state.set(id, "done");
  };
  for (const item of graph.items) if (!state.has(item.id)) visit(item.id);
  return graph.links.filter((l) => !closing.has(`${l.source} ${l.target}`));
}

/** A layer for each item, after those of all that it was derived from and after the stages before its own. */
function layersOf(graph: Graph, links: readonly Link[]): Map<string, number> {
  const sources = neighbours(links, (l) => [l.target, l.source]);
  const next = neighbours(links, (l) => [l.source, l.target]);
  const kinds = new Map(graph.items.map((item) => [item.id, STAGE[item.kind]]));
  const stages = new Map<string, number>();
  // Evidence that proposed an effect stands before the world that has it.
  const stageOf = (id: string): number => {
    const known = stages.get(id) ?? Math.min(kinds.get(id)!, ...(next.get(id) ?? []).map(stageOf));
    stages.set(id, known);
    return known;
  };
  for (const item of graph.items) stageOf(item.id);
  const layers = new Map<string, number>();
  let floor = 0;
  for (let stage = 0; stage < STAGES.length; stage++) {
    const members = graph.items.filter((item) => stages.get(item.id) === stage);
    const place = (id: string): number => {
      const known = layers.get(id);
      if (known !== undefined) return known;
      const layer = Math.max(floor, ...(sources.get(id) ?? []).map((source) => place(source) + 1));
      layers.set(id, layer);
      return layer;
    };
    for (const item of members) place(item.id);
    if (members.length) floor = Math.max(...layers.values()) + 1;
  }
  return layers;
}

/** Order the cells of each layer by the mean place of their neighbours, then place them near those. */
function arrange(rows: Cell[][], pieces: readonly Link[]): void {
  const cells = new Map(rows.flat().map((cell) => [cell.key, cell]));
  const before = neighbours(pieces, (l) => [l.target, l.source]);
  const after = neighbours(pieces, (l) => [l.source, l.target]);
  for (const row of rows) stack(row);
  const mean = (cell: Cell, sides: Map<string, string[]>[]): number => {
    const near = sides.flatMap((side) => side.get(cell.key) ?? []).map((key) => cells.get(key)!.y);
    return near.length ? near.reduce((a, b) => a + b, 0) / near.length : cell.y;
  };
  for (let sweep = 0; sweep < SWEEPS; sweep++) {
    const right = sweep % 2 === 0;
    for (const row of right ? rows : rows.toReversed()) {
      const wanted = new Map(row.map((cell) => [cell, mean(cell, [right ? before : after])]));
      row.sort((a, b) => wanted.get(a)! - wanted.get(b)!);
      spread(row, row.map((cell) => wanted.get(cell)!));
    }
  }
  for (let sweep = 0; sweep < SWEEPS; sweep++) {
    for (const row of rows) spread(row, row.map((cell) => mean(cell, [before, after])));
  }
  const top = Math.min(...[...cells.values()].map((cell) => cell.y - cell.size / 2));
  for (const cell of cells.values()) cell.y -= top;
}

function stack(row: Cell[]): void {
  let y = 0;
  for (const cell of row) {
    cell.y = y + cell.size / 2;
    y += cell.size + NODE.gap;
  }
}

/** Move cells as near to where they are wanted as their order and least distances allow, by least squares. */
function spread(row: Cell[], wanted: number[]): void {
  const offsets: number[] = [];
  let sum = 0;
  row.forEach((cell, i) => {
    if (i > 0) sum += (row[i - 1]!.size + cell.size) / 2 + NODE.gap;
    offsets.push(sum);
  });
  const pools: { total: number; count: number }[] = [];
  wanted.forEach((place, i) => {
    pools.push({ total: place - offsets[i]!, count: 1 });
    while (pools.length > 1) {
      const [a, b] = pools.slice(-2) as [(typeof pools)[0], (typeof pools)[0]];
      if (a.total / a.count <= b.total / b.count) break;
      pools.splice(-2, 2, { total: a.total + b.total, count: a.count + b.count });
    }
  });
  const level = pools.flatMap(({ total, count }) => Array<number>(count).fill(total / count));
  row.forEach((cell, i) => (cell.y = level[i]! + offsets[i]!));
}

function drawn(
  graph: Graph,
  layers: Map<string, number>,
  rows: Cell[][],
  chains: { link: Link; keys: string[] }[],
): Drawn {
  const left = (layer: number) => layer * (NODE.width + NODE.between);
  const y = new Map(rows.flat().map((cell) => [cell.key, cell.y]));
  const nodes = new Map<string, Placed>();
  for (const item of graph.items) {
    const layer = layers.get(item.id)!;
    nodes.set(item.id, { item, layer, x: left(layer), y: y.get(item.id)! - NODE.height / 2 });
  }
  const links = chains.map(({ link, keys }) => {
    const first = layers.get(link.source)!;
    const points: [number, number][] = [[left(first) + NODE.width, y.get(link.source)!]];
    keys.slice(1, -1).forEach((key, i) => {
      points.push([left(first + 1 + i), y.get(key)!], [left(first + 1 + i) + NODE.width, y.get(key)!]);
    });
    points.push([left(layers.get(link.target)!), y.get(link.target)!]);
    return { link, points };
  });
  const stages = STAGES.flatMap((name, stage) => {
    const own = graph.items.filter((item) => STAGE[item.kind] === stage).map((item) => layers.get(item.id)!);
    const main = own.filter((layer) => stage !== 4 || layer > Math.max(-1, ...layersOfStage(graph, layers, 3)));
    if (!main.length) return [];
    return [{ name, from: left(Math.min(...main)), to: left(Math.max(...main)) + NODE.width }];
  });
  const bottom = Math.max(0, ...rows.flat().map((cell) => cell.y + cell.size / 2));
  return { nodes, links, stages, width: left(rows.length - 1) + NODE.width, height: bottom };
}

/** Layers of the items up to a stage. */
function layersOfStage(graph: Graph, layers: Map<string, number>, stage: number): number[] {
  return graph.items.filter((item) => STAGE[item.kind] <= stage).map((item) => layers.get(item.id)!);
}
