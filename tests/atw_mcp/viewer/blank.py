"""Documents of the page in which nothing is but what is given: worlds of balls, their rollouts, a case."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.viewer import document as view
from atw_mcp.viewer import parts, world_parts
from atw_mcp.viewer.packing import Blocks

NOTHING: tuple[str, ...] = ("comparisons", "evidence", "fits", "gaps", "missing", "running", "tracks")


def ball_world(
    identifier: str, names: Sequence[str], colors: Sequence[str], radius: float, *, mass: float = 1.0, **given: Any
) -> world_parts.WorldView:
    """A world of balls, radius [m], mass [kg], and nothing else."""
    moving = [
        world_parts.Moving(name=name, kind="rigid", color=color, mass=mass, shape=parts.Sphere(radius=radius),
                           radius=None, segments=None, triangles=None, start_time=0)
        for name, color in zip(names, colors, strict=False)
    ]  # fmt: skip
    fields = {"id": identifier, "label": identifier, "origin": "given", "parent": None, "committed": False,
              "planar": False, "gravity": [0, 0, -9.81], "camera": None, "moving": moving, "statics": [],
              "joints": [], "regions": [], "effects": [], "floor": None, "parameters": []}  # fmt: skip
    return world_parts.WorldView(**(fields | given))


def ball_rollout(
    identifier: str,
    names: list[str],
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    blocks: Blocks,
    **given: Any,
) -> view.RolloutView:
    """A rollout of balls at places (T, n, 3) [m] that do not turn."""
    turns = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*places.shape[:2], 4))
    fields = {"id": identifier, "label": identifier, "base": None, "edits": [], "status": "completed",
              "why_ended": None, "horizon": float(times[-1]), "names": names, "times": blocks.floats(times),
              "positions": blocks.floats(places), "orientations": blocks.floats(turns),
              "velocities": blocks.floats(np.gradient(places, times, axis=0)),
              "spins": blocks.floats(np.zeros_like(places)),
              "active": blocks.raw(np.ones(places.shape[:2], np.uint8)), "deformed": [], "quantities": [],
              "events": [], "pushes": [], "misfits": [], "sampled": ""}  # fmt: skip
    return view.RolloutView(**(fields | given))


def document(case: str, *, about: dict[str, Any] | None = None, **given: Any) -> view.ViewDocument:
    """A case without a film. about: fields of the case."""
    known = {"id": case, "kind": "none", "file": "", "questions": [], "answers": [], "bindings": []}
    nodes = view.Provenance(nodes=[], edges=[])
    fields = {"made_by": "a test", "film": None, "observed": None, "provenance": nodes, **{k: [] for k in NOTHING}}
    return view.ViewDocument(case=view.CaseView(**(known | {"committed_world": None} | (about or {}))),
                             **(fields | given))  # fmt: skip
