"""The viewer as an MCP App: the page that hosts show in the conversation with the results of some tools.

Clients that do not offer the extension are sent no reference to the page, and results are the same for all clients.
Specification: https://github.com/modelcontextprotocol/ext-apps/blob/main/specification/2026-01-26/apps.mdx.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import anyio
from mcp.server.apps import APP_MIME_TYPE, Apps, client_supports_apps
from mcp.server.context import CallNext, HandlerResult, ServerRequestContext
from mcp.server.mcpserver.exceptions import ResourceError
from mcp.server.mcpserver.resources import Resource

VIEWER = "ui://atw/viewer"
SHOWN_WITH: dict[str, Any] = {"ui": {"resourceUri": VIEWER}}
"""`_meta` of a tool whose results the viewer shows."""

FILE = Path(__file__).parents[1] / "viewer" / "viewer.html"
# No domains: the page loads nothing. A border: the film and the scene are darker or lighter than a conversation.
PAGE: dict[str, Any] = {
    "ui": {
        "csp": {"connectDomains": [], "resourceDomains": [], "frameDomains": [], "baseUriDomains": []},
        "prefersBorder": True,
    }
}


class ViewerPage(Resource):
    """The page, which gets its data from the host."""

    async def read(self) -> str:
        """Return the HTML; raises ResourceError where this installation lacks it."""
        try:
            return await anyio.to_thread.run_sync(lambda: FILE.read_text(encoding="utf-8"))
        except FileNotFoundError as error:
            raise ResourceError(
                f"this installation has no {FILE.name}: install atw-mcp again, or in a checkout run "
                "`node build.mjs` in atw_mcp/viewer/web"
            ) from error


def viewer_app() -> Apps:
    """Return the extension with the page; tools refer to it by `SHOWN_WITH`."""
    apps = Apps()
    apps.add_resource(
        ViewerPage(
            uri=VIEWER,
            name="viewer",
            title="Viewer",
            description="a case as a film, a scene, a timeline and series; for hosts that render apps",
            mime_type=APP_MIME_TYPE,
            meta=PAGE,
        )
    )
    return apps


async def apps_where_rendered(ctx: ServerRequestContext[Any, Any], call_next: CallNext) -> HandlerResult:
    """Leave the references to the page out of the list of tools for clients that do not render apps (middleware)."""
    result = await call_next(ctx)
    if ctx.method == "tools/list" and isinstance(result, dict) and not client_supports_apps(ctx):
        for tool in result["tools"]:
            tool.pop("_meta", None)
    return result
