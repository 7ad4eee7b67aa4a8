"""World construction, its end: a world is committed."""

from __future__ import annotations

from typing import Annotated

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from atw_mcp.calls.app import App
from atw_mcp.calls.results import Answer
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.fitting.verdict import cure, verdict_of
from atw_mcp.results.commitment import CommittedWorld
from atw_mcp.tools.world_arguments import CaseId

GROUP = ToolGroup("world construction")


@GROUP.tool("CommitWorld", title="Commit the world", read_only=False, returns=CommittedWorld)
def commit_world(
    app: App,
    case: CaseId,
    world: Annotated[
        str | None, Field(description="id of the world every probe will start from; default: the latest draft")
    ] = None,
    even_if_poor: Annotated[bool, Field(description="commit a world whose fit is poor all the same")] = False,
) -> Answer:
    """Choose the world that probes of this case start from. The case may be modelled further and another world
    committed: each commit is evidence, and an answer names the world it rests on. Next: Ask."""
    found = app.case(case)
    chosen = app.draft(found, world)
    judged = verdict_of(app, chosen.id)
    verdict = "good" if judged is None else judged["verdict"]
    if judged is not None and verdict == "poor" and not even_if_poor:
        raise ToolError(
            f"the fit of {chosen.id} is poor ({judged['why']}). Next: {cure(found.id, chosen.id)}; or CommitWorld with "
            "even_if_poor=true"
        )
    before = found.committed_world
    app.store.cases.commit_world(found.id, chosen.id)
    names = chosen.moving_names
    warning = [] if judged is None or verdict == "good" else [f"the fit is {verdict}: {judged['why']}"]
    return Answer(
        summary=f"committed {chosen.id}: probes start from it"
        + (f" instead of {before}" if before not in (None, chosen.id) else "")
        + "".join(f". WARNING: {text}" for text in warning),
        data={
            "world": chosen.id,
            "objects": list(names),
            "warnings": warning,
            "next": f"Ask(case={found.id!r})",
        },
        case=found.id,
        world=chosen.id,
        observation=app.store.cases.modelled_observation(found.id, chosen.id),
        objects=names,
    )
