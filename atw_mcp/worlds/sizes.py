"""Sizes of a world, predicted from its description and held against the limits before anything is meshed or run."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from atw_mcp.calls.limits import Limits
from atw_mcp.worlds.parts import Parts, read_part
from polyworld.edits.interventions import Add, Intervention
from polyworld.model.soft import edge_length, predicted_elements
from polyworld.solver.fluid.scene import thin_axis
from polyworld.solver.fluid.seeding import predicted_particles
from polyworld.solver.work import emitted
from polyworld.world import World
from polyworld.world.materials import PLANAR, material_of
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.representations.rope import Rope
from polyworld.world.representations.soft import Soft

STAND_INS: dict[str, dict[str, Any]] = {"soft": {"position": (0, 0, 0)}, "rope": {"points": ((0, 0, 0), (1, 0, 0))}}
SOFT = "soft"
BACKGROUND = 2_000  # elements of soft bodies, divided in about a second; more are divided as long work


@dataclass(frozen=True)
class Size:
    """Predicted number of something: `count` of what the limit of that name counts; cure: what makes it smaller."""

    limit: str
    count: float
    what: str
    cure: str


def check_sizes(world: World, limits: Limits, horizon: float = 0.0) -> None:
    """Raise ValueError, naming the predicted number, the limit and an acceptable value, where a world is too large.

    horizon [s]: time until which emitters add particles.
    """
    totals: dict[str, float] = {}
    for size in sizes(world, limits, horizon):
        most = getattr(limits, size.limit)
        totals[size.limit] = totals.get(size.limit, 0.0) + size.count
        if totals[size.limit] > most:
            share = "" if totals[size.limit] == size.count else f" ({totals[size.limit]:.3g} with those before it)"
            raise ValueError(
                f"{size.what} would have about {size.count:.3g} {size.limit}{share}, more than the limit of {most:,} "
                f"of this server: {size.cure}"
            )


def check_additions(world: World, edits: Sequence[Intervention], limits: Limits) -> None:
    """Raise ValueError where a world would be too large with what edits add to it, before it is added."""
    added = [edit for edit in edits if isinstance(edit, Add)]
    grids = [edit.fluid_grid for edit in added if edit.fluid_grid is not None]
    more = {
        "deformables": (*world.deformables, *(edit.deformable for edit in added if edit.deformable is not None)),
        "fluid_grid": grids[-1] if grids else world.fluid_grid,
    }
    check_sizes(world.model_copy(update=more), limits)


def described(parts: Parts) -> tuple[Any, ...]:
    """Return the deformables as described, where what may have been observed is missing with a stand-in for it.

    Stand-ins do not change the size. Raises ToolError for a description that is wrong.
    """
    made = []
    for item in parts.deformables:
        kind = str(item["representation"]).removesuffix(PLANAR)
        fields = {**STAND_INS.get(kind, {}), **{key: value for key, value in item.items() if key != "representation"}}
        made.append(read_part(kind, fields))
    return tuple(made)


def check_described(items: Sequence[Any], limits: Limits, planar: bool) -> None:
    """Raise ValueError where deformables other than fluids, alone, exceed the limits.

    planar: whether soft bodies may turn out to be slices, which have fewer elements.
    """
    solid = tuple(item for item in items if material_of(item).form != "liquid")
    flat = {"representation": f"{SOFT}{PLANAR}"}
    least = tuple(item.model_copy(update=flat) if planar and _is_soft(item) else item for item in solid)
    try:
        check_sizes(World.model_construct(deformables=least), limits)
    except ValueError:  # then in space, too, where what is acceptable is so in the plane as well
        check_sizes(World.model_construct(deformables=solid), limits)
        raise


def takes_long(items: Sequence[Any]) -> bool:
    """Whether dividing the soft bodies among deformables takes more than a second or so."""
    return sum(predicted_elements(item) for item in items if _is_soft(item)) > BACKGROUND


def sizes(world: World, limits: Limits, horizon: float) -> list[Size]:
    """Return what of a world has a size that a few numbers of its description decide."""
    found = []
    for item in world.deformables:
        predict = _PREDICTED.get(material_of(item).kind)
        if predict is not None:
            found.append(predict(item, limits))
    return found + _fluids(world, limits, horizon)


def _is_soft(item: Any) -> bool:
    return material_of(item).kind == SOFT


def _rope(item: Rope, limits: Limits) -> Size:
    cure = f"give fewer segments: {limits.segments:,} in all ropes"
    return Size("segments", float(item.segments), f"rope {item.name!r}", cure)


def _soft(item: Soft, limits: Limits) -> Size:
    count, edge = predicted_elements(item), edge_length(item)
    power = 2 if item.representation.endswith(PLANAR) else 3
    fits = edge * (count / limits.elements) ** (1.0 / power)
    cure = f"with elements of {edge:.3g} m; resolution={_up(fits)} or more would be accepted"
    return Size("elements", count, f"soft body {item.name!r}", cure)


def _cloth(item: Cloth, limits: Limits) -> Size:
    geometry = item.geometry
    if isinstance(geometry, Sheet):
        across, along = geometry.divisions
        count = 2.0 * across * along
        scale = (limits.triangles / count) ** 0.5
        cure = f"divisions=[{max(1, int(across * scale))}, {max(1, int(along * scale))}] would be accepted"
    else:
        count = float(len(geometry.faces))
        cure = f"give a mesh of at most {limits.triangles:,} faces"
    return Size("triangles", count, f"cloth {item.name!r}", cure)


def _fluids(world: World, limits: Limits, horizon: float) -> list[Size]:
    box = world.fluid_grid
    fluids = world.of_form("liquid")
    if box is None or not fluids:
        return []
    thin = thin_axis(world)
    power = 3 if thin < 0 else 2
    cells = math.prod((box.upper[axis] - box.lower[axis]) / box.cell for axis in range(3) if axis != thin)
    fits = box.cell * (cells / limits.cells) ** (1.0 / power)
    found = [Size("cells", cells, "fluid_grid", f"cell={_up(fits)} or more would be accepted")]
    volume = (box.cell / 2.0) ** power
    for item in fluids:
        count = predicted_particles(world, item)
        fits = box.cell * (count / limits.particles) ** (1.0 / power)
        cure = f"cell={_up(fits)} or more of fluid_grid would be accepted"
        found.append(Size("particles", count, f"fluid {item.name!r}", cure))
    for emitter in world.emitters:
        count = emitted(emitter, horizon) / volume
        cure = f"from its rate within {horizon:.4g} s; give a lower rate, an end, a shorter horizon or larger cells"
        found.append(Size("particles", count, f"emitter {emitter.name!r}", cure))
    return found


_PREDICTED: dict[str, Callable[[Any, Limits], Size]] = {SOFT: _soft, "cloth": _cloth, "rope": _rope}
"""By material; the sizes of others, which are registered, are not known beforehand."""


def _up(value: float) -> str:
    """Two digits, not below the value."""
    return f"{value * 1.05:.2g}"
