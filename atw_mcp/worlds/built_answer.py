"""Answer to BuildWorld: a draft, where its bodies begin, and what was assumed."""

from __future__ import annotations

from typing import Any

from atw_mcp.calls.results import Answer
from atw_mcp.cases.material_facts import about_deformable
from atw_mcp.worlds.building import Built
from evidence_store import Case
from polyworld.world import World


def place_in_words(motion: str) -> str:
    """Say on which surface, or how else, a body moves."""
    return {"flight": "in free flight", "unexplained": "not placed"}.get(motion, f"on {motion}")


def built_answer(case: Case, built: Built, observation: str | None, notes: list[str]) -> Answer:
    """Return the answer to BuildWorld about a world of what was observed. notes: assumed beside what it says itself."""
    made = built.world
    names = made.moving_names
    assumed = [*built.assumed, *notes]
    return Answer(
        summary=f"draft world {made.id}: {len(names)} objects, {built.representation} ({built.why})",
        data={
            "world": made.id,
            "representation": built.representation,
            "why": built.why,
            **({"alternative_representation": built.alternative} if built.alternative else {}),
            "objects": [
                {
                    "name": item.name,
                    "shape": item.shape,
                    "color": item.appearance.color,
                    "start_frame": round(item.start_time / made.time.seconds_per_frame),
                    "position": item.position,
                    "velocity": item.velocity,
                }
                for item in made.objects
            ],
            **described_parts(made),
            "statics": [static.name for static in made.statics],
            "seconds_per_frame": made.time.seconds_per_frame,
            "camera": made.camera is not None,
            "assumed": assumed,
            "left_out": list(built.left_out),
            "next": f"FitWorld(case={case.id!r}, world={made.id!r})"
            if observation is not None
            else f"InspectRollout(case={case.id!r}, world={made.id!r}), then CommitWorld",
        },
        case=case.id,
        world=made.id,
        observation=observation,
        objects=names,
    )


def described_parts(world: World) -> dict[str, Any]:
    """Describe deformable objects and what connects things, in short, where there are any."""
    described: dict[str, Any] = {}
    if world.deformables:
        described["deformables"] = [about_deformable(world, item) for item in world.deformables]
        described["substep"] = world.time.substep
    for part in ("joints", "attachments", "pulleys", "emitters", "drains", "containers"):
        names = [item.name for item in getattr(world, part)]
        if names:
            described[part] = names
    return described
