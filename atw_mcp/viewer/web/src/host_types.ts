// What an MCP host says to the viewer, as far as the viewer reads it.
export type DisplayMode = "inline" | "fullscreen" | "pip";

export interface HostContext {
  theme?: "light" | "dark";
  styles?: { variables?: Record<string, string | undefined> };
  displayMode?: DisplayMode;
  availableDisplayModes?: string[];
  containerDimensions?: { height?: number; maxHeight?: number; width?: number; maxWidth?: number };
  safeAreaInsets?: { top: number; right: number; bottom: number; left: number };
  toolInfo?: { tool?: { name?: string } };
}

export interface InitializeResult {
  hostContext?: HostContext;
  hostCapabilities?: {
    serverTools?: object;
    serverResources?: object;
    updateModelContext?: object;
    message?: object;
  };
}

export interface ToolResult {
  content?: { type: string; text?: string }[];
  structuredContent?: unknown;
  isError?: boolean;
}

export interface ResourceContents {
  contents: { text?: string; blob?: string }[];
}
