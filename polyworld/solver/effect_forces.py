"""All enabled effects on one body, whichever laws the catalogue holds."""

from __future__ import annotations

from functools import reduce
from typing import Any

import warp as wp

from polyworld.effects import CATALOGUE, KIND_INDEX, EffectLaw, Vec8


def _only(law: EffectLaw, index: int) -> Any:
    """A Warp function that applies `law` to its own kind; other kinds have no force."""
    force = law.force

    @wp.func
    def apply(
        kind: int,
        p: Vec8,
        mass: wp.float64,
        radius: wp.float64,
        x: wp.vec3d,
        v: wp.vec3d,
        omega: wp.vec3d,
        t: wp.float64,
    ) -> wp.spatial_vectord:
        if kind == index:
            return force(p, mass, radius, x, v, omega, t)
        return wp.spatial_vectord()

    return apply


def _either(first: Any, second: Any) -> Any:
    """A Warp function that applies whichever of two functions knows the kind."""

    @wp.func
    def apply(
        kind: int,
        p: Vec8,
        mass: wp.float64,
        radius: wp.float64,
        x: wp.vec3d,
        v: wp.vec3d,
        omega: wp.vec3d,
        t: wp.float64,
    ) -> wp.spatial_vectord:
        return first(kind, p, mass, radius, x, v, omega, t) + second(kind, p, mass, radius, x, v, omega, t)

    return apply


# (kind, parameters, mass, radius, x, v, omega, t) -> force [N] and torque [N m], world axes, of one effect.
effect_force = reduce(_either, [_only(law, KIND_INDEX[kind]) for kind, law in CATALOGUE.items()])


@wp.func
def effect_forces(
    kinds: wp.array[wp.int32],
    acts: wp.array2d[wp.int32],
    parameters: wp.array3d[wp.float64],
    world: int,
    body: int,
    mass: wp.float64,
    radius: wp.float64,
    x: wp.vec3d,
    v: wp.vec3d,
    omega: wp.vec3d,
    t: wp.float64,
) -> wp.spatial_vectord:
    """Sum over the effects acting on a body: force [N], torque [N m] about the centre of mass, world axes.

    kinds (e,), acts (e, n), parameters (1 or W, e, 8) as in `polyworld.solver.arrays.RigidArrays`.
    """
    total = wp.spatial_vectord()
    row = world % parameters.shape[0]
    for e in range(kinds.shape[0]):
        if acts[e, body] == 1:
            p = Vec8()
            for k in range(8):
                p[k] = parameters[row, e, k]
            total += effect_force(kinds[e], p, mass, radius, x, v, omega, t)
    return total
