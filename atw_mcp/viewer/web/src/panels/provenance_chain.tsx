// The provenance as a nested list: each answer, what it rests on, what that rests on, back to the video.
import { useMemo } from "preact/hooks";
import type { Node, ViewDocument } from "../document";
import { needed, neighbours, reduced } from "../lineage/graph";
import { KINDS, titleOf } from "./provenance_detail";

interface Props {
  doc: ViewDocument;
  chosen: string;
  onChoose: (id: string) => void;
}

export function Chain({ doc, chosen, onChoose }: Props) {
  const { nodes } = doc.provenance;
  const answers = nodes.filter((node) => node.kind === "answer");
  const { sources, known, kept } = useMemo(() => {
    const links = reduced(doc.provenance.edges, new Set(answers.map((answer) => answer.id)));
    return {
      sources: neighbours(links, (l) => [l.target, l.source]),
      known: new Map(nodes.map((node) => [node.id, node])),
      kept: needed(doc.provenance),
    };
  }, [doc]);
  const byTool = new Map<string, Node[]>();
  for (const node of nodes) {
    if (node.kind !== "evidence" || kept.has(node.id)) continue;
    byTool.set(node.title, [...(byTool.get(node.title) ?? []), node]);
  }
  const name = (node: Node) => (
    <button
      class="link"
      data-node={node.id}
      data-kind={node.kind}
      aria-current={node.id === chosen}
      onClick={() => onChoose(node.id)}
    >
      {titleOf(node)}
    </button>
  );
  const branch = (id: string, seen: Set<string>) => {
    const node = known.get(id)!;
    const again = seen.has(id);
    seen.add(id);
    const below = again ? [] : (sources.get(id) ?? []);
    return (
      <li key={id}>
        {name(node)} <span class="soft small">{node.kind === "evidence" ? id : KINDS[node.kind]}</span>
        {again && (sources.get(id) ?? []).length > 0 && <span class="soft small"> (as above)</span>}
        {below.length > 0 && <ul>{below.map((source) => branch(source, seen))}</ul>}
      </li>
    );
  };
  return (
    <div class="provenance-chain">
      {answers.length === 0 && <p class="soft">No question was answered yet.</p>}
      {answers.map((answer) => {
        const seen = new Set([answer.id]);
        return (
          <details key={answer.id} open={answer.id === chosen || answers.length === 1}>
            <summary>
              {answer.detail} <b>{titleOf(answer)}</b>
            </summary>
            <p class="small soft">rests on</p>
            <ul>{(sources.get(answer.id) ?? []).map((source) => branch(source, seen))}</ul>
          </details>
        );
      })}
      {byTool.size > 0 && (
        <details>
          <summary>evidence that no answer rests on</summary>
          <ul>
            {[...byTool].map(([tool, members]) => (
              <li key={tool}>
                {tool}:{" "}
                {members.map((node) => (
                  <button
                    key={node.id}
                    class="link"
                    data-node={node.id}
                    data-kind="evidence"
                    onClick={() => onChoose(node.id)}
                  >
                    {node.id}
                  </button>
                ))}
              </li>
            ))}
          </ul>
        </details>
      )}
    </div>
  );
}
