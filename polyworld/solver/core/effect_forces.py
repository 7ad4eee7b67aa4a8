"""The forces of all enabled effects on one body, whichever laws the catalogue holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.effects import CATALOGUE, KIND_INDEX, EffectLaw, Motion, Vec8
from polyworld.effects.law import wrench
from polyworld.expressions.effect import EXPRESSION_KIND
from polyworld.expressions.interpreter import expression_acceleration

_EXPRESSIONS = int(EXPRESSION_KIND)  # kinds from here on are programs


def _only(law: EffectLaw, index: int) -> Any:
    """Return a Warp function that applies `law` to its own kind; other kinds have no force."""
    force = law.force

    @wp.func
    def apply(kind: int, p: Vec8, b: Motion) -> wp.spatial_vectord:
        if kind == index:
            return force(p, b)
        return wp.spatial_vectord()

    return apply


def _either(first: Any, second: Any, index: int) -> Any:
    """Return a Warp function that applies `first` to kinds below `index`, `second` to the others."""

    @wp.func
    def apply(kind: int, p: Vec8, b: Motion) -> wp.spatial_vectord:
        if kind < index:
            return first(kind, p, b)
        return second(kind, p, b)

    return apply


def _tree(laws: Sequence[EffectLaw]) -> Any:
    """Return a Warp function that finds a kind's law by bisection: laws are many, and this is the innermost loop."""
    if len(laws) == 1:
        return _only(laws[0], KIND_INDEX[laws[0].kind])
    middle = len(laws) // 2
    return _either(_tree(laws[:middle]), _tree(laws[middle:]), KIND_INDEX[laws[middle].kind])


_FORCES = [KIND_INDEX[kind] for kind, law in CATALOGUE.items() if law.force is not None]


def forces_among(kinds: NDArray[np.int32]) -> int:
    """Count how many of some effects, given by their kinds (e,), push bodies; others act at contacts alone."""
    return int((np.isin(kinds, _FORCES) | (kinds >= _EXPRESSIONS)).sum())


# (kind, parameters, motion) -> force [N] and torque [N m], world axes, of one effect; zero for laws without force.
effect_force = _tree([law for law in CATALOGUE.values() if law.force is not None])


@wp.func
def effect_forces(
    kinds: wp.array[wp.int32],
    acts: wp.array2d[wp.int32],
    parameters: wp.array3d[wp.float64],
    programs: wp.array2d[wp.float64],
    world: int,
    body: int,
    b: Motion,
) -> wp.spatial_vectord:
    """Sum over the effects acting on a body: force [N], torque [N m] about the centre of mass, world axes.

    kinds (e,), acts (e, n), parameters (1 or W, e, 8), programs (rows, 4) as in `core.arrays.RigidArrays`.
    """
    total = wp.spatial_vectord()
    row = world % parameters.shape[0]
    for e in range(kinds.shape[0]):
        if acts[e, body] == 1:
            p = Vec8()
            for k in range(8):
                p[k] = parameters[row, e, k]
            if kinds[e] >= _EXPRESSIONS:
                total += wrench(b.mass * expression_acceleration(programs, kinds[e] - _EXPRESSIONS, p, b), wp.vec3d())
            else:
                total += effect_force(kinds[e], p, b)
    return total
