"""Readouts of a deformable object beyond its centre, for an agent: its nodes, and readouts such as a centreline."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from numpy.typing import NDArray
from pydantic import Field

from atw_mcp.calls.flat_unions import flat_schema
from atw_mcp.calls.forms import read_form, tagged
from atw_mcp.calls.intervals import Span
from atw_mcp.calls.results import explained
from polyworld.probing.readouts import (
    Amount,
    Centreline,
    Front,
    GridOccupancy,
    ImageOccupancy,
    Level,
    Markers,
    Outline,
    Stretch,
    Tension,
    check_readable,
    read,
)
from polyworld.trajectory import Rollout, Trajectory
from polyworld.world import World
from polyworld.world.materials import measure_of

Array = NDArray[np.float64]

Readable = Annotated[
    Centreline | Outline | Amount | Front | Level | Tension | Stretch | GridOccupancy | ImageOccupancy | Markers,
    Field(discriminator="kind"),
]
EXAMPLE = {"kind": "centreline", "count": 8}
MOST_NUMBERS = 200_000  # kept of one reading


def readout_schema() -> dict[str, Any]:
    """The schema of a readout without its object, which the tool names anyway."""
    schema = flat_schema(Readable, "kind")
    del schema["properties"]["object"]
    schema["description"] = schema["description"].replace("(object, ", "(").replace("(object)", "")
    return schema


def shape_rows(
    world: World, rollout: Rollout, span: Span, name: str, readout: Any, nodes: list[int] | None, limit: int
) -> dict[str, Any]:
    """Rows (time, frame, entries) of a readout, or of the places of some nodes, over a span; at most MOST_NUMBERS
    numbers, evenly thinned to at least `limit` rows where there are more."""
    deformable = [d.name for d in world.deformables]
    if name not in deformable:
        raise ToolError(
            f"{name!r} is rigid: readout and nodes are for deformable objects; those of this world: {deformable}"
        )
    trajectory = rollout.trajectory
    slack = 1e-6 * span.seconds_per_frame
    inside = np.flatnonzero((trajectory.times >= span.start - slack) & (trajectory.times <= span.end + slack))
    inside = inside[trajectory.active[inside, trajectory.index(name)]]
    if nodes is not None:
        count = trajectory.deformables[name].points.shape[1]
        unknown = [node for node in nodes if node >= count]
        if unknown:
            raise ToolError(f"{name!r} has nodes 0..{count - 1}, not {unknown}")
        about: dict[str, Any] = {"nodes": nodes, "unit": "m", "entries": "x, y, z of each node"}
        width = 3 * len(nodes)
    else:
        what = f"readout of {name!r}"
        form = {**tagged({**_mapping(readout, what), "object": name}, Readable, "kind", what=what, example=EXAMPLE)}
        asked = read_form(form, Readable, "kind", what=what)
        with explained():
            check_readable(asked, world)
        about = {"readout": asked.model_dump(mode="json", exclude_none=True), **_units(world, name, asked)}
        width = 0
    if not len(inside):
        return {**about, "columns": ["time", "frame", "values"], "rows": []}
    if width == 0:
        first = read(asked, world, _picked(trajectory, inside[:1]))
        width = int(first.size)
    most = max(limit, MOST_NUMBERS // max(width, 1))
    chosen = inside
    if len(inside) > most:
        chosen = inside[np.unique(np.rint(np.linspace(0, len(inside) - 1, most)).astype(int))]
        about["thinned"] = f"{len(chosen)} of {len(inside)} samples"
    if nodes is not None:
        values = trajectory.deformables[name].points[chosen][:, nodes]
    else:
        with explained():
            values = read(asked, world, _picked(trajectory, chosen))
    if values.shape[-1] == 1:
        values = values[..., 0]
    if values.ndim == 2 and values.shape[1] == 1:
        values = values[:, 0]
    times = trajectory.times[chosen]
    rows = [[float(t), span.frame(float(t)), v] for t, v in zip(times, values.tolist(), strict=True)]
    return {**about, "columns": ["time", "frame", "values"], "rows": rows}


def _mapping(readout: Any, what: str) -> dict[str, Any]:
    if not isinstance(readout, dict):
        raise ToolError(f"{what} is written as an object, for example {EXAMPLE}; got {readout!r}")
    return readout


def _units(world: World, name: str, readout: Any) -> dict[str, str]:
    if isinstance(readout, Amount):
        return {"unit": measure_of(world.deformable(name))[1], "entries": "one number"}
    if isinstance(readout, Tension):
        return {"unit": "N", "entries": "one number"}
    if isinstance(readout, Front | Level):
        return {"unit": "m", "entries": "one number"}
    if isinstance(readout, Stretch):
        return {"unit": "1", "entries": "principal stretches, largest first"}
    if isinstance(readout, Outline):
        return {"unit": _length(readout), "entries": "how far it reaches along each direction"}
    if isinstance(readout, GridOccupancy | ImageOccupancy):
        return {"unit": "1", "entries": "share of each cell"}
    return {"unit": _length(readout), "entries": "place of each point"}


def _length(readout: Any) -> str:
    return "px" if getattr(readout, "view", "world") == "image" else "m"


def _picked(trajectory: Trajectory, rows: NDArray[np.intp]) -> Trajectory:
    """The same at some of its samples."""
    return Trajectory(
        names=trajectory.names,
        times=trajectory.times[rows],
        positions=trajectory.positions[rows],
        orientations=trajectory.orientations[rows],
        velocities=trajectory.velocities[rows],
        angular_velocities=trajectory.angular_velocities[rows],
        active=trajectory.active[rows],
        deformables={name: motion.select(rows) for name, motion in trajectory.deformables.items()},
    )
