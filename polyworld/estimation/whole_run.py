"""Lead one start through a whole run: pulses at its collisions take the place of links between stretches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.fit_settings import LinkSettings
from polyworld.estimation.problem import Block
from polyworld.estimation.starts import free_axes
from polyworld.estimation.unknown import Unknown
from polyworld.solver.rollout import simulator
from polyworld.world import Effect, World, geometry
from polyworld.world.parameters import object_mass

Array = NDArray[np.float64]

NAME = "slack_"  # begins the names of such effects
FARTHEST = 100.0  # standard deviations that bound a pulse


@dataclass(frozen=True)
class Slack:
    """World with pulses that do nothing yet, and the unknowns that they are, which start where stretches have them."""

    world: World
    unknowns: tuple[Unknown, ...]


def with_slack(
    world: World, blocks: Sequence[Block], shared: Array, states: Sequence[Array], settings: LinkSettings
) -> Slack:
    """Add a pulse for every body of every collision of a run, sized by what its link leaves at shared (S,) and states.

    Its prior is that of the link: a share of the change of velocity.
    """
    effects, unknowns, begin = list(world.effects), [], 0.0
    for number, (block, later) in enumerate(zip(blocks[:-1], blocks[1:], strict=True), start=1):
        link = block.link
        assert link is not None
        begin += link.time
        end = simulator(block.world, np.array([link.time])).run(block.overrides(shared[None], states[number - 1][None]))
        starts = later.overrides(shared[None], states[number][None])
        for name in link.who:
            column = end.names.index(name)
            speeds = _change(later.world, starts, name, "velocity", end.velocities[0, -1, column])
            spins = _change(later.world, starts, name, "angular_velocity", end.angular_velocities[0, -1, column])
            item = world.object(name)
            mass = object_mass(item)
            inertia = mass * float(np.trace(geometry.mass_properties(item.shape).inertia)) / 3.0
            inertia /= geometry.mass_properties(item.shape).volume
            effect = f"{NAME}{number}_{name}"
            times = {
                "time": world.time.origin + begin,
                "duration": max(world.time.seconds_per_frame, 2.0 * world.time.substep),
            }
            effects.append(Effect(name=effect, kind="collision_slack", parameters=times, objects=(name,)))
            sd = mass * link.velocity[name]
            unknowns += [
                _unknown(effect, f"impulse_{a}", mass * speeds["xyz".index(a)], sd, "N s") for a in free_axes(world)
            ]
            normal = geometry.plane_axes(world.environment.motion_plane)[2]
            about = "xyz"[int(np.argmax(np.abs(normal)))] if world.planar else "xyz"
            sd = inertia * max(settings.spin, 0.5 * float(np.linalg.norm(spins)))
            unknowns += [_unknown(effect, f"turn_{a}", inertia * spins["xyz".index(a)], sd, "N m s") for a in about]
    return Slack(world.model_copy(update={"effects": tuple(effects)}), tuple(unknowns))


def _change(world: World, starts: dict[str, Array], name: str, field: str, before: Array) -> Array:
    item = world.object(name)
    paths = [f"objects.{name}.{field}.{a}" for a in "xyz"]
    after = [float(starts[p][0]) if p in starts else float(getattr(item, field)[i]) for i, p in enumerate(paths)]
    change: Array = np.array(after) - before
    return change


def _unknown(effect: str, key: str, start: float, sd: float, unit: str) -> Unknown:
    limit = FARTHEST * sd
    start = float(np.clip(start, -limit, limit))
    return Unknown(f"{effect}.{key}", (f"effects.{effect}.{key}",), unit, start, -limit, limit, sd, prior=(0.0, sd))


def held(shared: Sequence[Unknown], at: Array, spread: Array) -> list[Unknown]:
    """Return constants with priors (S,) about what the stretches say, so that collisions cannot bend them."""
    return [
        replace(u, prior=(float(x), max(float(sd), 1e-6)), start=float(np.exp(x)) if u.scale == "log" else float(x))
        for u, x, sd in zip(shared, at, spread, strict=True)
    ]
