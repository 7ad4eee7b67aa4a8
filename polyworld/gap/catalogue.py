"""Catalogue what may be missing: effects of `polyworld.effects`, and what is wrong with the world or its observer."""

from __future__ import annotations

import difflib
import importlib
import pkgutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache, partial

from polyworld.data.recording import Recording
from polyworld.effects import ABSENCES, CATALOGUE
from polyworld.effects.absence import Way
from polyworld.effects.conditions import Conditions
from polyworld.estimation.unknown import Unknown
from polyworld.gap import faults
from polyworld.gap.candidate import Candidate, Variant, free_name, neutral, of_path, with_parts
from polyworld.gap.conditions import conditions
from polyworld.world import Effect, World

# Groups in the order in which readers meet them; within a group, candidates stand as their modules are named.
_GROUPS = ("base", "force", "contact", "structure", "joint", "material", "observer")


def catalogue() -> dict[str, Candidate]:
    """Return every candidate by name. Raises ValueError where two modules use one name."""
    return {c.name: c for c in _all()}


def named(names: Sequence[str]) -> list[Candidate]:
    """Return the candidates of these names, each once. Raises ValueError naming the nearest and all choices."""
    known = catalogue()
    unknown = [name for name in dict.fromkeys(names) if name not in known]
    if unknown:
        near = [match for name in unknown for match in difflib.get_close_matches(name, known, n=1)]
        hint = f" (did you mean {', '.join(near)}?)" if near else ""
        raise ValueError(f"no effects {unknown}{hint}; effects: {', '.join(known)}")
    return [known[name] for name in dict.fromkeys(names)]


@cache
def _all() -> tuple[Candidate, ...]:
    found = list(effect_candidates())
    for module in sorted(m.name for m in pkgutil.iter_modules(faults.__path__)):
        found += getattr(importlib.import_module(f"{faults.__name__}.{module}"), "CANDIDATES", ())
    names = [c.name for c in found]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"several candidates are called {', '.join(twice)}")
    return tuple(sorted(found, key=lambda c: _GROUPS.index(c.group)))


__all__ = ["catalogue", "named"]


def effect_candidates() -> tuple[Candidate, ...]:
    """Return one candidate for each effect that laws of `polyworld.effects` declare, its forms together."""
    forms: dict[str, list[str]] = {}
    for kind, absence in ABSENCES.items():
        forms.setdefault(absence.effect or kind, []).append(kind)
    return tuple(_candidate(name, kinds) for name, kinds in forms.items())


def _candidate(name: str, kinds: list[str]) -> Candidate:
    described = [k for k in kinds if ABSENCES[k].signature]
    if len(described) != 1:
        raise ValueError(f"effect {name!r}: exactly one of the laws {kinds} has to say how its absence shows")
    first = described[0]
    # The law that is described, then those per mass, then others.
    listed = sorted(kinds, key=lambda k: (k != first, not CATALOGUE[k].per_mass))
    absence, law = ABSENCES[first], CATALOGUE[first]
    return Candidate(
        name=name,
        group="contact" if law.force is None else "force",
        law="; or ".join(CATALOGUE[k].summary for k in listed),
        variants=partial(_variants, listed),
        plain=absence.plain,
    )


def _variants(kinds: list[str], world: World, recording: Recording) -> tuple[Variant, ...]:
    """Return the ways to add an effect; those that give each body its own come last."""
    found = conditions(world, recording)
    acting = [k for k in kinds if CATALOGUE[k].per_mass or world.objects]  # other laws act on rigid bodies alone
    ways = [(kind, way) for kind in acting for way in ABSENCES[kind].ways(found) if way.starts]
    return tuple(_variant(world, found, kind, way) for kind, way in sorted(ways, key=lambda w: w[1].each == "body"))


def _variant(world: World, found: Conditions, kind: str, way: Way) -> Variant:
    effects = tuple(_added(world, found, kind, way))
    child = with_parts(world, effects=(*world.effects, *effects))
    unknowns = tuple(u for effect in effects for u in _unknowns(child, found, effect, way, len(effects)))
    return Variant(
        child,
        unknowns,
        tuple(neutral(unknowns, **start) for start in way.starts),
        way.label or ("each body by itself" if way.each == "body" else ""),
        way.same_as,
        tuple(name for name, parameter in way.free.items() if parameter.idle),
    )


def _added(world: World, found: Conditions, kind: str, way: Way) -> Iterator[Effect]:
    """Return the law as effects of a world, off: one that acts on all it can, or one for each body, called after it."""
    taken = {e.name for e in world.effects}
    if not way.each:
        # A law that is not proportional to mass acts on rigid bodies alone.
        limited = world.deformables and not CATALOGUE[kind].per_mass
        objects = tuple(o.name for o in world.objects) if limited else None
        yield Effect(name=free_name(kind, taken), kind=kind, parameters=dict(way.values), objects=objects)
        return
    for body in [o.name for o in world.objects] if way.each == "body" else found.unturned:
        name = free_name(f"{kind}_{body}", taken)
        yield Effect(name=name, kind=kind, parameters=dict(way.values), objects=(body,))


def _unknowns(child: World, found: Conditions, effect: Effect, way: Way, effects: int) -> Iterator[Unknown]:
    """Return the free parameters of one effect: of each run, of one body, or of all."""
    body = effect.objects[0] if way.each and effect.objects else ""
    own = [_unknown(child, effect, way, name) for name in way.free]
    if way.each == "run":
        for run in found.unturned[body]:
            whom = run if effects == 1 else f"{run}, {body}"
            yield from (replace(u, name=f"{u.name} in {whom}", run=run) for u in own)
    elif way.each == "body":
        yield from (replace(u, name=f"{u.name}_{body}") for u in own)
    else:
        yield from own


def _unknown(child: World, effect: Effect, way: Way, parameter: str) -> Unknown:
    free = way.free[parameter]
    start = way.values.get(parameter, CATALOGUE[effect.kind].parameters[parameter].default)
    path = (f"effects.{effect.name}.{parameter}",)
    limits = {"lower": free.lower, "upper": free.upper}
    return of_path(child, path, parameter, start, free.typical, plausible=free.plausible, **limits)
