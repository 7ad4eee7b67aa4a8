"""Soft bodies in the coupled solver: what is allocated, and the order of launches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.solver.coupled.needs import Need
from polyworld.solver.coupled.nodes import Clock, Fields, Nodes
from polyworld.solver.soft import damping
from polyworld.solver.soft.bodies import Kind, SliceKind, SolidKind
from polyworld.solver.soft.material import Law
from polyworld.solver.soft.parameters import PARAMETERS, laws
from polyworld.world import World
from polyworld.world.representations.soft import Soft

Array = NDArray[np.float64]


class SoftStage:
    """Elastic, viscous and plastic forces of the soft bodies of W worlds; see `MaterialStage`.

    Plastic flow happens as the forces are computed. Damping too strong for the step is integrated by itself, in
    stages, after the other forces changed the velocities.
    """

    def __init__(self, world: World, items: Sequence[Soft], nodes_first: dict[str, int], n_worlds: int) -> None:
        self._names = tuple(item.name for item in items)
        self._worlds = n_worlds
        kinds: list[Kind] = [SolidKind(world, items, nodes_first), SliceKind(world, items, nodes_first)]
        self._kinds = [kind for kind in kinds if kind.count]
        self._forms = {name: form for kind in kinds for name, form in kind.forms.items()}
        self._damping = _velocities(
            [len(self._forms[n].nodes) for n in self._names], nodes_first, self._names, n_worlds
        )
        self._laws: Any = None
        self._steps: Array = np.full(1, np.inf)
        self._modes: tuple[bool, int, bool] | None = None

    def bind(self, bodies: Any) -> None:
        """Soft bodies meet others through contacts alone."""

    def write(self, fields: Fields) -> bool:
        """See MaterialStage. A yield stress of NaN means that the body never flows."""
        given = [{p: np.atleast_1d(fields[name][p]).astype(float) for p in PARAMETERS} for name in self._names]
        rows = max(len(v) for row in given for v in row.values())
        values = np.zeros((rows, len(self._names)), dtype=Law.numpy_dtype())
        steps = np.zeros((rows, len(self._names)))
        for k, (name, row) in enumerate(zip(self._names, given, strict=True)):
            whole = {p: np.broadcast_to(v, (rows,)) for p, v in row.items()}
            values[:, k], steps[:, k] = laws(self._forms[name], whole)
        self._steps = steps.min(axis=1)
        self._each = steps.min(axis=0)
        stages = values["stages"]
        modes = (
            bool(np.any((values["viscous_shear"] > 0) & (stages == 0))),
            int(stages.max()),
            bool(np.any(values["yield_stress"] >= 0)),
        )
        recapture = modes != self._modes
        self._modes = modes
        if modes[2]:
            for kind in self._kinds:
                recapture |= kind.allow_flow(self._worlds)
        if self._laws is not None and self._laws.shape == values.shape:
            buffers.write(self._laws, values)
            return recapture
        self._laws = buffers.array(values, Law)
        return True

    def reset(self) -> None:
        """Nothing has flowed yet."""
        for kind in self._kinds:
            kind.reset()

    def stable_step(self) -> Array:
        """Longest inner step (1,) or (W,) [s]."""
        return self._steps

    def needs(self) -> list[Need]:
        """See MaterialStage."""
        cure = "with a resolution twice as coarse twice that"
        named = zip(self._names, self._each, strict=True)
        return [Need(float(step), f"soft body {name!r}: sound in its elements", cure) for name, step in named]

    def launch_forces(self, nodes: Nodes, clock: Clock) -> None:
        """Add elastic, plastic and weak viscous forces to nodes.f."""
        weak, stages, flows = self._modes or (False, 0, False)
        if stages:
            self._launch_nodes(damping.keep, [nodes.v])
        for kind in self._kinds:
            dim, given = (self._worlds, kind.count), [clock, nodes, kind.elements, self._laws]
            buffers.launch(kind.elastic_forces, dim, given)
            if flows:
                buffers.launch(kind.plastic_forces, dim, [*given, kind.undo, kind.strain])
            if weak:
                buffers.launch(kind.viscous_forces, dim, [0, *given])

    def launch_velocities(self, nodes: Nodes, clock: Clock) -> None:
        """Integrate strong damping; nodes.f of the bodies that have it is cleared."""
        stages = self._modes[1] if self._modes else 0
        if not stages:
            return
        self._launch_nodes(damping.begin, [clock.dt, nodes.v, nodes.f])
        for stage in range(1, stages + 1):
            for kind in self._kinds:
                given = [stage, clock, nodes, kind.elements, self._laws]
                buffers.launch(kind.viscous_forces, (self._worlds, kind.count), given)
            self._launch_nodes(
                damping.finish_stage, [stage, clock.dt, nodes.inverse_mass, nodes.active, nodes.v, nodes.f]
            )

    def launch_positions(self, nodes: Nodes, clock: Clock) -> None:
        """Nothing: flow happens with the forces."""

    def quantities(self, nodes: Nodes) -> dict[str, dict[str, Array]]:
        """Of each body: von_mises [Pa], strain and (where something flows) plastic_strain of its elements (W, q), the
        latter two as von Mises equivalents, and its volume (W, 1) [m^3]."""
        found: dict[str, dict[str, Array]] = {}
        for kind in self._kinds:
            found.update(kind.quantities(nodes.x, self._laws, flows=self._modes is not None and self._modes[2]))
        return found

    def _launch_nodes(self, kernel: Any, inputs: list[Any]) -> None:
        dim = (self._worlds, self._damping.node.shape[0])
        buffers.launch(kernel, dim, [self._damping, self._laws, *inputs])


def _velocities(counts: list[int], first: dict[str, int], names: tuple[str, ...], worlds: int) -> Any:
    """Rows and columns of all nodes of soft bodies, and what the stages of damping keep of them."""
    v = damping.Velocities()
    rows = [first[name] + np.arange(count) for name, count in zip(names, counts, strict=True)]
    v.node = buffers.array(np.concatenate(rows), wp.int32)
    v.body = buffers.array(np.repeat(np.arange(len(counts)), counts), wp.int32)
    for name in ("start", "change", "last"):
        setattr(v, name, buffers.zeros((worlds, sum(counts)), wp.vec3d))
    return v
