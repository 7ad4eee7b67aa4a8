// A page that follows a case while it is worked on: the server sends an event when its records or its work change.
import type { Running } from "./document";
import { live, lost, progressing, show } from "./state";
import { unpack } from "./unpack";

const AGAIN = 2000; // ms until a server that refused or ended a connection is asked again

interface State {
  revision: string;
  running: Running[];
}

/** Revision of the document that is shown. */
let shown = "";
let wanted = "";
let loading: Promise<void> | null = null;

export async function follow(): Promise<void> {
  await load();
  live.value = true;
  connect();
}

function connect(): void {
  const source = new EventSource("changes");
  source.addEventListener("open", () => (lost.value = null));
  source.addEventListener("state", (event) => {
    const state = JSON.parse((event as MessageEvent<string>).data) as State;
    wanted = state.revision;
    progressing.value = state.running;
    loading ??= catchUp().finally(() => (loading = null));
  });
  source.addEventListener("error", () => {
    lost.value ??= new Date();
    if (source.readyState !== EventSource.CLOSED) return; // the browser tries again by itself
    source.close();
    setTimeout(connect, AGAIN);
  });
}

/** Load the document until it is of the revision that the server named last. */
async function catchUp(): Promise<void> {
  try {
    while (shown !== wanted) await load();
  } catch {
    lost.value ??= new Date(); // the next event, or the next connection, asks again
  }
}

async function load(): Promise<void> {
  const answer = await fetch("document", { cache: "no-store" });
  if (!answer.ok) throw new Error((await answer.text()) || `the server answered ${answer.status}`);
  show(await unpack(new Uint8Array(await answer.arrayBuffer())));
  shown = wanted = (answer.headers.get("etag") ?? "").replaceAll('"', "");
}
