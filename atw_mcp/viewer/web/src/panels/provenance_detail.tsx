// One record of the provenance graph: what it is, what it rests on, what rests on it, and where the viewer shows it.
import { useEffect } from "preact/hooks";
import type { Edge, EvidenceRow, Node, ViewDocument } from "../document";
import { digits, words } from "../format";
import { chosen as shownRollout, rolloutOf, tab, worldOf } from "../state";
import { cite, spoken } from "./head";

export const KINDS: Record<Node["kind"], string> = {
  case: "the case",
  observation: "observation",
  world: "world",
  fit: "fit",
  rollout: "rollout",
  evidence: "evidence",
  answer: "answer",
};
const STATUS: Record<EvidenceRow["status"], string> = {
  running: "warn",
  completed: "good",
  failed: "bad",
  cancelled: "warn",
  diverged: "bad",
};
const FEW = 12; // links of a kind that are listed at once

/** The title of a record: what the viewer calls it elsewhere too. */
export function titleOf(node: Node): string {
  if (node.kind === "world") return worldOf(node.id)?.label ?? node.title;
  if (node.kind === "rollout") return rolloutOf(node.id)?.label ?? node.title;
  return node.kind === "answer" ? spoken(node.title) : node.title;
}

export function Detail({ doc, id, onChoose }: { doc: ViewDocument; id: string; onChoose: (id: string) => void }) {
  const node = doc.provenance.nodes.find((n) => n.id === id);
  useEffect(() => {
    if (node?.kind === "rollout" && rolloutOf(id)) shownRollout.value = id;
  }, [id, node?.kind]);
  if (!node) return <p class="provenance-detail small soft">Choose a record to see what it rests on.</p>;
  const row = doc.evidence.find((e) => e.id === id);
  const { edges } = doc.provenance;
  return (
    <div class="provenance-detail" aria-live="polite" data-detail={id}>
      <h3>{KINDS[node.kind]}</h3>
      <p class="title">
        <b>{titleOf(node)}</b>{" "}
        {row && <span class={`chip ${STATUS[row.status]}`}>{row.status}</span>}
        {doc.case.committed_world === id && <span class="chip good">committed</span>}
      </p>
      {node.kind !== "case" && node.kind !== "answer" && <p class="mono small soft">{id}</p>}
      <p>{node.detail}</p>
      {row && <Result row={row} />}
      <Shown node={node} doc={doc} onChoose={onChoose} />
      <Links title="rests on" edges={edges.filter((e) => e.target === id)} end="source" {...{ doc, onChoose }} />
      <Links title="supports" edges={edges.filter((e) => e.source === id)} end="target" {...{ doc, onChoose }} />
    </div>
  );
}

function Result({ row }: { row: EvidenceRow }) {
  return (
    <>
      <p class="result">{row.summary}</p>
      {(row.objects.length > 0 || row.interval) && (
        <p class="small soft">
          {row.objects.map(words).join(", ")}
          {row.interval && ` · ${digits(row.interval[0])} to ${digits(row.interval[1])} s`}
        </p>
      )}
    </>
  );
}

/** Where else the viewer shows the record. */
function Shown({ node, doc, onChoose }: { node: Node; doc: ViewDocument; onChoose: (id: string) => void }) {
  switch (node.kind) {
    case "rollout":
      return rolloutOf(node.id) ? (
        <p class="small">The scene shows it now.</p>
      ) : (
        <p class="small soft">This document does not hold its motion, so the scene cannot show it.</p>
      );
    case "world": {
      const rollout = doc.rollouts.findLast((r) => r.world === node.id);
      return rollout ? <button onClick={() => onChoose(rollout.id)}>show its rollout</button> : null;
    }
    case "fit":
      return doc.fits.length ? <button onClick={() => (tab.value = "fits")}>show the fits</button> : null;
    case "evidence":
      return doc.evidence.some((e) => e.id === node.id) ? (
        <button onClick={() => cite(node.id)}>show in the evidence</button>
      ) : null;
    default:
      return null;
  }
}

interface LinksProps {
  title: string;
  edges: Edge[];
  end: "source" | "target";
  doc: ViewDocument;
  onChoose: (id: string) => void;
}

function Links({ title, edges, end, doc, onChoose }: LinksProps) {
  if (!edges.length) return null;
  return (
    <div>
      <h3>{title}</h3>
      <ul class="small">
        {edges.slice(0, FEW).map((edge) => {
          const node = doc.provenance.nodes.find((n) => n.id === edge[end])!;
          return (
            <li key={edge[end]}>
              <button class="link" onClick={() => onChoose(node.id)}>
                {titleOf(node)}
              </button>{" "}
              <span class="soft">
                {node.kind === "evidence" ? node.id : node.kind}
                {edge.how !== "rests on" && ` (${edge.how.replaceAll("_", " ")})`}
              </span>
            </li>
          );
        })}
        {edges.length > FEW && <li class="soft">and {edges.length - FEW} more</li>}
      </ul>
    </div>
  );
}
