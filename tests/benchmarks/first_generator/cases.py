"""The cases of the benchmark: what is hidden in each, on which design, under which noise; all drawn from one seed."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.benchmarks.first_generator.design import DESIGNS, RESTITUTION, BallDesign
from tests.benchmarks.first_generator.laws import EFFECTS, Draw, Scenery
from tests.benchmarks.first_generator.observer import NoiseKind
from tests.benchmarks.first_generator.outside import OUTSIDE
from tests.benchmarks.first_generator.strength import LARGEST, SMALLEST, Strong, make_strong
from tests.scenes.ball import UnusableCase

NOISES = (0.001, 0.01, 0.03)
ATTEMPTS = 40

# Effects that no pair of launches distinguishes: naming any of them is right. On a level plane the clock, and gravity,
# show through friction alone; and a force that needs contact acts always.
SAME = (frozenset({"gravity_error", "buoyancy", "observer_scale", "observer_clock"}),)
SAME_ON_PLANE = (
    frozenset({"friction_error", "gravity_error", "observer_clock"}),
    frozenset({"linear_drag", "viscous_friction"}),
)
ON_PLANE = ("bodies", "unturned_bodies")  # sections
# What acts like a force that is the same everywhere: two of these are one such force, and one moves a spring's anchor.
UNIFORM = SAME[0] | {"tilt"}


@dataclass(frozen=True)
class Case:
    """section and index identify the case; draw: index of the physics, the same for all noise levels.

    effects: names, empty for none. bodies: how many the scene has. noise: standard deviation as a share of the path
    scale (positions) and of a radian (turns). design, runs, rate: see `design`. turns: whether measured.
    """

    section: str
    index: int
    draw: int
    effects: tuple[str, ...]
    noise: float
    kind: NoiseKind = "white"
    design: str = "bouncing"
    runs: int = 8
    rate: float = 120.0
    bodies: int = 1
    turns: bool = True

    @property
    def name(self) -> str:
        """Folder of the case."""
        return f"{self.section}-{self.index:04d}"


def alike(section: str) -> dict[str, str]:
    """Return the effects that no experiment of a section distinguishes from others, with one that stands for all."""
    return {name: min(group) for group in (SAME_ON_PLANE if section in ON_PLANE else SAME) for name in group}


def _one_motion(pair: tuple[str, str]) -> bool:
    """Whether one effect alone moves a ball as the two together do: a spring elsewhere, or one force that is the same
    everywhere, as that of a wide fan nearly is."""
    beside_spring = "spring" in pair and bool(UNIFORM & set(pair))
    return beside_spring or set(pair) <= UNIFORM


def one_effect(seeds: int) -> Iterator[Case]:
    """Return every effect, `seeds` times, each at all noise levels."""
    index = itertools.count()
    for draw in range(seeds):
        for name, (_, designs) in EFFECTS.items():
            for noise in NOISES:
                yield Case("one_effect", next(index), draw, (name,), noise, design=designs[draw % len(designs)])


def nothing(seeds: int) -> Iterator[Case]:
    """The base world alone: 3 of `seeds` parts white noise, one part each of three other kinds; all noise levels."""
    index = itertools.count()
    kinds: Sequence[NoiseKind] = ("white", "ar1", "white", "outliers", "white", "missing_rows")
    for draw in range(seeds):
        for i, kind in enumerate(kinds):
            yield Case("nothing", next(index), len(kinds) * draw + i, (), NOISES[(draw + i // 2) % 3], kind)


def two_effects(seeds: int) -> Iterator[Case]:
    """Pairs of effects that act in the bouncing design and are no single effect together, at 0.1 and 1% noise."""
    names = [n for n, (_, designs) in EFFECTS.items() if designs == ("bouncing",)]
    pairs = [p for p in itertools.combinations(names, 2) if not _one_motion(p)]
    order = np.random.default_rng(0).permutation(len(pairs))
    index = itertools.count()
    for draw in range(seeds):
        for noise in NOISES[:2]:
            yield Case("two_effects", next(index), draw, pairs[order[draw % len(pairs)]], noise)


def outside(seeds: int) -> Iterator[Case]:
    """Laws outside the catalogue, at 0.1 and 1% noise."""
    index = itertools.count()
    for draw in range(seeds):
        for name in OUTSIDE:
            for noise in NOISES[:2]:
                yield Case("outside", next(index), draw, (name,), noise)


def poor_designs(seeds: int) -> Iterator[Case]:
    """Single effects at 1% noise on designs that may not separate them: one launch, drops, 24 Hz, one speed."""
    names = [n for n, (_, designs) in EFFECTS.items() if designs == ("bouncing",)]
    index = itertools.count()
    for draw in range(seeds):
        for k, (design, runs, rate) in enumerate(
            (("bouncing", 1, 120.0), ("drops", 8, 120.0), ("bouncing", 8, 24.0), ("one_speed", 8, 120.0))
        ):
            # Strides of 7 and 3 through the names: every effect meets every design in turn.
            name = names[(7 * draw + 3 * k) % len(names)]
            yield Case("poor_designs", next(index), 4 * draw + k, (name,), 0.01, "white", design, runs, rate)


def bodies(seeds: int) -> Iterator[Case]:
    """Return two to six discs that collide: one effect, or in one case of eleven none, at all noise levels."""
    names = ("tilt", "linear_drag", "quadratic_drag", "coriolis", "friction_error", "restitution_error", "mass_error")
    names = (*names, "friction_patch", "spring", "observer_scale", "")
    index = itertools.count()
    for draw in range(seeds):
        for k, name in enumerate(names):
            effects = (name,) if name else ()
            for noise in NOISES:
                count = 2 + (draw + k) % 5
                yield Case("bodies", next(index), draw, effects, noise, design="discs", runs=4, rate=60.0, bodies=count)


def unturned_bodies(seeds: int) -> Iterator[Case]:
    """Like discs of which places alone were measured, as tracks of a video have them."""
    for case in bodies(seeds):
        yield replace(case, section="unturned_bodies", turns=False)


SECTIONS: dict[str, Callable[[int], Iterator[Case]]] = {
    "one_effect": one_effect,
    "nothing": nothing,
    "two_effects": two_effects,
    "outside": outside,
    "poor_designs": poor_designs,
    "bodies": bodies,
    "unturned_bodies": unturned_bodies,
}


@dataclass(frozen=True)
class Hidden:
    """A case that was drawn: its design and the effects with their strengths."""

    case: Case
    design: BallDesign
    effects: tuple[Strong, ...]


def draw_hidden(case: Case, seed: int) -> Hidden:
    """Draw the launches and effects of a case: the same ones for equal section, draw and effects.

    A draw in which an effect can do nothing is made again, with other launches; an effect that a poor design cannot
    show at all gives way to another. Raises UnusableCase where nothing usable is found.
    """
    key = [seed, *(ord(c) for c in case.section), case.draw]
    for attempt in range(ATTEMPTS):
        names = case.effects
        rng = np.random.default_rng([*key, attempt, *(ord(c) for c in "".join(names))])
        if attempt >= ATTEMPTS // 4 and case.section == "poor_designs":
            names = (str(rng.choice([n for n, (_, d) in EFFECTS.items() if d == ("bouncing",)])),)
        design = DESIGNS[case.design](rng, runs=case.runs, rate=case.rate)
        scenery = Scenery(design.ball, RESTITUTION, design.base_paths(), design.stamps, design.fitted)
        try:
            effects = tuple(_strong(rng, design, scenery, name) for name in names)
        except UnusableCase:
            continue
        return Hidden(case, design, effects)
    raise UnusableCase(f"{case.name}: no usable draw of {case.effects} in {ATTEMPTS} attempts")


def _strong(rng: np.random.Generator, design: BallDesign, scenery: Scenery, name: str) -> Strong:
    draw: Draw = OUTSIDE[name][0] if name in OUTSIDE else EFFECTS[name][0]
    target = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))
    return make_strong(design, draw(rng, scenery), target)
