"""Lead starts through a whole run: pulses at its collisions take the place of links between stretches."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.problem import Block
from polyworld.solver.rollout import simulator
from polyworld.world import Effect, World, geometry
from polyworld.world.parameters import object_mass
from polyworld.world.representations.rigid import RigidObject

Array = NDArray[np.float64]
Values = Mapping[str, Array]

NAME = "slack_"  # begins the names of such effects


@dataclass(frozen=True)
class Through:
    """World with pulses, and parameters (N,) by path with which its members run through every stretch."""

    world: World
    overrides: dict[str, Array]


def through(world: World, blocks: Sequence[Block], members: Sequence[Values]) -> Through:
    """Add two pulses for every body of every collision of a run, sized by what the link leaves for every member.

    world: of the first stretch; members: parameters (N,) by path of each stretch, of the same N members. The first
    pulse brings a body to speed and on its way to the place where the next stretch begins; the second, one duration
    later, stops what was for the place.
    """
    joint, begin, frame = dict(members[0]), 0.0, world.time.seconds_per_frame
    for number, (block, later) in enumerate(itertools.pairwise(blocks), start=1):
        link = block.link
        assert link is not None
        begin += link.time
        step = frame / np.ceil(frame / world.time.substep - 1e-9)
        length = step * max(2, round(0.5 * frame / step))  # whole steps, over which a pulse is exact
        count = len(next(iter(joint.values())))
        end = simulator(world, np.array([begin]), n_worlds=count).run(joint)
        added: list[Effect] = []
        pulses: dict[str, Array] = {}
        for name in link.who:
            item, column = world.object(name), end.names.index(name)
            faster = _missing(later.world, members[number], name, "velocity", end.velocities[:, -1, column])
            apart = _missing(later.world, members[number], name, "position", end.positions[:, -1, column])
            spun = _missing(
                later.world, members[number], name, "angular_velocity", end.angular_velocities[:, -1, column]
            )
            mass = joint.get(f"objects.{name}.mass", np.full(count, object_mass(item)))[:, None]
            stopped = mass / length * (apart + 0.5 * length * faster)
            turned = mass * np.einsum("nij,nj->ni", _inertia(item, end.orientations[:, -1, column]), spun)
            parts = ((mass * faster + stopped, turned), (-stopped, 0.0 * turned))
            for k, (impulse, turn) in enumerate(parts):
                effect = f"{NAME}{number}_{name}" + "_after" * k
                times = {"time": world.time.origin + begin + k * length, "duration": length}
                added.append(Effect(name=effect, kind="collision_slack", parameters=times, objects=(name,)))
                for key, values in (("impulse", impulse), ("turn", turn)):
                    pulses |= {f"effects.{effect}.{key}_{a}": np.nan_to_num(values[:, i]) for i, a in enumerate("xyz")}
        world = world.model_copy(update={"effects": (*world.effects, *added)})
        joint |= pulses
    return Through(world, joint)


def _missing(world: World, values: Values, name: str, field: str, before: Array) -> Array:
    """Return what a field (N, 3) lacks to what a stretch begins with."""
    own = getattr(world.object(name), field)
    paths = [f"objects.{name}.{field}.{a}" for a in "xyz"]
    after = [values.get(path, np.full(len(before), own[i])) for i, path in enumerate(paths)]
    normal = geometry.plane_axes(world.environment.motion_plane)[2] if world.planar else np.zeros(3)
    missing: Array = np.stack(after, axis=1) - before
    if world.planar:
        along = (missing @ normal)[:, None] * normal
        missing = along if field == "angular_velocity" else missing - along
    return missing


def _inertia(item: RigidObject, orientations: Array) -> Array:
    """Return tensors (N, 3, 3) about world axes, of a kilogram."""
    properties = geometry.mass_properties(item.shape)
    own = properties.inertia / properties.volume
    turns = np.stack([geometry.quaternion_matrix(q) for q in np.nan_to_num(orientations)])
    tensors: Array = turns @ own @ np.swapaxes(turns, 1, 2)
    return tensors
