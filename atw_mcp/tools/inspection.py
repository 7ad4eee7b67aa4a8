"""World inspection: looking at worlds, frames and rollouts, in either stage."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from atw_mcp.app import App
from atw_mcp.results import Answer
from atw_mcp.toolbox import ToolGroup

GROUP = ToolGroup("world inspection")


@GROUP.tool("InspectWorld", title="Inspect a world")
def inspect_world(
    app: App,
    case: Annotated[str, Field(description="case id, as OpenCase returned it")],
    world: Annotated[str | None, Field(description="world id; default: the committed world, else the latest")] = None,
    objects: Annotated[list[str] | None, Field(description="names of objects; default: all", max_length=64)] = None,
) -> Answer:
    """What a world contains: objects with shape, appearance and representation, statics, effects, time base."""
    found_case = app.case(case)
    found = app.world(found_case, world)
    chosen = [item for item in found.objects if objects is None or item.name in objects]
    return Answer(
        summary=f"{found.id} has {len(found.objects)} objects and {len(found.statics)} statics",
        data={"objects": chosen, "statics": list(found.statics), "time": found.time},
        case=found_case.id,
        world=found.id,
        objects=tuple(item.name for item in chosen),
    )
