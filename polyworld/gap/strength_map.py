"""Locate an effect with an edge by estimating its strength in every short window of the paths.

Made to act everywhere, an effect moves every window; the score test (Rao 1948) estimates the strength window by window.
A fit begins at a disc that holds the windows with a large strength and none of those without. Gradients of trajectories
do not lead there: these feel an edge only where a path crosses it, so chi2 as a function of the place is flat in one
stretch and jumps in the next.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from polyworld.data.recording import Run
from polyworld.estimation import profile
from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.run_segments import FEWEST
from polyworld.estimation.score_test import ScoreTestStart
from polyworld.gap.segment_context import SegmentContext, segment_context
from polyworld.gap.settings import MapSettings
from polyworld.world import geometry

Array = NDArray[np.float64]

SEED = 1977  # of the search for discs, the same for all


@dataclass(frozen=True)
class StrengthMap:
    """Estimates of W windows: strength (W,), its weight (W,), and places (W, T, D) on them, D the axes of a disc.

    Weights allow for the roughness of the slope, so that no single window outweighs many. known: whether the motion
    elsewhere is known; otherwise a part of the effect may act all over.
    """

    strength: Array
    weight: Array
    places: Array
    known: bool
    settings: MapSettings

    def held(self, centres: Array, radii: Array) -> Array:
        """Estimate how much (K, W), from 0 to 1, of its effect on each window an effect has within each of K discs."""
        beside = self.places[None] - centres[:, None, None]
        within = np.einsum("kwtd,kwtd->kwt", beside, beside) < (radii**2)[:, None, None]
        part: Array = np.minimum(within.mean(axis=2) / self.settings.filled, 1.0)
        return part

    def unlike(self, rows: Array) -> NDArray[np.intp]:
        """Choose the first few of some discs (K, D + 1), centre and radius, that do not hold the same windows."""
        kept: list[int] = []
        part = self.held(rows[:, :-1], rows[:, -1])
        for k in range(len(rows)):
            common = ((part[kept] - part[k]) ** 2) @ self.weight
            if not len(kept) or float(common.min()) > self.settings.overlap * float(part[k] ** 2 @ self.weight):
                kept.append(k)
            if len(kept) == self.settings.kept:
                break
        return np.array(kept, dtype=np.intp)

    def gain(self, centres: Array, radii: Array) -> tuple[Array, Array]:
        """Predict the fall (K,) of the weighted sum of squares if the effect acts within each of K discs alone, and the
        strength (K,) at which it falls so much. centres (K, D), radii (K,)."""
        part = self.held(centres, radii)
        asked, whole = self.weight * self.strength, float(self.weight.sum())
        information, pull = part**2 @ self.weight, part @ asked
        if not self.known:
            share = part @ self.weight / whole
            information, pull = information - whole * share**2, pull - share * float(asked.sum())
        informative = information > 1e-6 * whole  # else a disc holds all windows, or none
        strength = np.divide(pull, information, out=np.zeros(len(pull)), where=informative)
        return information * strength**2, strength


def strength_map(ground: FittedHypothesis, hypothesis: Hypothesis, settings: MapSettings) -> StrengthMap:
    """Map the last effect of a hypothesis, made to act everywhere, over windows that a fit without it explains."""
    design = ground.context.design
    variant = hypothesis.parts[-1].variant
    start = {u.name: u.start for u in variant.unknowns} | dict(variant.everywhere or {})
    values = np.concatenate([ground.values, [start[u.name] for u in variant.unknowns]])
    column = len(ground.values) + [u.name for u in variant.unknowns].index(str(variant.strength))
    forward = ground.context.forward(hypothesis)
    linear = profile.linearise(forward, ground.context.noise, values, ground.fit.states, ground.fit)
    axes = ["xyz".index(u.name) for u in variant.unknowns if u.name in ("x", "y", "z")]
    slope, information = np.zeros(len(design.runs)), np.zeros(len(design.runs))
    places = []
    for r in design.runs:
        if np.all(np.isfinite(linear.r[r.index])):  # else its rollout diverges, and it asks for nothing
            by_strength = ground.nuisance.off(r.index, linear.a[r.index][:, column])
            slope[r.index] = by_strength @ ground.nuisance.off(r.index, linear.r[r.index])
            information[r.index] = by_strength @ by_strength
        places.append(_sampled(r.run, axes, settings.samples))
    information = np.maximum(information, 1e-300)
    strength = -slope / information
    sure = np.abs(slope) > settings.sure * np.sqrt(information)
    usual = float(np.median(np.abs(strength[sure]))) if sure.any() else 0.0
    weight = 1.0 / (1.0 / information + (settings.rough * usual) ** 2)
    return StrengthMap(strength, weight, np.array(places), not len(ground.values), settings)


def _sampled(run: Run, axes: list[int], count: int) -> Array:
    """Return places (count, D) of a run's one body, from start to end; NaN where it was never seen."""
    places: Array = run.positions[:, 0][:, axes]
    seen = np.flatnonzero(np.isfinite(places).all(axis=1))
    if not len(seen):
        return np.full((count, len(axes)), np.nan)
    chosen: Array = places[seen[np.linspace(0, len(seen) - 1, count).round().astype(int)]]
    return chosen


def _can_be_mapped(hypothesis: Hypothesis) -> bool:
    """Return whether the last effect can be made to act everywhere, one body moves, so that a window is at one place,
    and the plane of motion, if any, lies along world axes."""
    world = hypothesis.world
    if hypothesis.parts[-1].variant.everywhere is None or len(world.moving_names) != 1:
        return False
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    return not world.planar or float(np.max(np.abs(normal))) > 1.0 - 1e-3


def _shortest(context: FitContext, most: int) -> SegmentContext | None:
    """Cut a design into the shortest windows possible, at most so many."""
    runs = context.design.runs
    pieces = min(max(len(r.times) for r in runs) // FEWEST, most // len(runs))
    while pieces > 1:
        cut = segment_context(context, pieces)
        if cut is not None:
            return cut
        pieces //= 2
    return segment_context(context, 1)


def mapped(
    parent: FittedHypothesis, hypothesis: Hypothesis, settings: MapSettings | None = None
) -> list[ScoreTestStart]:
    """Find where fits of a hypothesis that adds an effect with an edge should begin, from its map over short windows.

    Best first; none where there is no map, or no disc of it is significant. chi2 in them is what is left of the map's
    sum of squares.
    """
    settings = settings or MapSettings()
    if not _can_be_mapped(hypothesis):
        return []
    cut = _shortest(parent.context, settings.windows)
    if cut is None:
        return []
    states = profile.start_states(cut.context.design)
    ground = cut.context.fit(parent.hypothesis, parent.values, states, iterations=settings.iterations)
    found = strength_map(ground, hypothesis, settings)
    own = hypothesis.parts[-1].variant.unknowns
    at = {u.name: i for i, u in enumerate(own)}
    axes = [at[name] for name in "xyz" if name in at]
    radius = own[at["radius"]]
    kept = []
    for low, high in pairwise(np.clip(np.array(settings.bands) * radius.typical, radius.lower, radius.upper)):
        if low < high:
            kept += _discs(found, [(own[i].lower, own[i].upper) for i in axes], (float(low), float(high)))
    total = float(found.weight @ found.strength**2)
    asked = sorted((row for row in kept if row[0] > settings.sure**2), key=lambda row: -float(row[0]))
    return [_start(ground.values, hypothesis, row, axes, at, total, settings.damped) for row in asked]


def _discs(found: StrengthMap, places: list[tuple[float, float]], radii: tuple[float, float]) -> list[Array]:
    """Search the best few discs within bounds (Storn & Price 1997): rows of gain, strength, centre and radius."""
    seen: list[Array] = []

    def left(discs: Array) -> Array:
        centres, sizes = discs[:-1].T, np.exp(discs[-1])
        gain, strength = found.gain(centres, sizes)
        seen.append(np.column_stack([gain, strength, centres, sizes]))
        return -gain

    differential_evolution(
        left,
        [*places, (float(np.log(radii[0])), float(np.log(radii[1])))],
        popsize=found.settings.population,
        maxiter=found.settings.generations,
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


def _start(
    before: Array, hypothesis: Hypothesis, row: Array, axes: list[int], at: dict[str, int], total: float, damped: float
) -> ScoreTestStart:
    variant = hypothesis.parts[-1].variant
    values = np.array([u.start for u in variant.unknowns])
    values[axes], values[at["radius"]] = row[2:-1], row[-1]
    unknown = variant.unknowns[at[str(variant.strength)]]
    values[at[unknown.name]] = np.clip(damped * row[1], unknown.lower, unknown.upper)
    return ScoreTestStart(hypothesis, np.concatenate([before, values]), total - float(row[0]))
