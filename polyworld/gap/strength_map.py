"""Where an effect with an edge may sit, from how strong it would have to be in every short stretch of the paths.

Made to act everywhere, an effect moves every window; the score test (Rao 1948) tells, window by window, what strength
that asks for. A disc that holds the windows that ask for much, and none of those that ask for nothing, is where a fit
begins. Trajectories themselves do not lead there: they feel an edge only where a path crosses it, so chi2 as a function
of the place is flat in one stretch and jumps in the next.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from polyworld import geometry
from polyworld.estimation import profile
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.parts import FEWEST
from polyworld.estimation.score_test import ScoreTestStart
from polyworld.estimation.trial import FitContext, FittedHypothesis
from polyworld.gap.windows import Windows, windows
from polyworld.recording import Run

Array = NDArray[np.float64]

GROUND_ITERATIONS = 4  # so short a window is nearly straight
SURE = 4.0  # standard deviations by which a window, or a disc, asks for an effect
ROUGH = 0.3  # of a usual strength, that slopes misjudge: a grip ends the slide that it acts on
FILLED = 0.4  # of a window that has to lie inside for the effect to show there in full
LITTLE = 1e-6  # of what is told of all windows, below which a disc is told apart from none
POPULATION, GENERATIONS, SEED = 40, 60, 1977  # of the search for discs (Storn & Price 1997)
MOST_WINDOWS = 512
SAMPLES = 8  # of each window, by which it is told how much of it lies inside
BANDS = (0.0, 1.2, 2.5, 5.0, np.inf)  # typical changes of the radius: small and large discs are looked for apart
KEPT = 2  # of each, to begin with
APART = 0.1  # of what windows tell, that these do not hold in common
BEGUN = 0.7  # of the strength asked for, to begin with: less friction than none is no place to start
ALIGNED = 0.999  # component of a plane's normal along a world axis, from which on a disc lies along the others


@dataclass(frozen=True)
class StrengthMap:
    """What windows ask for: strength (W,), its weight (W,), and places (W, T, D) on them, D the axes of a disc.

    Weights allow for the roughness of the slope, so that no single window outweighs many. known: whether the motion
    elsewhere is known; where something of it is fitted too, elsewhere may ask for some of the effect all over.
    """

    strength: Array
    weight: Array
    places: Array
    known: bool

    def held(self, centres: Array, radii: Array) -> Array:
        """How much (K, W), from 0 to 1, of what an effect does to each window it does within each of K discs."""
        beside = self.places[None] - centres[:, None, None]
        within = np.einsum("kwtd,kwtd->kwt", beside, beside) < (radii**2)[:, None, None]
        part: Array = np.minimum(within.mean(axis=2) / FILLED, 1.0)
        return part

    def unlike(self, rows: Array) -> NDArray[np.intp]:
        """The first few of some discs (K, D + 1), centre and radius, that do not hold nearly the same windows."""
        kept: list[int] = []
        part = self.held(rows[:, :-1], rows[:, -1])
        for k in range(len(rows)):
            common = ((part[kept] - part[k]) ** 2) @ self.weight
            if not len(kept) or float(common.min()) > APART * float(part[k] ** 2 @ self.weight):
                kept.append(k)
            if len(kept) == KEPT:
                break
        return np.array(kept, dtype=np.intp)

    def gain(self, centres: Array, radii: Array) -> tuple[Array, Array]:
        """For K discs with centres (K, D) and radii (K,): the fall (K,) of the weighted sum of squares if the effect
        acts in there and nowhere else, and the strength (K,) at which it falls so much."""
        part = self.held(centres, radii)
        asked, whole = self.weight * self.strength, float(self.weight.sum())
        information, pull = part**2 @ self.weight, part @ asked
        if not self.known:
            share = part @ self.weight / whole
            information, pull = information - whole * share**2, pull - share * float(asked.sum())
        told = information > LITTLE * whole
        strength = np.divide(pull, information, out=np.zeros(len(pull)), where=told)
        return information * strength**2, strength


def strength_map(ground: FittedHypothesis, hypothesis: Hypothesis) -> StrengthMap:
    """The map of the last effect of a hypothesis, made to act everywhere, over windows that a trial without it was
    fitted to."""
    design = ground.bench.design
    variant = hypothesis.parts[-1].variant
    start = {u.name: u.start for u in variant.unknowns} | dict(variant.everywhere or {})
    values = np.concatenate([ground.values, [start[u.name] for u in variant.unknowns]])
    column = len(ground.values) + [u.name for u in variant.unknowns].index(str(variant.strength))
    forward = ground.bench.forward(hypothesis)
    linear = profile.linearise(forward, ground.bench.noise, values, ground.fit.states, ground.fit)
    axes = ["xyz".index(u.name) for u in variant.unknowns if u.name in ("x", "y", "z")]
    slope, information = np.zeros(len(design.runs)), np.zeros(len(design.runs))
    places = []
    for r in design.runs:
        if np.all(np.isfinite(linear.r[r.index])):  # else its rollout diverges, and it asks for nothing
            by_strength = ground.ground.off(r.index, linear.a[r.index][:, column])
            slope[r.index] = by_strength @ ground.ground.off(r.index, linear.r[r.index])
            information[r.index] = by_strength @ by_strength
        places.append(_sampled(r.run, axes))
    information = np.maximum(information, 1e-300)
    strength = -slope / information
    sure = np.abs(slope) > SURE * np.sqrt(information)
    usual = float(np.median(np.abs(strength[sure]))) if sure.any() else 0.0
    weight = 1.0 / (1.0 / information + (ROUGH * usual) ** 2)
    return StrengthMap(strength, weight, np.array(places), not len(ground.values))


def _sampled(run: Run, axes: list[int]) -> Array:
    """Places (SAMPLES, D) of a run's one body, from start to end; NaN where it was never seen."""
    places: Array = run.positions[:, 0][:, axes]
    seen = np.flatnonzero(np.isfinite(places).all(axis=1))
    if not len(seen):
        return np.full((SAMPLES, len(axes)), np.nan)
    chosen: Array = places[seen[np.linspace(0, len(seen) - 1, SAMPLES).round().astype(int)]]
    return chosen


def _drawn(hypothesis: Hypothesis) -> bool:
    """Whether the last effect can be made to act everywhere, one body moves, so that a window is at one place, and not
    on an oblique plane."""
    world = hypothesis.world
    if hypothesis.parts[-1].variant.everywhere is None or len(world.moving_names) != 1:
        return False
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    return not world.planar or float(np.max(np.abs(normal))) > ALIGNED


def _shortest(bench: FitContext) -> Windows | None:
    """The shortest windows that a design can be cut into, not too many."""
    runs = bench.design.runs
    pieces = min(max(len(r.times) for r in runs) // FEWEST, MOST_WINDOWS // len(runs))
    while pieces > 1:
        cut = windows(bench, pieces)
        if cut is not None:
            return cut
        pieces //= 2
    return windows(bench, 1)


def mapped(parent: FittedHypothesis, hypothesis: Hypothesis) -> list[ScoreTestStart]:
    """Leads to a hypothesis that adds an effect with an edge to a trial, from its map over the shortest windows.

    Best first; none where there is no map, or no disc of it asks for the effect. chi2 in them is what is left of the
    map's sum of squares.
    """
    if not _drawn(hypothesis):
        return []
    cut = _shortest(parent.bench)
    if cut is None:
        return []
    states = profile.start_states(cut.bench.design)
    ground = cut.bench.fit(parent.hypothesis, parent.values, states, iterations=GROUND_ITERATIONS)
    found = strength_map(ground, hypothesis)
    own = hypothesis.parts[-1].variant.unknowns
    at = {u.name: i for i, u in enumerate(own)}
    axes = [at[name] for name in "xyz" if name in at]
    radius = own[at["radius"]]
    kept = []
    for low, high in pairwise(np.clip(np.array(BANDS) * radius.typical, radius.lower, radius.upper)):
        if low < high:
            kept += _discs(found, [(own[i].lower, own[i].upper) for i in axes], (float(low), float(high)))
    total = float(found.weight @ found.strength**2)
    asked = sorted((row for row in kept if row[0] > SURE**2), key=lambda row: -float(row[0]))
    return [_lead(ground.values, hypothesis, row, axes, at, total) for row in asked]


def _discs(found: StrengthMap, places: list[tuple[float, float]], radii: tuple[float, float]) -> list[Array]:
    """Rows of gain, strength, centre and radius: the best few discs within bounds."""
    seen: list[Array] = []

    def left(discs: Array) -> Array:
        centres, sizes = discs[:-1].T, np.exp(discs[-1])
        gain, strength = found.gain(centres, sizes)
        seen.append(np.column_stack([gain, strength, centres, sizes]))
        return -gain

    differential_evolution(
        left,
        [*places, (float(np.log(radii[0])), float(np.log(radii[1])))],
        popsize=POPULATION,
        maxiter=GENERATIONS,
        rng=SEED,
        init="sobol",
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
    )
    rows = np.concatenate(seen)
    rows = rows[np.argsort(-rows[:, 0], kind="stable")]
    return list(rows[found.unlike(rows[:, 2:])])


def _lead(
    before: Array, hypothesis: Hypothesis, row: Array, axes: list[int], at: dict[str, int], total: float
) -> ScoreTestStart:
    variant = hypothesis.parts[-1].variant
    values = np.array([u.start for u in variant.unknowns])
    values[axes], values[at["radius"]] = row[2:-1], row[-1]
    unknown = variant.unknowns[at[str(variant.strength)]]
    values[at[unknown.name]] = np.clip(BEGUN * row[1], unknown.lower, unknown.upper)
    return ScoreTestStart(hypothesis, np.concatenate([before, values]), total - float(row[0]))
