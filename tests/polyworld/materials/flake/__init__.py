"""A made-up material, in a package of its own: three masses at the corners of a triangle, joined by springs.

Its breathing mode has the angular frequency sqrt(3 k / m): each mass is pulled by two springs, each lengthened by
sqrt(3) of the change of the circumradius, at 30 degrees to the radius.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import warp as wp
from numpy.typing import NDArray
from pydantic import Field

from polyworld.core import buffers
from polyworld.model import DeformableMesh
from polyworld.solver.coupled.nodes import Clock, Fields, Nodes, parameter_row
from polyworld.world import World
from polyworld.world.description import ORIGIN, Appearance, Description, Name, Positive, Vec3
from polyworld.world.materials import Material, Place
from polyworld.world.parameter_tables import ParameterSpec


class Flake(Description):
    """Three equal masses joined by springs, which starts larger than it is at rest by `stretch`."""

    name: Name
    representation: Literal["flake"] = "flake"
    position: Vec3 = Field(description="centre at the start [m]")
    circumradius: Positive = Field(description="distance of the masses from the centre at rest [m]")
    stretch: float = Field(default=0.0, description="relative excess of the initial circumradius [1]")
    mass: Positive = Field(default=0.1, description="of each corner [kg]")
    stiffness: Positive = Field(default=100.0, description="of each spring [N/m]")
    velocity: Vec3 = ORIGIN
    appearance: Appearance = Appearance()


def mesh(_world: World, item: Flake) -> DeformableMesh:
    angles = np.array([0.0, 2.0, 4.0]) * np.pi / 3.0
    corners = np.stack([np.cos(angles), np.zeros(3), np.sin(angles)], axis=1)
    return DeformableMesh(
        nodes=np.asarray(item.position) + item.circumradius * (1.0 + item.stretch) * corners,
        measure=np.ones(3),
        radius=np.zeros(3),
        triangles=np.array([[0, 1, 2]], dtype=np.int32),
    )


@wp.kernel(enable_backward=False)
def pull(
    first: wp.array[wp.int32],
    rest: wp.array[wp.float64],
    stiffness: wp.array2d[wp.float64],
    x: wp.array2d[wp.vec3d],
    f: wp.array2d[wp.vec3d],
):
    w, flake = wp.tid()
    k = stiffness[w % stiffness.shape[0], flake]
    for i in range(3):
        a, b = first[flake] + i, first[flake] + (i + 1) % 3
        line = x[w, b] - x[w, a]
        force = k * (wp.length(line) - rest[flake]) * wp.normalize(line)
        f[w, a] = f[w, a] + force
        f[w, b] = f[w, b] - force


class Stage:
    """Springs between the corners; explicit, at a hundredth of the breathing period."""

    def __init__(self, _world: World, items: Sequence[Flake], first: dict[str, int], n_worlds: int) -> None:
        self._items, self._n_worlds = items, n_worlds
        self._first = buffers.ints([first[item.name] for item in items])
        self._rest = buffers.doubles([np.sqrt(3.0) * item.circumradius for item in items])
        self._stiffness: Any = None
        self._step: NDArray[np.float64] = np.ones(1)

    def bind(self, bodies: Any) -> None:
        pass

    def write(self, fields: Fields) -> bool:
        names = tuple(item.name for item in self._items)
        self._stiffness = parameter_row(fields, names, "stiffness")
        highest = max(float(np.max(fields[n]["stiffness"]) / np.min(fields[n]["mass"])) for n in names)
        self._step = np.array([0.02 * np.pi / np.sqrt(3.0 * highest)])
        return True

    def reset(self) -> None:
        pass

    def stable_step(self) -> NDArray[np.float64]:
        return self._step

    def launch_forces(self, nodes: Nodes, clock: Clock) -> None:
        del clock
        inputs = [self._first, self._rest, self._stiffness, nodes.x, nodes.f]
        buffers.launch(pull, (self._n_worlds, len(self._items)), inputs)

    def launch_velocities(self, nodes: Nodes, clock: Clock) -> None:
        pass

    def launch_positions(self, nodes: Nodes, clock: Clock) -> None:
        pass

    def quantities(self, nodes: Nodes) -> dict[str, dict[str, NDArray[np.float64]]]:
        """Lengths of the springs [m]."""
        x = nodes.x.numpy()
        corners = [x[:, k : k + 3] for k in self._first.numpy()]
        return {
            item.name: {"spring_length": np.linalg.norm(c - np.roll(c, -1, axis=1), axis=2)}
            for item, c in zip(self._items, corners, strict=True)
        }


def moved(item: dict[str, Any], place: Place, _turn: Any) -> None:
    item["position"] = place(item["position"])


MATERIAL = Material(
    kind="flake",
    description=Flake,
    form="sheet",
    density="mass",
    parameters={
        "mass": ParameterSpec("kg", 1e-3, 1e3, (0.01, 1.0), "mass of a corner"),
        "stiffness": ParameterSpec("N/m", 1e-3, 1e6, (10.0, 1e3), "stiffness of a spring"),
    },
    fitted=("stiffness",),
    mesh=mesh,
    stage=Stage,
    moved=moved,
    facts=lambda _world, item, _mesh: {"springs": 3, "stiffness": item.stiffness},
    planar=False,
)
