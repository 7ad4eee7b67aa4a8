// Provenance: what an answer rests on, back to the video, as a graph or as a nested list.
import { computed, signal } from "@preact/signals";
import type { ViewDocument } from "../document";
import { folded, upstream } from "../lineage/graph";
import { document, record } from "../state";
import { Chain } from "./provenance_chain";
import { Detail, KINDS, titleOf } from "./provenance_detail";
import { GraphView } from "./provenance_graph";
import "./provenance.css";

const NARROW = matchMedia("(max-width: 640px)").matches;
const form = signal<"graph" | "list">(NARROW ? "list" : "graph");
/** Keys of the folds that were opened. */
const open = signal<ReadonlySet<string>>(new Set());

const graph = computed(() => (document.value ? folded(document.value.provenance, open.value) : null));

export function Provenance() {
  const doc = document.value!;
  const shown = graph.value!;
  const answers = doc.provenance.nodes.filter((node) => node.kind === "answer");
  const chosen = chosenIn(doc);
  const other = doc.provenance.nodes.find((node) => node.id === chosen && node.kind !== "answer");
  const lit = chosen === "" ? null : upstream(doc.provenance.edges, chosen);
  return (
    <section class="provenance" aria-label="provenance">
      <div class="bar">
        <label>
          <span class="small soft">what rests on what, for</span>
          <select
            aria-label="answer"
            value={chosen}
            onChange={(event) => (record.value = event.currentTarget.value)}
          >
            <option value="">all records</option>
            {other && (
              <option value={other.id}>
                {KINDS[other.kind]} {titleOf(other)}
              </option>
            )}
            {answers.map((answer) => (
              <option key={answer.id} value={answer.id}>
                {titleOf(answer)} ← {answer.detail}
              </option>
            ))}
          </select>
        </label>
        <span class="push" />
        {open.value.size > 0 && (
          <button class="quiet" onClick={() => (open.value = new Set())}>
            fold again
          </button>
        )}
        <div class="choice" role="group" aria-label="form">
          {(["graph", "list"] as const).map((name) => (
            <button key={name} aria-pressed={form.value === name} onClick={() => (form.value = name)}>
              {name}
            </button>
          ))}
        </div>
      </div>
      <div class="provenance-body">
        {form.value === "graph" ? (
          <GraphView graph={shown} chosen={chosen} lit={lit} onChoose={choose} />
        ) : (
          <Chain doc={doc} chosen={chosen} onChoose={choose} />
        )}
        <Detail doc={doc} id={chosen} onChoose={choose} />
      </div>
    </section>
  );
}

/** The chosen record; before any was chosen the latest answer. */
function chosenIn(doc: ViewDocument): string {
  const { nodes } = doc.provenance;
  if (record.value === "") return "";
  if (nodes.some((node) => node.id === record.value)) return record.value!;
  return nodes.findLast((node) => node.kind === "answer")?.id ?? "";
}

/** Choose a record, or open a fold. */
function choose(id: string): void {
  if (id.startsWith("fold:")) open.value = new Set([...open.value, id.slice("fold:".length)]);
  else record.value = id;
}
