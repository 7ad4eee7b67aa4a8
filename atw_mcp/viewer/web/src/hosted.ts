// The conversation that the page is shown in, where it is shown in one.
import { signal } from "@preact/signals";
import type { Host } from "./host";
import type { DisplayMode } from "./host_types";

/** A call of one of the server's tools, whose result the page shows. */
export interface Call {
  tool: string;
  evidence: string | null;
  summary: string;
  case: string | null;
  /** The rollouts that the result is about, at most two. */
  rollouts: string[];
}

export interface Hosted {
  host: Host;
  call: Call;
  mode: DisplayMode;
}

/** null: the page is no app. */
export const hosted = signal<Hosted | null>(null);
/** What is going on, or why something failed, while a document is shown. */
export const note = signal("");
/** Whether the panels below the timeline are shown in the conversation. */
export const unfolded = signal(false);
