// An MCP host in a page: calls a tool of a server over HTTP and shows the tool's app, as the ext-apps package's
// AppBridge does it. Everything that the app sends is kept in `heard`, for a test to look at.
import {
  AppBridge,
  getToolUiResourceUri,
  PostMessageTransport,
  RESOURCE_MIME_TYPE,
} from "@modelcontextprotocol/ext-apps/app-bridge";
import { Client, StreamableHTTPClientTransport } from "@modelcontextprotocol/client";

interface Wanted {
  tool: string;
  arguments: Record<string, unknown>;
  era: "auto" | "legacy";
  /** Address of the sandbox page, of another origin than this page. */
  sandbox: string;
  width: number;
  theme: "light" | "dark";
  /** Refuse the app's requests to read resources. */
  refuse?: boolean;
}

interface Message {
  method: string;
  params: Record<string, unknown>;
}

const heard: Message[] = [];
const failed: string[] = [];
let bridge: AppBridge;

async function start(wanted: Wanted): Promise<string> {
  const client = new Client(
    { name: "host in a page", version: "1" },
    {
      capabilities: { extensions: { "io.modelcontextprotocol/ui": { mimeTypes: [RESOURCE_MIME_TYPE] } } },
      versionNegotiation: { mode: wanted.era },
    },
  );
  await client.connect(new StreamableHTTPClientTransport(new URL("/mcp", location.href)));
  const tool = (await client.listTools()).tools.find((t) => t.name === wanted.tool)!;
  const { contents } = await client.readResource({ uri: getToolUiResourceUri(tool)! });
  const page = contents[0] as { text: string; mimeType: string; _meta: { ui: { csp: object } } };
  if (page.mimeType !== RESOURCE_MIME_TYPE) throw new Error(`the page is ${page.mimeType}`);

  const frame = document.createElement("iframe");
  frame.setAttribute("sandbox", "allow-scripts allow-same-origin");
  frame.style.cssText = `width: ${wanted.width}px; height: 300px; border: 0`;
  document.body.append(frame);
  addEventListener("message", ({ source, data }) => {
    if (source === frame.contentWindow && data?.method) heard.push({ method: data.method, params: data.params ?? {} });
  });
  const ready = until("ui/notifications/sandbox-proxy-ready");
  frame.src = wanted.sandbox;
  await ready;

  bridge = new AppBridge(
    client,
    { name: "host in a page", version: "1" },
    { serverTools: {}, serverResources: {}, updateModelContext: { text: {} } },
    {
      hostContext: {
        theme: wanted.theme,
        platform: "web",
        displayMode: "inline",
        availableDisplayModes: ["inline", "fullscreen"],
        containerDimensions: { width: wanted.width, maxHeight: 6000 },
        safeAreaInsets: { top: 0, right: 0, bottom: 6, left: 0 },
        toolInfo: { tool },
      },
    },
  );
  if (wanted.refuse) {
    const forward = bridge.connect.bind(bridge);
    bridge.connect = async (transport) => {
      await forward(transport);
      bridge.onreadresource = () => Promise.reject(new Error("this host lets no app read resources"));
    };
  }
  bridge.onsizechange = ({ height }) => {
    if (height !== undefined) frame.style.height = `${height}px`;
  };
  bridge.onrequestdisplaymode = async ({ mode }) => {
    frame.style.cssText =
      mode === "fullscreen"
        ? "position: fixed; inset: 0; width: 100%; height: 100%; border: 0"
        : `width: ${wanted.width}px; border: 0`;
    await bridge.sendHostContextChange({ displayMode: mode });
    return { mode };
  };
  bridge.onupdatemodelcontext = async () => ({});
  bridge.onerror = (error) => failed.push(String(error));
  const initialized = new Promise<void>((resolve) => (bridge.oninitialized = () => resolve()));
  await bridge.connect(new PostMessageTransport(frame.contentWindow!, frame.contentWindow!));
  await bridge.sendSandboxResourceReady({ html: page.text, csp: page._meta.ui.csp });
  await initialized;
  await bridge.sendToolInput({ arguments: wanted.arguments });
  const result = await client.callTool({ name: wanted.tool, arguments: wanted.arguments });
  await bridge.sendToolResult(result as Parameters<AppBridge["sendToolResult"]>[0]);
  return client.getNegotiatedProtocolVersion() ?? "";
}

function until(method: string): Promise<void> {
  return new Promise((resolve) => {
    const look = ({ data }: MessageEvent) => {
      if (data?.method !== method) return;
      removeEventListener("message", look);
      resolve();
    };
    addEventListener("message", look);
  });
}

const theme = (value: "light" | "dark") => bridge.sendHostContextChange({ theme: value });
const end = () => bridge.teardownResource({});
Object.assign(window, { host: { start, heard, failed, theme, end } });
