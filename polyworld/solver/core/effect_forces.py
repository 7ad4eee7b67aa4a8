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
from polyworld.solver.core.effect_table import Effects, effect_values

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
def effect_forces(effects: Effects, world: int, body: int, b: Motion) -> wp.spatial_vectord:
    """Sum over the effects acting on a body: force [N], torque [N m] about the centre of mass, world axes."""
    total = wp.spatial_vectord()
    for e in range(effects.kind.shape[0]):
        if effects.acts[e, body] == 1:
            kind = effects.kind[e]
            p = effect_values(effects, world, e)
            if kind >= _EXPRESSIONS:
                acceleration = expression_acceleration(effects.programs, kind - _EXPRESSIONS, p, b)
                total += wrench(b.mass * acceleration, wp.vec3d())
            else:
                total += effect_force(kind, p, b)
    return total


@wp.func
def half_step(x: Any, v: Any, a: Any, half: wp.float64) -> Any:
    """Return position and velocity after half a step of constant acceleration: where effects are taken.

    The midpoint rule, second order in the step.
    """
    middle = v + a * half
    return x + (v + middle) * (wp.float64(0.5) * half), middle
