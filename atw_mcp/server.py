"""The MCP server: which tools there are and how they are served.

How a group of tools is written (see `atw_mcp/tools/inspection.py`)
-------------------------------------------------------------------
A module in `atw_mcp/tools` has one `GROUP = ToolGroup(role)`; each tool is a plain `def` under
`@GROUP.tool("ToolName", title=..., read_only=..., pictures=...)`. Add the module to `MODULES` in
`atw_mcp/tools/manifest.py` and run `python -m atw_mcp.tools.manifest`; nothing else registers it. The server lists
the tools from that manifest and imports a tool's module when it is first called: what few calls need is imported
where it is needed, so that the others start quickly.

- Arguments: the first is `app: App` (not seen by the agent); every other is typed, bounded and described with
  `Annotated[T, Field(description=..., ge=..., max_length=...)]`. Nested models need `extra="forbid"`. Lists
  instead of tuples. The docstring is the tool's description; it and the field descriptions are all an agent
  reads. Unknown arguments are refused by the toolbox, naming the valid ones.
- State: `app.case(id)`;
  `case, world = app.case_to_probe(id, "ToolName")` in experimentation tools; `app.world(case, id_or_None)`;
  `app.keep_world(...)`; `app.store` for the rest. All raise `ToolError` with the next step.
- The function runs in a worker thread. It returns an `Answer` (summary, data, provenance, pictures): the
  toolbox records it as evidence and shapes it, so a tool never writes evidence itself. NaN and numpy values are
  fine in `data`. Put a short version in `shown` when `data` is long. With `pictures=True` the JSON comes as text
  and the images beside it, without structured content.
- Work that may take more than a few seconds returns a `LongWork` instead (`atw_mcp/calls/jobs.py`), which
  becomes a task for clients that offer the extension (`atw_mcp/calls/tasks.py`).
- Refusals: `raise ToolError("what failed; the valid values. Next: Tool(...)")`. Wrap calls into polyworld,
  perception or the store, whose KeyError/ValueError messages are written for readers, in
  `with explained("Tool(...)"):`. Any other exception becomes a generic sentence and is logged.
- Nothing is computed twice: `app.store.rollouts.get_or_compute(kind, inputs, compute)` and likewise
  `.observations` and `.fits`.
- Every path that an agent gives goes through `app.files` (`atw_mcp/calls/files.py`).
"""

from __future__ import annotations

import base64
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import anyio
import platformdirs
from mcp.server import MCPServer
from mcp.server.lowlevel.helper_types import ReadResourceContents
from mcp.server.mcpserver.context import Context
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.mcpserver.tools import Tool
from mcp_types import CallToolResult, Icon, InputRequiredResult
from mcp_types import Tool as ListedTool
from pydantic import AnyUrl

from atw_mcp import resources
from atw_mcp.calls import completions, watching
from atw_mcp.calls.app import App
from atw_mcp.calls.apps import apps_where_rendered, viewer_app
from atw_mcp.calls.brief import brief_tool
from atw_mcp.calls.deferred import DeferredTool
from atw_mcp.calls.error_text import bounded_errors
from atw_mcp.calls.files import allowed_folders
from atw_mcp.calls.limits import Limits
from atw_mcp.calls.prompting import PromptServer, add_prompts
from atw_mcp.calls.tasks import TasksExtension
from atw_mcp.calls.toolbox import ToolGroup, WorldTool
from atw_mcp.calls.toolsets import CALL, Selection, instructions
from atw_mcp.calls.version import installed_version
from atw_mcp.tools import manifest
from atw_mcp.viewer import in_parts

GROUPS: tuple[ToolGroup, ...] = ()
"""Tools that are served beside those of the manifest: tests add theirs."""


ICON = "data:image/svg+xml;base64," + base64.b64encode(
    b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><rect width="32" height="32" rx="6" fill="#00659e"/>'
    b'<path d="M4 9Q10 26 16 26Q22 14 28 26" fill="none" stroke="#fff" stroke-width="2" stroke-dasharray="3 2"/>'
    b'<circle cx="4" cy="9" r="3" fill="#e69f00"/></svg>'
).decode("ascii")
"""A ball that bounces."""


def default_store() -> Path:
    """Where the store is when nobody says otherwise: the user's data folder."""
    return Path(platformdirs.user_data_dir("atw-mcp", appauthor=False)) / "atw.db"


class WorldServer(PromptServer):
    """The server: lists few of its tools; refusals name those there are, and how to get those that are not served."""

    world_app: App

    async def list_tools(self) -> list[ListedTool]:
        """The tools to list, in their short form."""
        unlisted = self.world_app.selection.unlisted(self.world_app.tools)
        listed = [brief_tool(tool) for tool in await self.full_tools() if tool.name not in unlisted]
        names = f" Tools: {', '.join(unlisted)}."
        return [
            tool.model_copy(update={"description": f"{tool.description}{names}"}) if tool.name == CALL else tool
            for tool in listed
        ]

    async def full_tools(self) -> list[ListedTool]:
        """Every tool that is served, with its whole description and schemas."""
        return await super().list_tools()

    async def read_resource(
        self, uri: AnyUrl | str, context: Context[App, Any] | None = None
    ) -> Iterable[ReadResourceContents] | InputRequiredResult:
        """One resource; a picture has the media type of its own bytes. Raises ResourceError."""
        read = await super().read_resource(uri, context)
        if isinstance(read, InputRequiredResult):
            return read
        return [
            replace(part, mime_type=resources.image_type(part.content))
            if isinstance(part.content, bytes) and (part.mime_type or "").startswith("image/")
            else part
            for part in read
        ]

    async def call_tool(
        self, name: str, arguments: dict[str, Any], context: Context[App, Any] | None = None
    ) -> CallToolResult | InputRequiredResult:
        """Call one tool; raises ToolError naming the tools for an unknown one."""
        try:
            return await super().call_tool(self.world_app.tool(name).name, arguments, context)
        except ToolError as error:
            notes = self.world_app.selection.notes_on(str(error), self.world_app.tools)
            if not notes or notes in str(error):
                raise
            raise ToolError(f"{error} ({notes})") from error


def build_server(
    store: Path | None = None,
    *,
    allow: Iterable[Path] = (),
    selection: Selection | None = None,
    limits: Limits | None = None,
) -> WorldServer:
    """The server on a store (default: `default_store()`); raises StoreError where the store cannot be used.

    allow: folders and files that calls may have read, besides those of `allowed_folders`. selection: tools to serve
    and to list. limits: of what one call may ask for.
    """
    app = App(store or default_store(), allowed_folders(allow), limits)
    app.tools, app.selection = all_tools(), selection or Selection()

    @asynccontextmanager
    async def lifespan(_: MCPServer[App]) -> AsyncIterator[App]:
        try:
            async with app.watch.running():
                yield app
        finally:
            with anyio.CancelScope(shield=True):
                await anyio.to_thread.run_sync(app.stop_work)

    server = WorldServer(
        "asking-the-world",
        title="Asking the World",
        icons=[Icon(src=ICON, mime_type="image/svg+xml", sizes=["any"])],
        instructions=instructions(app.selection),
        version=installed_version(),
        tools=list[Tool](app.served),
        extensions=[TasksExtension(app), viewer_app()],
        lifespan=lifespan,
        middleware=[bounded_errors, apps_where_rendered],
        log_level="WARNING",
    )
    server.world_app = app
    resources.register(server, app)
    in_parts.register(server, app)
    completions.register(server, app)
    watching.register(server, app)
    add_prompts(server)
    return server


def all_tools() -> list[WorldTool]:
    """Every tool, in the order of the method, as yet not imported."""
    listed: list[WorldTool] = [DeferredTool.from_entry(entry) for entry in manifest.entries()]
    return listed + [tool for group in GROUPS for tool in group.tools]
