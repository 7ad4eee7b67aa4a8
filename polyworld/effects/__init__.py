"""The catalogue of effects: one law a file, found by itself, all reached through `EffectLaw`."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping

from polyworld.effects.law import MAX_PARAMETERS, EffectLaw, EffectParameter, Motion, Vec8


def _discover() -> dict[str, EffectLaw]:
    laws: dict[str, EffectLaw] = {}
    for module in pkgutil.iter_modules(__path__):
        law = getattr(importlib.import_module(f"{__name__}.{module.name}"), "LAW", None)
        if isinstance(law, EffectLaw):
            laws[law.kind] = law
    return dict(sorted(laws.items()))


CATALOGUE: dict[str, EffectLaw] = _discover()
KIND_INDEX: dict[str, int] = {kind: index for index, kind in enumerate(CATALOGUE)}


def check_effect(name: str, kind: str, parameters: Mapping[str, float]) -> None:
    """Raise ValueError, naming the valid choices, unless the catalogue knows the kind and its parameters."""
    if kind not in CATALOGUE:
        raise ValueError(f"unknown effect kind {kind!r}; kinds: {list(CATALOGUE)}")
    law = CATALOGUE[kind]
    for parameter, value in parameters.items():
        if parameter not in law.parameters:
            raise ValueError(f"effect {kind} has no parameter {parameter!r}; parameters: {list(law.parameters)}")
        spec = law.parameters[parameter]
        if not spec.lower <= value <= spec.upper:
            raise ValueError(
                f"effect {name!r}: {parameter} = {value} is outside {spec.lower} to {spec.upper} {spec.unit}"
            )


__all__ = [
    "CATALOGUE",
    "KIND_INDEX",
    "MAX_PARAMETERS",
    "EffectLaw",
    "EffectParameter",
    "Motion",
    "Vec8",
    "check_effect",
]
