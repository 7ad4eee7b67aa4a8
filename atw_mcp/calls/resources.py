"""Resources that can be read by address: whole results, and the schema of a world."""

from __future__ import annotations

import json
from typing import Any

import anyio
from mcp.server import MCPServer
from mcp.server.mcpserver.exceptions import ResourceError, ResourceNotFoundError
from mcp_types import (
    Completion,
    CompletionArgument,
    CompletionContext,
    PromptReference,
    ResourceTemplateReference,
)

from atw_mcp.calls.app import App
from atw_mcp.calls.schemas import inlined
from evidence_store import StoreError, UnknownRecord

MOST_COMPLETIONS = 100  # the protocol's limit


def register(server: MCPServer[Any], app: App) -> None:
    """Serve `atw://evidence/{id}`, `atw://schema/world`, and completions of case and evidence ids."""

    async def complete(
        reference: PromptReference | ResourceTemplateReference,
        argument: CompletionArgument,
        context: CompletionContext | None,
    ) -> Completion:
        del reference, context
        known: list[str] = []
        if argument.name in ("case", "evidence"):
            known = await anyio.to_thread.run_sync(_ids, app, argument.name)
        fitting = [value for value in known if value.startswith(argument.value)]
        return Completion(
            values=fitting[:MOST_COMPLETIONS], total=len(fitting), has_more=len(fitting) > MOST_COMPLETIONS
        )

    completion: Any = server.completion  # the SDK leaves it untyped
    completion()(complete)

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
        from polyworld.world import World  # the engine

        return json.dumps(inlined(World.model_json_schema()))


def _ids(app: App, kind: str) -> list[str]:
    cases = app.store.cases.all()[::-1]
    if kind == "case":
        return [case.id for case in cases]
    return [record.id for case in cases for record in app.store.evidence.of_case(case.id)[::-1]]
