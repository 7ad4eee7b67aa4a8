"""The catalogue of effects: one law a file, with how its absence shows (`LAW` and `ABSENCE`), found by itself."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping

from polyworld.effects.absence import Absence
from polyworld.effects.law import MAX_PARAMETERS, EffectLaw, EffectParameter, Motion, Vec8


def _discover() -> tuple[dict[str, EffectLaw], dict[str, Absence]]:
    """Laws by kind, and how their absence shows, of those that say so."""
    laws: dict[str, EffectLaw] = {}
    absences: dict[str, Absence] = {}
    for name in sorted(module.name for module in pkgutil.iter_modules(__path__)):
        module = importlib.import_module(f"{__name__}.{name}")
        law, absence = getattr(module, "LAW", None), getattr(module, "ABSENCE", None)
        if isinstance(law, EffectLaw):
            laws[law.kind] = law
            if isinstance(absence, Absence):
                absences[law.kind] = absence
    return dict(sorted(laws.items())), dict(sorted(absences.items()))


CATALOGUE: dict[str, EffectLaw]
ABSENCES: dict[str, Absence]
CATALOGUE, ABSENCES = _discover()
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
    "ABSENCES",
    "CATALOGUE",
    "KIND_INDEX",
    "MAX_PARAMETERS",
    "Absence",
    "EffectLaw",
    "EffectParameter",
    "Motion",
    "Vec8",
    "check_effect",
]
