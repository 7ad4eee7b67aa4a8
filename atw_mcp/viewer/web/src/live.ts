// A page that follows a case while it is worked on: the server sends an event when its records or its work change.
import type { Running } from "./document";
import { gone, live, lost, progressing, show } from "./state";
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
  source.addEventListener("open", () => {
    lost.value = null;
    gone.value = "";
  });
  source.addEventListener("state", (event) => {
    const state = JSON.parse((event as MessageEvent<string>).data) as State;
    lost.value = null;
    wanted = state.revision;
    progressing.value = state.running;
    reload();
  });
  source.addEventListener("store", (event) => {
    gone.value = (JSON.parse((event as MessageEvent<string>).data) as { gone: string }).gone;
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
  while (shown !== wanted) {
    try {
      await load();
    } catch (error) {
      console.warn("the document was not loaded", error);
      setTimeout(reload, AGAIN);
      return;
    }
  }
}

function reload(): void {
  loading ??= catchUp().finally(() => (loading = null));
}

async function load(): Promise<void> {
  const before = wanted;
  const answer = await fetch("document", { cache: "no-store" });
  if (!answer.ok) throw new Error((await answer.text()) || `the server answered ${answer.status}`);
  const next = await unpack(new Uint8Array(await answer.arrayBuffer()));
  shown = (answer.headers.get("etag") ?? "").replaceAll('"', "");
  if (wanted === before) wanted = shown; // else the server has named a later one meanwhile
  show(next);
}
