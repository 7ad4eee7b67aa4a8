"""The law of an effect, whether the catalogue has it or the effect itself carries it as an expression."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polyworld.effects import CATALOGUE, KIND_INDEX, EffectLaw, EffectParameter, check_effect
from polyworld.expressions.parse import Expression, compile_expression

if TYPE_CHECKING:
    from collections.abc import Iterable

    from polyworld.world import Effect

EXPRESSION = "expression"
EXPRESSION_KIND = len(CATALOGUE)  # kind number of a program that begins at row 0; see `effect_programs`
_WIDE = 1e9  # bound of a parameter that has none of its own


def law_of(effect: Effect) -> EffectLaw:
    """The law that moves what the effect acts on; raises KeyError for a kind that the catalogue does not have."""
    if effect.kind != EXPRESSION:
        return CATALOGUE[effect.kind]
    return EffectLaw(
        kind=EXPRESSION,
        summary=f"F = m ({', '.join(_written(effect).text)})",
        parameters={name: _parameter(effect, name) for name in effect.parameters},
        reference="an expression of this world's own",
        work=None,
        per_mass=True,
    )


def check_law(effect: Effect) -> None:
    """Raise ValueError, naming the valid choices, unless the law exists, can be read and has its parameters."""
    if effect.kind != EXPRESSION:
        given = [n for n in ("expression", "parameter_units", "parameter_bounds") if getattr(effect, n)]
        if given:
            raise ValueError(f"effect {effect.name!r}: {given} belong to effects of kind {EXPRESSION!r}")
        if effect.kind not in CATALOGUE:
            raise ValueError(f"unknown effect kind {effect.kind!r}; kinds: {[*CATALOGUE, EXPRESSION]}")
        check_effect(effect.name, effect.kind, effect.parameters)
        return
    if effect.expression is None:
        raise ValueError(f"effect {effect.name!r} of kind {EXPRESSION!r} needs `expression`: the acceleration it gives")
    for table in ("parameter_units", "parameter_bounds"):
        unknown = sorted(set(getattr(effect, table)) - set(effect.parameters))
        if unknown:
            raise ValueError(f"effect {effect.name!r}: {table} names {unknown}; parameters: {list(effect.parameters)}")
    for name, value in effect.parameters.items():
        spec = _parameter(effect, name)
        if not (math.isfinite(value) and spec.lower <= value <= spec.upper):
            raise ValueError(
                f"effect {effect.name!r}: {name} = {value} is outside {spec.lower} to {spec.upper} {spec.unit}"
            )
    try:
        compile_expression(_written(effect))
    except ValueError as error:
        raise ValueError(f"effect {effect.name!r}: {error}") from None


def effect_programs(effects: Iterable[Effect]) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Kind numbers (e,) of effects, and the programs (rows, 4) of those that are expressions, one after the other.

    A kind number is the law's place in the catalogue; that of an expression is `EXPRESSION_KIND` plus the row where
    its program begins.
    """
    kinds: list[int] = []
    programs: list[NDArray[np.float64]] = [np.zeros((0, 4))]
    rows = 0
    for effect in effects:
        if effect.kind == EXPRESSION:
            kinds.append(EXPRESSION_KIND + rows)
            programs.append(compile_expression(_written(effect)))
            rows += len(programs[-1])
        else:
            kinds.append(KIND_INDEX[effect.kind])
    return np.array(kinds, dtype=np.int32), np.concatenate(programs)


def _written(effect: Effect) -> Expression:
    given = effect.expression
    assert given is not None
    text = (given,) if isinstance(given, str) else (given.x, given.y, given.z)
    return Expression(text, tuple((name, effect.parameter_units.get(name, "1")) for name in effect.parameters))


def _parameter(effect: Effect, name: str) -> EffectParameter:
    value = effect.parameters[name]
    reach = max(1.0, 10.0 * abs(value))
    bounds = effect.parameter_bounds.get(name)
    lower, upper = bounds or (-_WIDE, _WIDE)
    return EffectParameter(
        unit=effect.parameter_units.get(name, "1"),
        lower=lower,
        upper=upper,
        search=bounds or (-reach, reach),
        default=value,
        description=f"parameter {name} of the expression",
    )
