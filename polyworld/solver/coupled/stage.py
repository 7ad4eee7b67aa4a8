"""Interface of a material to the coupled solver."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from polyworld.solver.coupled.mechanism import Mechanisms
from polyworld.solver.coupled.needs import Need
from polyworld.solver.coupled.nodes import Clock, Fields, Nodes

Array = NDArray[np.float64]


class MaterialStage(Protocol):
    """Elastic forces of all objects of one material. Arrays are allocated once, so that captured graphs stay valid.

    A new set of parameters is written in place (`write`); a shape change of a parameter array (shared to per-world)
    is the only reason to reallocate it; `write` then returns True, so that the graph is captured again.
    """

    def bind(self, bodies: Any) -> None:
        """Take the Warp array (W, n + s) of `polyworld.solver.spatial.layout.Body`; not called where there is none."""
        ...

    def write(self, fields: Fields) -> bool:
        """Write values, object name -> parameter -> (1,) or (W,); return True where arrays were reallocated."""
        ...

    def reset(self) -> None:
        """Back to the initial state: twist, plastic strain, wheel angles, and whatever else the stage keeps."""
        ...

    def stable_step(self) -> Array:
        """Longest inner step (1,) or (W,) for which the explicit forces are stable and accurate [s]."""
        ...

    def needs(self) -> list[Need]:
        """What each object needs of the inner step at the start, in the world that needs most."""
        ...

    def launch_forces(self, nodes: Nodes, clock: Clock) -> None:
        """Launch kernels that add forces at the current x and v to nodes.f."""
        ...

    def launch_velocities(self, nodes: Nodes, clock: Clock) -> None:
        """Launch kernels that change nodes.v after the forces did: implicit parts. May do nothing."""
        ...

    def launch_positions(self, nodes: Nodes, clock: Clock) -> None:
        """Launch kernels that follow the change of nodes.x: twist, plastic flow. May do nothing."""
        ...

    def quantities(self, nodes: Nodes) -> dict[str, dict[str, Array]]:
        """Object name -> readable quantity (`tension`, `strain`, ...) -> values (W, m) at this moment, SI."""
        ...


@runtime_checkable
class HeldByBodies(Protocol):
    """A stage that pushes rigid bodies by itself."""

    def bind_mechanisms(self, mechanisms: Mechanisms) -> None:
        """Take how jointed bodies yield, together with `MaterialStage.bind`."""
        ...


@runtime_checkable
class Paced(Protocol):
    """A stage whose need of inner steps depends on the state."""

    def launch_begin(self, nodes: Nodes, clock: Clock) -> None:
        """Launch kernels that may raise clock.inner_steps for the coupling step that begins."""
        ...
