"""Cases of the first generator: effects on a bouncing ball and on discs, laws outside the catalogue, poor designs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from polyworld.data.recording import Recording, Run
from polyworld.world import World
from tests.benchmarks.first_generator import cases as first_cases
from tests.benchmarks.first_generator.cases import ON_PLANE, SECTIONS, draw_hidden
from tests.benchmarks.first_generator.disc_cases import draw_discs
from tests.benchmarks.first_generator.generate import observed_runs, world_json
from tests.benchmarks.first_generator.outside import OUTSIDE
from tests.benchmarks.gaps.case import NOTHING, Case, Names, noncentrality

REPEATED = {"two_effects": 20, "poor_designs": 3}  # of sections whose draws differ in more than numbers
CORRELATION = {"ar1": 0.9}


@cache
def _plans() -> tuple[first_cases.Case, ...]:
    """Return the cases of each section, once for all levels of noise."""
    cases = [c for name, section in SECTIONS.items() for c in section(REPEATED.get(name, 1))]
    return tuple({(c.section, c.draw, c.effects, c.kind, c.design): c for c in reversed(cases)}.values())[::-1]


def listed() -> list[str]:
    """Return sections and effects."""
    return [f"{c.section} {'+'.join(c.effects) or f'nothing {c.kind}'}" for c in _plans()]


def drawn(index: int, level: float, seed: int) -> Case:
    """Return a case."""
    plan = replace(_plans()[index], noise=level)
    rng = np.random.default_rng([seed, 1, *(ord(c) for c in plan.name)])
    names, world, fitted, held_out, effects = (
        _discs(plan, seed, rng) if plan.section in ON_PLANE else _ball(plan, seed, rng)
    )
    recording = Recording(tuple(Run(n, names, *columns) for n, *columns in fitted))
    rows = sum(len(r.times) * len(names) for r in recording.runs)
    components = 2 if plan.section in ON_PLANE else 3
    size = min((e["size"] for e in effects), default=np.inf) * np.sqrt(components) / level
    found = [e["name"] for e in effects]
    outside = plan.section == "outside"
    allowed = [Names(a) for a in OUTSIDE[found[0]][1]] if outside else []
    return Case(
        listed()[index],
        World.model_validate(world),
        recording,
        tuple(allowed) if outside else (Names(found),) if found else NOTHING,
        outside,
        level,
        Recording(tuple(Run(n, names, *columns) for n, *columns in held_out)),
        alike=first_cases.alike(plan.section),
        noncentrality=noncentrality(size, rows, CORRELATION.get(plan.kind, 0.0)),
        numbers={e["name"]: e["numbers"] for e in effects},
        places={e["name"]: e["place"] for e in effects if e["place"]},
    )


Drawn = tuple[tuple[str, ...], dict[str, Any], list[Any], list[Any], list[dict[str, Any]]]


def _discs(plan: first_cases.Case, seed: int, rng: np.random.Generator) -> Drawn:
    discs = draw_discs(plan, seed)
    fitted = discs.runs(rng, range(plan.runs))
    held_out = discs.runs(rng, range(plan.runs, len(discs.scene.starts)))
    return tuple(discs.names), discs.world_json(), fitted, held_out, discs.effects


def _ball(plan: first_cases.Case, seed: int, rng: np.random.Generator) -> Drawn:
    hidden = draw_hidden(plan, seed)
    count = hidden.design.fitted
    fitted = observed_runs(hidden, rng, range(count))
    held_out = observed_runs(hidden, rng, range(count, len(hidden.design.launches)))
    effects = [
        {"name": e.drawn.name, "size": e.size, "numbers": e.numbers, "place": e.drawn.place} for e in hidden.effects
    ]
    return ("ball",), world_json(hidden), fitted, held_out, effects
