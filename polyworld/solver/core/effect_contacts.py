"""Enabled effects at a contact, whichever laws the catalogue holds: friction, restitution, tangential law.

An effect acts on a contact in which an object takes part that it acts on; another friction of a region is that of what
does not move, and acts on no contact of two objects.
"""

from __future__ import annotations

from functools import reduce
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.effects import CATALOGUE, KIND_INDEX, EffectLaw, Vec8
from polyworld.solver.core.effect_table import Effects, effect_values

_CONTACT_KINDS = [
    KIND_INDEX[kind] for kind, law in CATALOGUE.items() if law.friction or law.restitution or law.tangential
]


def contact_laws(kinds: NDArray[np.int32]) -> int:
    """Count the effects, given by their kinds (e,), that change what happens at contacts."""
    return int(np.isin(kinds, _CONTACT_KINDS).sum())


@wp.func
def _same_friction(_kind: int, _p: Vec8, mu: wp.float64, _x: wp.vec3d, _path: wp.vec3d) -> wp.float64:
    return mu


@wp.func
def _same_restitution(_kind: int, _p: Vec8, e: wp.float64, _speed: wp.float64) -> wp.float64:
    return e


@wp.func
def _coulomb(_kind: int, _p: Vec8) -> wp.vec3d:
    return wp.vec3d(wp.float64(0.0), wp.float64(-1.0), wp.float64(0.0))


def _with_friction(others: Any, law: EffectLaw) -> Any:
    friction, index = law.friction, KIND_INDEX[law.kind]

    @wp.func
    def apply(kind: int, p: Vec8, mu: wp.float64, x: wp.vec3d, path: wp.vec3d) -> wp.float64:
        if kind == index:
            return friction(p, mu, x, path)
        return others(kind, p, mu, x, path)

    return apply


def _with_restitution(others: Any, law: EffectLaw) -> Any:
    restitution, index = law.restitution, KIND_INDEX[law.kind]

    @wp.func
    def apply(kind: int, p: Vec8, e: wp.float64, speed: wp.float64) -> wp.float64:
        if kind == index:
            return restitution(p, e, speed)
        return others(kind, p, e, speed)

    return apply


def _with_tangential(others: Any, law: EffectLaw) -> Any:
    tangential, index = law.tangential, KIND_INDEX[law.kind]

    @wp.func
    def apply(kind: int, p: Vec8) -> wp.vec3d:
        if kind == index:
            return tangential(p)
        return others(kind, p)

    return apply


_laws = list(CATALOGUE.values())
_friction = reduce(_with_friction, [law for law in _laws if law.friction], _same_friction)
_restitution = reduce(_with_restitution, [law for law in _laws if law.restitution], _same_restitution)
_tangential = reduce(_with_tangential, [law for law in _laws if law.tangential], _coulomb)


@wp.func
def _acts_on(effects: Effects, e: int, a: int, b: int) -> bool:
    """Check whether effect e acts on object a or b; statics and the supporting plane are no objects."""
    if effects.acts[e, a] == 1:
        return True
    if b < 0 or b >= effects.acts.shape[1]:
        return False
    return effects.acts[e, b] == 1


@wp.func(inline=False)
def contact_friction(
    effects: Effects, world: int, a: int, b: int, mu: wp.float64, x: wp.vec3d, path: wp.vec3d
) -> wp.float64:
    """Return the Coulomb coefficient of a contact of a and b at x (world axes), mu without effects: mean over the path
    travelled in a step, with its middle at x.

    a is an object, b an object, a static (from n on) or the supporting plane (-1). A region belongs to what does not
    move: between two objects the coefficient stays mu, wherever they meet.
    """
    if b >= 0 and b < effects.acts.shape[1]:
        return mu
    coefficient = mu
    for e in range(effects.kind.shape[0]):
        if _acts_on(effects, e, a, b):
            coefficient = _friction(effects.kind[e], effect_values(effects, world, e), coefficient, x, path)
    return coefficient


@wp.func(inline=False)
def contact_restitution(effects: Effects, world: int, a: int, b: int, e0: wp.float64, speed: wp.float64) -> wp.float64:
    """Return the restitution of an impact of a and b at an approach speed [m/s], e0 without effects; else as above."""
    restitution = e0
    for e in range(effects.kind.shape[0]):
        if _acts_on(effects, e, a, b):
            restitution = _restitution(effects.kind[e], effect_values(effects, world, e), restitution, speed)
    return restitution


@wp.func(inline=False)
def contact_tangential(effects: Effects, world: int, a: int, b: int) -> wp.vec3d:
    """Return the tangential law of an impact of a and b, see `EffectLaw.tangential`; else as above.

    Losses multiply; of several tangential restitutions the one with the largest stick fraction counts. Without one the
    last two numbers are -1 and 0.
    """
    one = wp.float64(1.0)
    kept = one
    found = wp.vec3d(wp.float64(0.0), -one, wp.float64(0.0))
    for e in range(effects.kind.shape[0]):
        if _acts_on(effects, e, a, b):
            law = _tangential(effects.kind[e], effect_values(effects, world, e))
            kept = kept * (one - law[0])
            if law[1] > -one and law[2] > found[2]:
                found = law
    found[0] = one - kept
    return found
