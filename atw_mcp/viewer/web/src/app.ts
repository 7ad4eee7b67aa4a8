// Inside an MCP host: the host hands over a tool's call and result, and forwards requests to the server.
import { moment as seconds } from "./format";
import { effect } from "@preact/signals";
import { appearance, reportSize } from "./appearance";
import { read } from "./case_reader";
import { Host } from "./host";
import type { DisplayMode, HostContext, ToolResult } from "./host_types";
import { hosted, note, unfolded, type Call } from "./hosted";
import {
  chosen,
  compared,
  document as shown,
  evidence,
  failure,
  layout,
  object,
  playing,
  progress,
  rollout,
  show,
  tab,
  time,
} from "./state";

const LOOK_AGAIN = 5_000; // [ms] between looks at work that is not finished: a document takes the server about a second

/** The panel that a tool's result is about. */
const PANELS = { CompareWorlds: "comparison", FindDiscrepancy: "gap", AddEffect: "gap", Finish: "provenance" } as const;

export async function connect(): Promise<void> {
  if (window.parent === window) {
    throw new Error("this page has no document: `atw-mcp report CASE` writes one that has, `atw-mcp view` serves one");
  }
  const host = new Host(window.parent);
  host.on("ui/notifications/tool-input", () => {
    progress.value = `Waiting for the result of ${toolName(host)} …`;
  });
  host.on("ui/notifications/tool-result", (params) => void receive(host, params as ToolResult));
  host.on("ui/notifications/tool-cancelled", (params) => {
    failure.value = `${toolName(host)} was cancelled${params.reason ? `: ${String(params.reason)}` : ""}`;
  });
  host.on("ui/notifications/host-context-changed", (params) => {
    changed(host, params as HostContext);
  });
  host.on("ui/resource-teardown", () => {
    playing.value = false;
    hosted.value = null;
  });
  progress.value = "Connecting …";
  await host.initialize("Asking the World", ["inline", "fullscreen"]);
  appearance(host.context);
  reportSize(host);
}

function toolName(host: Host): string {
  return host.context.toolInfo?.tool?.name ?? "the tool";
}

/** Show the case of a result, with the result's rollouts. */
async function receive(host: Host, result: ToolResult): Promise<void> {
  const text = result.content?.find((block) => block.type === "text")?.text ?? "";
  if (result.isError) {
    failure.value = text || `${toolName(host)} failed`;
    return;
  }
  let call: Call;
  try {
    call = callOf(result.structuredContent ?? JSON.parse(text));
  } catch {
    failure.value = "the host handed over no result of this server's";
    return;
  }
  if (!call.case) {
    failure.value = `${call.tool} says of no case that it is about it`;
    return;
  }
  hosted.value = { host, call, mode: host.context.displayMode ?? "inline" };
  if (call.tool in PANELS) tab.value = PANELS[call.tool as keyof typeof PANELS];
  if (tab.value === "gap") unfolded.value = true; // residuals are what these results are about
  evidence.value = call.evidence;
  await open(call.rollouts);
  followRunning();
}

/** Ids in a result, as the server's tools write it. */
function callOf(value: unknown): Call {
  const body = value as {
    tool: string;
    evidence: string | null;
    summary: string;
    case: string | null;
    source: { rollout: string | null };
    data: { rollout?: unknown; base?: { rollout?: unknown }; edited?: { rollout?: unknown } };
  };
  const named = [body.data?.base?.rollout, body.data?.edited?.rollout];
  const rollouts = (named.every(Boolean) ? named : [body.data?.rollout ?? body.source?.rollout]).filter(
    (id): id is string => typeof id === "string",
  );
  return { tool: body.tool, evidence: body.evidence, summary: body.summary, case: body.case, rollouts };
}

/** Read the case from the server with these rollouts first; what is chosen stays chosen where it still exists. */
export async function open(rollouts: string[]): Promise<void> {
  const app = hosted.value!;
  const first = shown.value === null;
  const say = (text: string) => ((shown.value === null ? progress : note).value = text);
  try {
    for await (const document of read(app.host, app.call.case!, rollouts, say)) {
      show(document);
      if (!first && rollouts[0]) chosen.value = rollouts[0];
    }
    note.value = "";
  } catch (error) {
    const why = words(error);
    if (shown.value === null) failure.value = `The case could not be read through the host: ${why}`;
    else note.value = `The server could not be read through the host: ${why}`;
  }
}

/** Read the case again and again while work on it is not finished. */
function followRunning(): void {
  effect(() => {
    if (!hosted.value || !shown.value?.running.length) return;
    const timer = setTimeout(() => void open([]), LOOK_AGAIN);
    return () => clearTimeout(timer);
  });
}

/** Rollouts that results of the case are about and that the document leaves out. */
export function otherRollouts(): string[] {
  const doc = shown.value;
  const used = new Set(doc?.evidence.map((row) => row.rollout).filter((id) => id !== null));
  return [...used].filter((id) => !doc?.rollouts.some((run) => run.id === id));
}

/** Call a tool of the server through the host; null where that failed, which `note` then says. */
export async function callServer(tool: string, given: Record<string, unknown>): Promise<string | null> {
  try {
    const result = await hosted.value!.host.request<ToolResult>("tools/call", { name: tool, arguments: given });
    const text = result.content?.find((block) => block.type === "text")?.text ?? "";
    if (result.isError) throw new Error(text);
    note.value = "";
    return text;
  } catch (error) {
    note.value = `${tool} failed: ${words(error)}`;
    return null;
  }
}

/** Pass on to the model what the person looks at: for its next answer, or, where the host cannot keep that, as a message. */
export async function share(): Promise<void> {
  const { host } = hosted.value!;
  const content = [{ type: "text", text: moment() }];
  try {
    if (host.capabilities?.updateModelContext) {
      await host.request("ui/update-model-context", { content });
      note.value = `Your next question will be read with: ${content[0]!.text}`;
    } else {
      await host.request("ui/message", { role: "user", content });
    }
  } catch (error) {
    note.value = `The host did not pass it on: ${words(error)}`;
  }
}

/** Fill the screen, or go back into the conversation. */
export async function toggleFullscreen(): Promise<void> {
  const { host, mode } = hosted.value!;
  const wanted = mode === "fullscreen" ? "inline" : "fullscreen";
  changed(host, { displayMode: wanted }); // before the frame changes its size, so that no height is asked for
  let got: DisplayMode = mode;
  try {
    got = (await host.request<{ mode: DisplayMode }>("ui/request-display-mode", { mode: wanted })).mode;
  } catch (error) {
    note.value = `The host did not change the display: ${words(error)}`;
  }
  changed(host, { displayMode: got });
}

function changed(host: Host, context: HostContext): void {
  host.context = { ...host.context, ...context };
  appearance(host.context);
  hosted.value = hosted.value && { ...hosted.value, mode: host.context.displayMode ?? "inline" };
}

function words(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}

/** What the person looks at, in words for the model. */
function moment(): string {
  const run = rollout.value;
  const { case: name } = hosted.value!.call;
  const at = seconds(time.value);
  const parts = [run ? `rollout ${run.id} (${run.label}) at ${at}` : `the video at ${at}`];
  if (layout.value !== "one" && compared.value) parts.push(`compared with rollout ${compared.value}`);
  if (object.value) parts.push(`with the object ${object.value} chosen`);
  return `In the viewer of case ${name} the person looks at ${parts.join(", ")}.`;
}
