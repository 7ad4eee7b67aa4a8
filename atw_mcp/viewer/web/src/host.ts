// JSON-RPC with the MCP host that shows this page, over postMessage: the part of the MCP Apps protocol that the viewer
// uses. Written out because the package of the protocol adds 600 kB, as much as the rest of the page.
// Specification: https://github.com/modelcontextprotocol/ext-apps/blob/main/specification/2026-01-26/apps.mdx
import type { DisplayMode, HostContext, InitializeResult } from "./host_types";

type Params = Record<string, unknown>;
type Waiting = { resolve: (result: unknown) => void; reject: (error: Error) => void };

const PROTOCOL = "2026-01-26";
const VERSION = "1"; // of the documents that the page reads, atw-view/1
const METHOD_NOT_FOUND = -32601;
const ANSWER_WITHIN = 10_000; // [ms] a host answers the first request at once, if it is one at all

export class Host {
  context: HostContext = {};
  capabilities: InitializeResult["hostCapabilities"] = {};
  private readonly waiting = new Map<number, Waiting>();
  private readonly heard = new Map<string, (params: Params) => void>();
  private lastId = 0;

  constructor(private readonly peer: Window) {
    addEventListener("message", (event) => {
      if (event.source === this.peer) this.receive(event.data as unknown);
    });
  }

  /** Do something with every notification or request of this method; a request is answered with {}. */
  on(method: string, action: (params: Params) => void): void {
    this.heard.set(method, action);
  }

  /** Shake hands, after which the host sends its notifications. Rejects where nobody answers. */
  async initialize(name: string, modes: DisplayMode[]): Promise<void> {
    const hello = this.request<InitializeResult>("ui/initialize", {
      appInfo: { name, version: VERSION },
      appCapabilities: { availableDisplayModes: modes },
      protocolVersion: PROTOCOL,
    });
    const silence = new Promise<never>((_, reject) =>
      setTimeout(() => reject(new Error("the page around this one is no MCP host that shows apps")), ANSWER_WITHIN),
    );
    const answer = await Promise.race([hello, silence]);
    this.context = answer.hostContext ?? {};
    this.capabilities = answer.hostCapabilities ?? {};
    this.notify("ui/notifications/initialized");
  }

  /** Ask the host; rejects with the host's own message. */
  request<Result>(method: string, params: Params): Promise<Result> {
    const id = ++this.lastId;
    return new Promise<Result>((resolve, reject) => {
      this.waiting.set(id, { resolve: resolve as (result: unknown) => void, reject });
      this.send({ id, method, params });
    });
  }

  notify(method: string, params: Params = {}): void {
    this.send({ method, params });
  }

  private send(message: Params): void {
    this.peer.postMessage({ jsonrpc: "2.0", ...message }, "*"); // the host's origin is not known to a page in a sandbox
  }

  private receive(data: unknown): void {
    const message = data as {
      jsonrpc?: string;
      id?: number;
      method?: string;
      params?: Params;
      result?: unknown;
      error?: { message?: string };
    };
    if (message?.jsonrpc !== "2.0") return;
    if (message.method === undefined) {
      const waiting = this.waiting.get(message.id!);
      this.waiting.delete(message.id!);
      if (message.error) waiting?.reject(new Error(message.error.message ?? "the host refused"));
      else waiting?.resolve(message.result);
      return;
    }
    const action = this.heard.get(message.method);
    action?.(message.params ?? {});
    if (message.id === undefined) return;
    if (action || message.method === "ping") this.send({ id: message.id, result: {} });
    else
      this.send({ id: message.id, error: { code: METHOD_NOT_FOUND, message: `the viewer has no ${message.method}` } });
  }
}
