"""Execution control: tools about tools, evidence, names and the end."""

from __future__ import annotations

from typing import Annotated

from mcp.server.mcpserver.exceptions import ToolError
from mcp_types import CallToolResult
from pydantic import Field

from atw_mcp.app import App
from atw_mcp.toolbox import ToolGroup
from evidence_store import UnknownRecord

GROUP = ToolGroup("execution control")


@GROUP.tool("ReadEvidence", title="Read evidence again")
def read_evidence(
    app: App,
    evidence: Annotated[str, Field(description="evidence id, e.g. ev-12")],
    cancel: Annotated[bool, Field(description="stop the work if it is still running")] = False,
) -> CallToolResult:
    """Return an earlier result again without running anything, or see how far running work is, or cancel it."""
    try:
        record = app.store.read_evidence(evidence)
    except UnknownRecord as error:
        raise ToolError(f"{error}. Every result names its own id in the field evidence") from error
    if cancel and record.status == "running":
        app.jobs.cancel(evidence)
    return app.evidence_result(evidence)
