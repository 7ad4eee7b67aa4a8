// Inside an MCP host: the host hands over the results of tools, and forwards requests to the server.
export async function connect(): Promise<void> {
  throw new Error("this page has no document");
}
