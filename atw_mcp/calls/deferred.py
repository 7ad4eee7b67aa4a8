"""Tools that are listed without being imported: the first call of one imports its module."""

from __future__ import annotations

import logging
from importlib import import_module
from threading import Lock
from typing import Any, Self

import anyio
from mcp.server.mcpserver.context import Context
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.mcpserver.utilities.func_metadata import ArgModelBase, FuncMetadata

from atw_mcp.calls.toolbox import ToolGroup, WorldTool

logger = logging.getLogger(__name__)
_importing = Lock()  # modules that import each other must not be imported by two calls at once
NOT_LISTED = {"fn_metadata", "is_async", "context_kwarg", "resolver_plans", "returns"}  # what only a call needs


class DeferredTool(WorldTool):
    """A tool as the manifest lists it. module: where it is declared, in a `GROUP` of tools."""

    module: str

    @classmethod
    def from_entry(cls, entry: dict[str, Any]) -> Self:
        """Read an entry of the manifest, as `entry_of` writes it."""
        listed = {key: value for key, value in entry.items() if key != "output_schema"}

        def call(*arguments: Any, **named: Any) -> Any:
            return tool.declared().fn(*arguments, **named)

        metadata = FuncMetadata(arg_model=ArgModelBase, output_schema=entry.get("output_schema"))
        tool = cls(**listed, fn=call, fn_metadata=metadata, is_async=False, context_kwarg=None)
        return tool

    def declared(self) -> WorldTool:
        """Return the tool as its module declares it; imports the module where no call has yet, which takes seconds.

        Raises ToolError where the module cannot be imported.
        """
        try:
            with _importing:
                group: ToolGroup = import_module(self.module).GROUP
        except ImportError as error:
            logger.exception("%s cannot be imported", self.module)
            raise ToolError(
                f"{self.name} cannot be used: a part of this installation is missing ({error.name or 'see the log'}). "
                "Install atw-mcp again; other tools still work"
            ) from error
        return next(tool for tool in group.tools if tool.name == self.name)

    @property
    def full_output(self) -> dict[str, Any]:
        """Schema of all that it returns; imports the tool."""
        return self.declared().full_output

    async def run(self, arguments: dict[str, Any], context: Context[Any, Any], convert_result: bool = False) -> Any:
        """Import the tool in a worker thread and run it."""
        tool = await anyio.to_thread.run_sync(self.declared, abandon_on_cancel=True)
        return await tool.run(arguments, context, convert_result)

    def checked(self, arguments: dict[str, Any]) -> dict[str, Any]:
        """Validate and convert arguments as given; raises ToolError naming what is wrong."""
        return self.declared().checked(arguments)


def entry_of(tool: WorldTool, module: str) -> dict[str, Any]:
    """Return what the manifest keeps of a tool: all that is listed of it, and where it is declared."""
    listed = tool.model_dump(mode="json", by_alias=True, exclude_none=True, exclude=NOT_LISTED)
    if tool.output_schema is not None:
        listed["output_schema"] = tool.output_schema
    return {**listed, "module": module}
