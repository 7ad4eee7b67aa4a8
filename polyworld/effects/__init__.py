"""The catalogue of effects: one law a file, found by itself, all reached through `EffectLaw`."""

from __future__ import annotations

import importlib
import pkgutil
from typing import TYPE_CHECKING

from polyworld.effects.law import MAX_PARAMETERS, EffectLaw, EffectParameter, Vec8

if TYPE_CHECKING:
    from polyworld.world import Effect


def _discover() -> dict[str, EffectLaw]:
    laws: dict[str, EffectLaw] = {}
    for module in pkgutil.iter_modules(__path__):
        law = getattr(importlib.import_module(f"{__name__}.{module.name}"), "LAW", None)
        if isinstance(law, EffectLaw):
            laws[law.kind] = law
    return dict(sorted(laws.items()))


CATALOGUE: dict[str, EffectLaw] = _discover()
KIND_INDEX: dict[str, int] = {kind: index for index, kind in enumerate(CATALOGUE)}


def check_effect(effect: Effect) -> None:
    """Raise ValueError, naming the valid choices, unless the catalogue knows the effect and its parameters."""
    if effect.kind not in CATALOGUE:
        raise ValueError(f"unknown effect kind {effect.kind!r}; kinds: {list(CATALOGUE)}")
    law = CATALOGUE[effect.kind]
    for name, value in effect.parameters.items():
        if name not in law.parameters:
            raise ValueError(f"effect {effect.kind} has no parameter {name!r}; parameters: {list(law.parameters)}")
        spec = law.parameters[name]
        if not spec.lower <= value <= spec.upper:
            raise ValueError(
                f"effect {effect.name!r}: {name} = {value} is outside {spec.lower} to {spec.upper} {spec.unit}"
            )


__all__ = [
    "CATALOGUE",
    "KIND_INDEX",
    "MAX_PARAMETERS",
    "EffectLaw",
    "EffectParameter",
    "Vec8",
    "check_effect",
]
