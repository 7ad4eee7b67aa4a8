// Where the document comes from: the page itself (report), the server that sent it (view), or an MCP host (app).
import { failure, show } from "./state";
import { fromBase64, unpack } from "./unpack";

export async function open(): Promise<void> {
  try {
    const inside = document.getElementById("document");
    if (inside) show(await unpack(fromBase64(inside.textContent ?? "")));
    else if (document.querySelector('meta[name="atw-live"]')) await (await import("./live")).follow();
    else await (await import("./app")).connect();
  } catch (error) {
    failure.value = error instanceof Error ? error.message : String(error);
  }
}
