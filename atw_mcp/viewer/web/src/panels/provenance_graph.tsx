// The provenance graph: nodes in columns, links between them, what a chosen record rests on lit.
import { signal } from "@preact/signals";
import { useLayoutEffect, useMemo, useRef } from "preact/hooks";
import { words } from "../format";
import type { Graph, Item } from "../lineage/graph";
import { layout, NODE, type Drawn, type Placed } from "../lineage/layout";
import { document } from "../state";
import { KINDS, titleOf } from "./provenance_detail";

const ZOOMS = [0.35, 0.5, 0.65, 0.8, 1, 1.25, 1.6];
const LEAST = 0.75; // of the zoom that a graph opens with: below it the smallest text is under 9 px
const HEAD = 24; // px above the graph for the names of the columns
const zoom = signal<number | null>(null);

interface Props {
  graph: Graph;
  chosen: string;
  /** Ids of the records that the chosen one rests on; null: nothing is dimmed. */
  lit: Set<string> | null;
  onChoose: (id: string) => void;
}

export function GraphView({ graph, chosen, lit, onChoose }: Props) {
  const drawing = useMemo(() => layout(graph), [graph]);
  const frame = useRef<HTMLDivElement>(null);
  const pan = usePan(frame);
  useLayoutEffect(() => {
    if (zoom.value !== null || !frame.current) return;
    zoom.value = Math.max(LEAST, whole(frame.current, drawing));
  }, [drawing]);
  const scale = zoom.value ?? 1;
  const isLit = (item: Item) => lit === null || item.members.some((node) => lit.has(node.id));
  const linkLit = (source: string, target: string) =>
    lit === null || (isLit(drawing.nodes.get(source)!.item) && isLit(drawing.nodes.get(target)!.item));
  useReveal(frame, drawing, chosen, scale);
  const focusable = drawing.nodes.has(chosen) ? chosen : drawing.nodes.keys().next().value;
  return (
    <div class="provenance-graph">
      <div class="provenance-frame" ref={frame} {...pan} tabIndex={-1}>
        <div
          class="provenance-canvas"
          role="group"
          aria-label="graph of records; arrow keys walk along its links"
          onKeyDown={(event) => walk(event, drawing)}
          style={{ width: px(drawing.width), height: px(drawing.height + HEAD), zoom: scale }}
        >
          <div class="stages" style={{ height: px(HEAD) }}>
            {drawing.stages.map(({ name, from, to }) => (
              <span key={name} style={{ left: px(from), width: px(to - from) }}>
                {name}
              </span>
            ))}
          </div>
          <svg width={drawing.width} height={drawing.height} style={{ top: px(HEAD) }} aria-hidden="true">
            {drawing.links.map(({ link, points }) => (
              <path
                key={`${link.source} ${link.target}`}
                class={linkLit(link.source, link.target) ? "lit" : "dim"}
                data-source={link.source}
                data-target={link.target}
                d={curve(points)}
              />
            ))}
          </svg>
          {[...drawing.nodes.values()].map((placed) => (
            <NodeButton
              key={placed.item.id}
              placed={placed}
              chosen={placed.item.id === chosen}
              lit={isLit(placed.item)}
              focusable={placed.item.id === focusable}
              onChoose={onChoose}
            />
          ))}
        </div>
      </div>
      <div class="bar small">
        <div class="choice" role="group" aria-label="zoom">
          <button aria-label="smaller" onClick={() => step(scale, -1)}>
            −
          </button>
          <button aria-label="larger" onClick={() => step(scale, 1)}>
            +
          </button>
        </div>
        <button class="quiet" onClick={() => (zoom.value = whole(frame.current, drawing))}>
          whole
        </button>
        <span class="soft">Drag to move. Arrow keys walk along links, Enter chooses.</span>
      </div>
    </div>
  );
}

interface NodeProps {
  placed: Placed;
  chosen: boolean;
  lit: boolean;
  focusable: boolean;
  onChoose: (id: string) => void;
}

function NodeButton({ placed: { item, x, y }, chosen, lit, focusable, onChoose }: NodeProps) {
  const count = item.members.length;
  const fold = item.id.startsWith("fold:");
  const title = fold ? item.title : titleOf(item.members[0]!);
  const under = fold ? `${count} folded` : underOf(item);
  return (
    <button
      class={`node ${lit ? "lit" : "dim"}`}
      style={{ left: px(x), top: px(y + HEAD), width: px(NODE.width), height: px(NODE.height) }}
      data-node={item.id}
      data-kind={item.kind}
      data-count={count}
      aria-pressed={chosen}
      aria-label={`${KINDS[item.kind]}: ${title}, ${under}${fold ? ": unfold" : ""}`}
      title={fold ? `${count} × ${title}, on which no answer rests: unfold` : `${title}: ${item.members[0]!.detail}`}
      tabIndex={focusable ? 0 : -1}
      onClick={() => onChoose(item.id)}
    >
      <span class="name">{title}</span>
      <span class="under">{under}</span>
    </button>
  );
}

/** The second line of a node. */
function underOf(item: Item): string {
  const node = item.members[0]!;
  const doc = document.value!;
  switch (node.kind) {
    case "evidence": {
      const status = doc.evidence.find((e) => e.id === node.id)?.status ?? "completed";
      return status === "completed" ? node.id : `${node.id} ${status}`;
    }
    case "world":
      return doc.case.committed_world === node.id ? "world, committed" : "world";
    case "answer":
      return words(node.detail);
    case "case":
      return doc.case.file || doc.case.id;
    default:
      return KINDS[node.kind];
  }
}

/** The zoom at which the graph is as wide as its frame. */
function whole(box: HTMLElement | null, drawing: Drawn): number {
  return Math.min(1, ((box?.clientWidth ?? 0) - 16) / Math.max(drawing.width, 1));
}

function px(length: number): string {
  return `${length}px`;
}

/** A curve through the points of a link, level at each. */
function curve(points: [number, number][]): string {
  const [[x0, y0], ...rest] = points as [[number, number], ...[number, number][]];
  let path = `M${x0} ${y0}`;
  let [x, y] = [x0, y0];
  for (const [to, at] of rest) {
    const middle = (x + to) / 2;
    path += y === at ? `H${to}` : `C${middle} ${y} ${middle} ${at} ${to} ${at}`;
    [x, y] = [to, at];
  }
  return path;
}

function step(from: number, by: 1 | -1): void {
  const next = by > 0 ? ZOOMS.find((z) => z > from + 0.01) : ZOOMS.findLast((z) => z < from - 0.01);
  zoom.value = next ?? from;
}

/** Move the focus: left to what a record was derived from, right to what was derived from it, up and down a column. */
function walk(event: KeyboardEvent, drawing: Drawn): void {
  const at = (event.target as HTMLElement).closest<HTMLElement>("[data-node]")?.dataset.node;
  const from = at === undefined ? undefined : drawing.nodes.get(at);
  if (!from || !event.key.startsWith("Arrow")) return;
  event.preventDefault();
  event.stopPropagation();
  const ends = drawing.links.map(({ link }) => link);
  const across = event.key === "ArrowUp" || event.key === "ArrowDown";
  const sign = event.key === "ArrowUp" ? -1 : 1;
  const column = [...drawing.nodes.values()].filter((p) => p.layer === from.layer && sign * (p.y - from.y) > 0);
  const ids = across
    ? column.map((p) => p.item.id)
    : event.key === "ArrowLeft"
      ? ends.filter((l) => l.target === at).map((l) => l.source)
      : ends.filter((l) => l.source === at).map((l) => l.target);
  const far = (id: string) => Math.abs(drawing.nodes.get(id)!.y - from.y);
  const next = ids.sort((a, b) => far(a) - far(b))[0];
  if (next === undefined) return;
  const canvas = event.currentTarget as HTMLElement;
  canvas.querySelector<HTMLElement>(`[data-node="${CSS.escape(next)}"]`)?.focus();
}

/** Bring the chosen node into view when it changes, without moving the page. */
function useReveal(frame: { current: HTMLDivElement | null }, drawing: Drawn, chosen: string, scale: number): void {
  useLayoutEffect(() => {
    const placed = drawing.nodes.get(chosen);
    const box = frame.current;
    if (!placed || !box) return;
    const [left, top] = [placed.x * scale, (placed.y + HEAD) * scale];
    const [right, bottom] = [left + NODE.width * scale, top + NODE.height * scale];
    if (left < box.scrollLeft || right > box.scrollLeft + box.clientWidth) {
      box.scrollLeft = right - box.clientWidth + 16;
    }
    if (top < box.scrollTop + HEAD * scale || bottom > box.scrollTop + box.clientHeight) {
      box.scrollTop = (top + bottom - box.clientHeight) / 2;
    }
  }, [drawing, chosen, scale]);
}

/** Drag the frame's content with a mouse; a finger scrolls it as any page, Ctrl and the wheel zoom. */
function usePan(frame: { current: HTMLDivElement | null }) {
  const held = useRef<{ x: number; y: number; left: number; top: number } | null>(null);
  return {
    onPointerDown: (event: PointerEvent) => {
      const box = frame.current;
      if (!box || event.pointerType !== "mouse" || event.button !== 0) return;
      if ((event.target as HTMLElement).closest("button")) return;
      held.current = { x: event.clientX, y: event.clientY, left: box.scrollLeft, top: box.scrollTop };
      box.setPointerCapture(event.pointerId);
    },
    onPointerMove: (event: PointerEvent) => {
      if (!held.current || !frame.current) return;
      frame.current.scrollLeft = held.current.left - (event.clientX - held.current.x);
      frame.current.scrollTop = held.current.top - (event.clientY - held.current.y);
    },
    onPointerUp: () => (held.current = null),
    onPointerCancel: () => (held.current = null),
    onWheel: (event: WheelEvent) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      step(zoom.value ?? 1, event.deltaY < 0 ? 1 : -1);
    },
  };
}
