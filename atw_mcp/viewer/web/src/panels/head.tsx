// The case: its file, its questions with their answers, and the evidence that each answer rests on.
import type { Answer, CaseView } from "../document";
import { digits } from "../format";
import { Icon } from "../icons";
import { helpOpen } from "../keys";
import { document, evidence, gone, live, lost, record, tab } from "../state";
import { Chances, Doubt, Trust } from "./trust";
import { preference, type Preference } from "../theme";
import { Agreement } from "./agreement";
import "./head.css";

const THEMES: Record<Preference, string> = { system: "system theme", light: "light theme", dark: "dark theme" };
const FOLDED_ABOVE = 2; // questions: more of them would push the film off a laptop's screen

export function Head() {
  const doc = document.value!;
  const rows = paired(doc.case);
  const answered = rows.filter(({ answer }) => answer?.answer != null).length;
  const list = (
    <ul class="answers">
      {rows.map((row) => (
        <Row key={row.question} {...row} />
      ))}
    </ul>
  );
  return (
    <header class="head">
      <div class="bar">
        <h1>{doc.case.id}</h1>
        {doc.case.file && <span class="chip">{doc.case.file}</span>}
        {live.value && (
          <span class={lost.value || gone.value ? "chip bad" : "chip good"}>
            {lost.value ? "not connected" : gone.value ? "store gone" : "live"}
          </span>
        )}
        <span class="push" />
        <Theme />
        <button class="quiet icon" aria-label="Keys" title="Keys (?)" onClick={() => (helpOpen.value = true)}>
          <b aria-hidden="true">?</b>
        </button>
      </div>
      <Trust />
      {rows.length > FOLDED_ABOVE ? (
        <details>
          <summary>
            {rows.length} questions, {answered} answered
          </summary>
          {list}
        </details>
      ) : (
        rows.length > 0 && list
      )}
      <Agreement />
    </header>
  );
}

/** Each question with the latest answer to it, questions first asked first. */
export function paired(view: CaseView): { question: string; answer: Answer | null }[] {
  const latest = new Map<string, Answer | null>(view.questions.map((question) => [question, null]));
  for (const answer of view.answers) latest.set(answer.question, answer);
  return [...latest].map(([question, answer]) => ({ question, answer }));
}

function Row({ question, answer }: { question: string; answer: Answer | null }) {
  const settled = answer?.answer ?? null;
  return (
    <li class="answer panel" data-question={question} data-answer={settled ?? ""}>
      <p class="question">{question}</p>
      <p class="verdict">
        {settled !== null ? spoken(settled) : <span class="soft">{answer ? "unresolved" : "not answered yet"}</span>}
      </p>
      {answer && (
        <div class="because small soft">
          {answer.confidence !== null && (
            <span class="number" data-value={answer.confidence}>
              <meter min={0} max={1} value={answer.confidence} aria-label="confidence" /> confidence{" "}
              {digits(answer.confidence, 2)}
            </span>
          )}
          <Chances answer={answer} />
          {settled !== null && <Doubt />}
          {answer.missing && <span>{answer.missing}</span>}
          {answer.evidence.length > 0 && <span>evidence</span>}
          {answer.evidence.map((id) => (
            <Cited key={id} id={id} />
          ))}
          <button class="link" onClick={() => trace(answer)}>
            how it was found
          </button>
        </div>
      )}
    </li>
  );
}

function Cited({ id }: { id: string }) {
  const row = document.value!.evidence.find((one) => one.id === id);
  return (
    <button class="link" title={row?.summary} onClick={() => cite(id)}>
      {row && `${row.tool} `}
      <span>{id}</span>
    </button>
  );
}

/** An answer as a person gives it. */
export function spoken(answer: string): string {
  return answer === "true" ? "yes" : answer === "false" ? "no" : answer;
}

/** Show what an answer rests on in the provenance graph, where answers are numbered by age. */
function trace(answer: Answer): void {
  const view = document.value!.case;
  record.value = `answer-${view.answers.indexOf(answer) + 1}-${view.id}`;
  tab.value = "provenance";
  bringUp();
}

/** Scroll to the panels below the timeline, once what was chosen is drawn there. */
function bringUp(): void {
  requestAnimationFrame(() => window.document.getElementById("details")?.parentElement?.scrollIntoView({ block: "nearest" }));
}

/** Show a row of evidence in its list. */
export function cite(id: string): void {
  evidence.value = id;
  tab.value = "evidence";
  bringUp();
}

function Theme() {
  const next: Record<Preference, Preference> = { system: "light", light: "dark", dark: "system" };
  return (
    <button
      class="quiet icon"
      aria-label={THEMES[preference.value]}
      title={`${THEMES[preference.value]}; change to ${THEMES[next[preference.value]]}`}
      onClick={() => (preference.value = next[preference.value])}
    >
      <Icon name={preference.value} />
    </button>
  );
}
