"""Effects as the page shows them: what they do to each object over time, and their fields in space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from atw_mcp.viewer import document as view
from atw_mcp.viewer import world_parts
from atw_mcp.viewer.packing import Blocks
from polyworld.effects import ABSENCES
from polyworld.expressions.effect import law_of
from polyworld.probing.effect_accelerations import effect_accelerations
from polyworld.solver.core.effect_evaluation import Bodies, accelerations_of, enabled, frictions_of, has_force
from polyworld.trajectory import Rollout, Trajectory
from polyworld.world import Effect, World, geometry
from polyworld.world.parameters import object_mass

Array = NDArray[np.float64]

ARROWS = 250  # of a field: as many as do not hide what is between them
MARGIN = 0.15  # of the longest edge, around what the objects reach
FLAT = 1e-9  # share of the largest by which the vectors of a uniform field differ


def effect_marks(world: World, runs: Sequence[Trajectory], blocks: Blocks) -> list[world_parts.EffectMark]:
    """Return the effects of a world; runs: its rollouts, whose objects say where a field is of interest."""
    fields = _fields(world, runs, blocks)
    return [
        world_parts.EffectMark(
            name=effect.name,
            kind=effect.kind,
            title=standard_name(effect),
            law=law_of(effect).summary,
            enabled=effect.enabled,
            objects=None if effect.objects is None else list(effect.objects),
            parameters=[
                world_parts.Value(name=name, value=effect.parameters.get(name, spec.default), unit=spec.unit)
                for name, spec in law_of(effect).parameters.items()
            ],
            field=fields.get(effect.name),
        )
        for effect in world.effects
    ]


def standard_name(effect: Effect) -> str:
    """Return the name under which the gap workflow proposes an effect; empty where that is its kind."""
    return ABSENCES[effect.kind].effect if effect.kind in ABSENCES else ""


def pushes_view(world: World, result: Rollout, blocks: Blocks) -> list[view.EffectPush]:
    """Return the acceleration that each enabled effect with a force gives each object of a rollout."""
    effects = enabled(world)
    if not any(has_force(effect) for effect in effects):
        return []
    found = effect_accelerations(world, result)
    return [
        view.EffectPush(effect=effect.name, accelerations=blocks.floats(push))
        for effect, push in zip(effects, found, strict=True)
        if has_force(effect)
    ]


def without_push(world: World) -> list[str]:
    """Return sentences about enabled effects of which no acceleration can be shown."""
    return [
        f"Of effect {effect.name} ({effect.kind}) no acceleration is shown: it changes what happens at contacts."
        for effect in enabled(world)
        if not has_force(effect)
    ]


def _fields(world: World, runs: Sequence[Trajectory], blocks: Blocks) -> dict[str, world_parts.Field3]:
    """Return, by name, the fields of the enabled effects that push a body at rest, or that change friction."""
    effects = enabled(world)
    points = _grid(world, runs) if effects else np.zeros((0, 3))
    fields: dict[str, world_parts.Field3] = {}
    for k, effect in enumerate(effects):
        if not len(points) or not any(effect.objects is None or n in effect.objects for n in world.moving_names):
            continue
        if has_force(effect):
            body = _probe(world, effect, points)
            vectors, unit = accelerations_of(world, body[1])[k], "m/s^2"
            what = f"acceleration of {body[0]} at rest"
        elif law_of(effect).friction is not None:
            coefficient = max((o.friction for o in world.objects), default=0.0)
            change = frictions_of(world, points, coefficient)[k] - coefficient
            vectors, unit = change[:, None] * geometry.plane_axes(world.environment.motion_plane)[2], "1"
            what = "change of the friction coefficient, along the normal of the floor"
        else:
            continue
        largest = float(np.abs(vectors).max(initial=0.0))
        if largest > 0.0:
            uniform = float(np.ptp(vectors, axis=0).max()) <= FLAT * largest
            fields[effect.name] = world_parts.Field3(
                points=blocks.floats(points), vectors=blocks.floats(vectors), unit=unit, what=what, uniform=uniform
            )
    return fields


def _probe(world: World, effect: Effect, points: Array) -> tuple[str, Bodies]:
    """Return a body that the effect acts on, at rest at each point, and its name."""
    name = next(n for n in world.moving_names if effect.objects is None or n in effect.objects)
    rigid = world.object(name) if world.is_rigid(name) else None
    count = len(points)
    return name, Bodies(
        mass=np.full(count, 1.0 if rigid is None else object_mass(rigid)),
        radius=np.full(count, 0.0 if rigid is None else geometry.equivalent_radius(rigid.shape)),
        positions=points,
        velocities=np.zeros((count, 3)),
        spins=np.zeros((count, 3)),
        times=np.full(count, world.time.origin),
        contact=np.ones(count),
    )


def _grid(world: World, runs: Sequence[Trajectory]) -> Array:
    """Points (k, 3) of a coarse grid over all that the objects of a world reach; of planar worlds one layer. None where
    nothing has a place yet."""
    places = [np.array([o.position for o in world.objects], dtype=float).reshape(-1, 3)]
    places += [run.positions.reshape(-1, 3) for run in runs]
    places += [motion.points.reshape(-1, 3) for run in runs for motion in run.deformables.values()]
    whole: Array = np.concatenate(places)
    known: Array = whole[np.isfinite(whole).all(axis=1)]
    if not len(known):
        return known
    axes = geometry.plane_axes(world.environment.motion_plane) if world.planar else np.eye(3)
    own = known @ axes.T
    lower, upper = own.min(axis=0), own.max(axis=0)
    margin = MARGIN * max(float((upper - lower).max()), 1e-3)
    sides = slice(0, 2) if world.planar else slice(0, 3)
    extent = (upper - lower)[sides] + 2.0 * margin
    step = float(np.prod(extent) / ARROWS) ** (1.0 / len(extent))
    counts = np.maximum(2, np.round(extent / step).astype(int) + 1)
    lines = [np.linspace(a - margin, b + margin, n) for a, b, n in zip(lower, upper, counts, strict=False)]
    if world.planar:
        lines.append(np.array([0.5 * (lower[2] + upper[2])]))
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    found: Array = grid @ axes
    return found
