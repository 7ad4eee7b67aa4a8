"""Lead starts through a whole run: pulses at its collisions take the place of links between stretches."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.edits.removal import MET
from polyworld.estimation.problem import Block
from polyworld.solver.rollout import simulator
from polyworld.world import Effect, World, geometry
from polyworld.world.parameters import object_mass
from polyworld.world.representations.rigid import RigidObject

Array = NDArray[np.float64]
Values = Mapping[str, Array]

BESIDE = "carried_"  # begins the names of the effects on bodies that take no part in the collision


@dataclass(frozen=True)
class Through:
    """World with pulses, and parameters (N,) by path with which its members run through every stretch."""

    world: World
    overrides: dict[str, Array]


def through(world: World, blocks: Sequence[Block], members: Sequence[Values], passes: int) -> Through:
    """Add two pulses for every body at every collision of a run, sized by what the link leaves for every member.

    world: of the first stretch; members: parameters (N,) by path of each stretch, of the same N members; passes: of
    corrections. Together the pulses bring a body, by the end of the second, to the place and velocity that it has there
    in the next stretch.
    """
    joint, begin, frame = dict(members[0]), 0.0, world.time.seconds_per_frame
    count = len(next(iter(joint.values()), np.zeros(1)))
    for number, (block, later) in enumerate(itertools.pairwise(blocks), start=1):
        link = block.link
        assert link is not None
        begin += link.time
        step = frame / np.ceil(frame / world.time.substep - 1e-9)
        length = step * max(2, round(0.5 * frame / step))  # whole steps, over which a pulse is exact
        names = [f"{MET if name in link.who else BESIDE}{number}_{name}" for name in link.place]
        added = [
            Effect(name=effect + "_after" * k, kind="collision_slack", objects=(name,),
                   parameters={"time": world.time.origin + begin + k * length, "duration": length})
            for name, effect in zip(link.place, names, strict=True) for k in range(2)
        ]  # fmt: skip
        world = world.model_copy(update={"effects": (*world.effects, *added)})
        pulses = np.zeros((len(names), 2, 2, count, 3))  # by body, first or second, impulse or turn
        own = simulator(later.world, np.array([2.0 * length]), n_worlds=count).run(members[number])
        for _ in range(passes):
            led = simulator(world, np.array([begin + 2.0 * length]), n_worlds=count).run(joint)
            for i, name in enumerate(link.place):
                item, here, there = world.object(name), led.names.index(name), own.names.index(name)
                apart, faster, spun = (
                    _along(world, f, getattr(own, f)[:, -1, there] - getattr(led, f)[:, -1, here])
                    for f in ("positions", "velocities", "angular_velocities")
                )
                mass = joint.get(f"objects.{name}.mass", np.full(count, object_mass(item)))[:, None]
                first = apart / length - 0.5 * faster  # a pulse acts as at its middle
                pulses[i, 0, 0] += np.nan_to_num(mass * first)
                pulses[i, 1, 0] += np.nan_to_num(mass * (faster - first))
                turned = np.einsum("nij,nj->ni", _inertia(item, led.orientations[:, -1, here]), spun)
                pulses[i, 0, 1] += np.nan_to_num(mass * turned)
            joint |= {
                f"effects.{effect}{'_after' * k}.{key}_{a}": pulses[i, k, f, :, c]
                for i, effect in enumerate(names)
                for k in range(2)
                for f, key in enumerate(("impulse", "turn"))
                for c, a in enumerate("xyz")
            }
    return Through(world, joint)


def _along(world: World, field: str, vectors: Array) -> Array:
    """Return vectors (N, 3) as far as bodies move so: in a planar world along the plane, and turn about its normal."""
    if not world.planar:
        return vectors
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    along: Array = (vectors @ normal)[:, None] * normal
    return along if field == "angular_velocities" else vectors - along


def _inertia(item: RigidObject, orientations: Array) -> Array:
    """Return tensors (N, 3, 3) about world axes, of a kilogram."""
    properties = geometry.mass_properties(item.shape)
    own = properties.inertia / properties.volume
    turns = np.stack([geometry.quaternion_matrix(q) for q in np.nan_to_num(orientations)])
    tensors: Array = turns @ own @ np.swapaxes(turns, 1, 2)
    return tensors
