"""Where an effect with an edge may sit, from how strong it would have to be in every short stretch of the paths.

Made to act everywhere, an effect moves every window; the score test (Rao 1948) tells, window by window, what strength
that asks for. A disc that holds the windows that ask for much, and none of those that ask for nothing, is where a fit
begins. Trajectories themselves do not lead there: they feel an edge only where a path crosses it, so chi2 as a function
of the place is flat in one stretch and jumps in the next.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from polyworld.discrepancy import profile
from polyworld.discrepancy.hypothesis import Hypothesis
from polyworld.discrepancy.score import Lead
from polyworld.discrepancy.trial import Trial
from polyworld.discrepancy.windows import windows

Array = NDArray[np.float64]

GROUND_ITERATIONS = 4  # so short a window is nearly straight
SURE = 4.0  # standard deviations by which a window asks for an effect
ROUGH = 0.3  # of a usual strength, that slopes misjudge: a grip ends the slide that it acts on
FILLED = 0.4  # of a window that has to lie inside for the effect to show there in full
POPULATION, GENERATIONS, SEED = 40, 60, 1977  # of the search for discs (Storn & Price 1997)
SAMPLES = 8  # of each window, by which it is told how much of it lies inside
KEPT = 8  # discs to begin with
APART = 1.0  # of a typical change, by which these differ


@dataclass(frozen=True)
class StrengthMap:
    """What windows ask for: strength (W,), its weight (W,), and places (W, T, D) on them, D the axes of a disc.

    Weights allow for the roughness of the slope, so that no single window outweighs many.
    """

    strength: Array
    weight: Array
    places: Array

    def gain(self, centres: Array, radii: Array) -> tuple[Array, Array]:
        """For K discs with centres (K, D) and radii (K,): the fall (K,) of the weighted sum of squares if the effect
        acts in there and nowhere else, and the strength (K,) at which it falls so much."""
        beside = self.places[None] - centres[:, None, None]
        within = np.einsum("kwtd,kwtd->kwt", beside, beside) < (radii**2)[:, None, None]
        part = np.minimum(within.mean(axis=2) / FILLED, 1.0)
        information = part**2 @ self.weight
        strength = part @ (self.weight * self.strength) / np.maximum(information, 1e-300)
        return information * strength**2, strength


def strength_map(ground: Trial, hypothesis: Hypothesis) -> StrengthMap | None:
    """The map of the last effect of a hypothesis over windows that a trial without it was fitted to.

    None where it cannot be drawn, or no window asks for the effect.
    """
    design = ground.bench.design
    variant = hypothesis.parts[-1].variant
    if variant.everywhere is None or variant.strength is None or not _drawn(hypothesis):
        return None
    start = {u.name: u.start for u in variant.unknowns} | dict(variant.everywhere)
    values = np.concatenate([ground.values, [start[u.name] for u in variant.unknowns]])
    column = len(ground.values) + [u.name for u in variant.unknowns].index(variant.strength)
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
        sampled = np.linspace(0, len(r.run.times) - 1, SAMPLES).round().astype(int)
        places.append(r.run.positions[sampled, 0][:, axes])
    information = np.maximum(information, 1e-300)
    strength = -slope / information
    sure = np.abs(slope) > SURE * np.sqrt(information)
    if not sure.any():
        return None
    usual = float(np.median(np.abs(strength[sure])))
    return StrengthMap(strength, 1.0 / (1.0 / information + (ROUGH * usual) ** 2), np.array(places))


def _drawn(hypothesis: Hypothesis) -> bool:
    """Whether the last effect can be made to act everywhere, and one body moves, so that a window is at one place."""
    return hypothesis.parts[-1].variant.everywhere is not None and len(hypothesis.world.moving_names) == 1


def mapped(parent: Trial, hypothesis: Hypothesis) -> list[Lead]:
    """Leads to a hypothesis that adds an effect with an edge to a trial, from its map over the shortest windows; best
    first, none where there is no map. chi2 in them is what is left of the map's sum of squares."""
    if not _drawn(hypothesis):
        return []
    cut = windows(parent.bench, max(len(r.times) for r in parent.bench.design.runs))
    if cut is None:
        return []
    states = profile.start_states(cut.bench.design)
    ground = cut.bench.fit(parent.hypothesis, parent.values, states, iterations=GROUND_ITERATIONS)
    found = strength_map(ground, hypothesis)
    if found is None:
        return []
    own = hypothesis.parts[-1].variant.unknowns
    at = {u.name: i for i, u in enumerate(own)}
    axes = [at[name] for name in "xyz" if name in at]
    radius = own[at["radius"]]
    bounds = [(own[i].lower, own[i].upper) for i in axes] + [(np.log(radius.lower), np.log(radius.upper))]
    seen: list[Array] = []  # rows of gain, strength, centre and radius

    def left(discs: Array) -> Array:
        places, sizes = discs[:-1].T, np.exp(discs[-1])
        gain, strength = found.gain(places, sizes)
        seen.append(np.column_stack([gain, strength, places, sizes]))
        return -gain

    differential_evolution(
        left,
        bounds,
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
    typical = np.array([*(own[i].typical for i in axes), radius.typical])
    total = float(found.weight @ found.strength**2)
    kept: list[Array] = []
    for row in rows[np.argsort(-rows[:, 0], kind="stable")]:
        if all(float(np.max(np.abs(row[2:] - other[2:]) / typical)) > APART for other in kept):
            kept.append(row)
        if len(kept) == KEPT:
            break
    return [_lead(parent, hypothesis, row, axes, at, total) for row in kept]


def _lead(parent: Trial, hypothesis: Hypothesis, row: Array, axes: list[int], at: dict[str, int], total: float) -> Lead:
    variant = hypothesis.parts[-1].variant
    values = np.array([u.start for u in variant.unknowns])
    values[axes], values[at["radius"]] = row[2:-1], row[-1]
    off = values.copy()
    unknown = variant.unknowns[at[str(variant.strength)]]
    values[at[unknown.name]] = np.clip(row[1], unknown.lower, unknown.upper)
    before = parent.values
    return Lead(
        hypothesis, np.concatenate([before, values]), total - float(row[0]), before=np.concatenate([before, off])
    )
