// Results of tools: filtered, and shown where they speak of a rollout that is here.
import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { EvidenceRow } from "../document";
import { digits, words } from "../format";
import { chosen, compared, document, evidence, layout, object, rolloutOf, seek } from "../state";
import { chooseBase } from "./choosers";
import "./evidence.css";

const text = signal("");
const tool = signal("");
const about = signal("");

const SHADES: Record<EvidenceRow["status"], string> = {
  completed: "chip",
  running: "chip warn",
  cancelled: "chip warn",
  failed: "chip bad",
  diverged: "chip bad",
};

export function Evidence() {
  const all = document.value!.evidence;
  const rows = all.filter(matches);
  return (
    <div class="evidence">
      <div class="bar filters">
        <input
          type="search"
          aria-label="Filter by words or id"
          placeholder="words or id"
          value={text.value}
          onInput={(event) => (text.value = event.currentTarget.value)}
        />
        <Filter label="tool" all="every tool" from={all.map((row) => row.tool)} value={tool} />
        <Filter label="object" all="every object" from={all.flatMap((row) => row.objects)} value={about} />
        <span class="soft small" role="status">
          {rows.length} of {all.length}
        </span>
      </div>
      <ul class="scroll">
        {rows.map((row) => (
          <Row key={row.id} row={row} />
        ))}
      </ul>
      {rows.length === 0 && <p class="empty">{all.length ? "No evidence matches." : "No tool has been called yet."}</p>}
    </div>
  );
}

function matches(row: EvidenceRow): boolean {
  if (evidence.value === row.id) return true; // the chosen row stays in sight
  if (tool.value && row.tool !== tool.value) return false;
  if (about.value && !row.objects.includes(about.value)) return false;
  const wanted = text.value.trim().toLowerCase();
  return [row.id, row.tool, row.status, row.summary, ...row.objects].join(" ").toLowerCase().includes(wanted);
}

function Filter({ label, all, from, value }: { label: string; all: string; from: string[]; value: typeof text }) {
  const names = [...new Set(from)].sort();
  if (names.length < 2) return null;
  return (
    <select aria-label={label} value={value.value} onChange={(event) => (value.value = event.currentTarget.value)}>
      <option value="">{all}</option>
      {names.map((name) => (
        <option key={name} value={name}>
          {words(name)}
        </option>
      ))}
    </select>
  );
}

function Row({ row }: { row: EvidenceRow }) {
  const button = useRef<HTMLButtonElement>(null);
  const selected = evidence.value === row.id;
  useEffect(() => {
    if (selected) button.current?.scrollIntoView({ block: "nearest" });
  }, [selected]);
  const shown = rolloutOf(row.rollout);
  return (
    <li>
      <button
        class="row"
        ref={button}
        aria-pressed={selected}
        title={shown ? `Show ${shown.label} at this interval` : undefined}
        data-evidence={row.id}
        onClick={() => open(row)}
      >
        <span class="mono soft">{row.id}</span>
        <b>{row.tool}</b>
        <span class={SHADES[row.status]}>{row.status}</span>
        <span class="summary">{row.summary}</span>
        <span class="summary small soft">{details(row).join(" · ")}</span>
      </button>
    </li>
  );
}

function details(row: EvidenceRow): string[] {
  const [from, to] = row.interval ?? [null, null];
  const end = to === null ? "the end" : `${digits(to)} s`;
  const shown = rolloutOf(row.rollout);
  return [
    row.objects.map(words).join(", "),
    row.interval === null ? "" : from === null ? `until ${end}` : `${digits(from)} s to ${end}`,
    shown ? `rollout: ${shown.label}` : row.rollout ? "its rollout is not in this page" : "",
  ].filter(Boolean);
}

/** Choose a row; show its rollout, its only object and the start of its interval. */
function open(row: EvidenceRow): void {
  evidence.value = row.id;
  if (!rolloutOf(row.rollout)) return;
  const visible = chosen.value === row.rollout || (layout.value !== "one" && compared.value === row.rollout);
  if (!visible) chooseBase(row.rollout!);
  if (row.objects.length === 1) object.value = row.objects[0]!;
  if (row.interval) seek(row.interval[0] ?? 0);
}
