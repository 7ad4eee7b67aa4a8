"""What can be read by address: whole results, and the schema of a world."""

from __future__ import annotations

import json
from typing import Any

from mcp.server import MCPServer
from mcp.server.mcpserver.exceptions import ResourceError, ResourceNotFoundError

from atw_mcp.app import App
from atw_mcp.schemas import inlined
from evidence_store import StoreError, UnknownRecord
from polyworld.world import World


def register(server: MCPServer[Any], app: App) -> None:
    """Serve `atw://evidence/{id}` and `atw://schema/world`."""

    @server.resource(
        "atw://evidence/{evidence}",
        title="A whole result",
        description="everything a tool returned, at full length and precision",
        mime_type="application/json",
    )
    def evidence_resource(evidence: str) -> str:
        try:
            record = app.store.read_evidence(evidence)
        except UnknownRecord as error:
            raise ResourceNotFoundError(str(error)) from error
        except StoreError as error:
            raise ResourceError(str(error)) from error
        body = {
            "evidence": record.id,
            "tool": record.tool,
            "arguments": record.arguments,
            "status": record.status,
            "summary": record.summary,
            "case": record.case,
            "source": {"world": record.world, "rollout": record.rollout, "observation": record.observation},
            "objects": list(record.objects),
            "interval": record.interval,
            "data": record.payload.get("data", {}),
            "pictures": sorted(record.pictures),
        }
        return json.dumps(body, ensure_ascii=False, allow_nan=False)

    @server.resource(
        "atw://schema/world",
        title="Schema of a world",
        description="JSON schema of the world that BuildWorld takes as a whole",
        mime_type="application/schema+json",
    )
    def world_schema() -> str:
        return json.dumps(inlined(World.model_json_schema()))
