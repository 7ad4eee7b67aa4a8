"""The force that no effect explains, described: on the base alone, or beside those effects found that are no force.

A torque on the spin, a bounce, a fault of the observer cannot be written as an acceleration. Where one of them is
there too, the base alone is so far from the data that the law found is bent to it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from polyworld.estimation import profile
from polyworld.estimation.criteria import extended_bic
from polyworld.estimation.forward import Forward
from polyworld.estimation.hypothesis import Hypothesis, Part, without_part
from polyworld.estimation.trial import FittedHypothesis
from polyworld.gap.unexplained import MAX_TERMS, Near, ResidualForce, describe_unexplained

ITERATIONS = 8  # on windows, of what is kept
FURTHER = 0.25  # of the integration steps of a search, for the second one


def described(
    ground: FittedHypothesis,
    best: FittedHypothesis | None,
    near: Near | None,
    *,
    most_terms: int = MAX_TERMS,
    cancelled: Callable[[], bool] | None = None,
) -> ResidualForce:
    """The law of the force that is missing, as `describe_unexplained` finds it.

    ground: the base, fitted. best: the hypothesis that came nearest, under the same noise. near: the base on windows.
    """
    alone = _law(ground, near, most_terms, 1.0, cancelled)
    kept = None if best is None or alone.explains else _without_forces(ground, best)
    if kept is None:
        return alone
    if near is not None and not near.windows.holds(kept.hypothesis):
        near = None
    if near is not None:
        bench = near.windows.bench.with_noise(near.noise)
        own = bench.fit(kept.hypothesis, kept.values, near.fit.states, iterations=ITERATIONS)
        near = replace(near, fit=own.fit)
    beside = replace(_law(kept, near, most_terms, FURTHER, cancelled), beside=kept.hypothesis.names)
    return beside if beside.explains or law_ebic(beside, kept) < law_ebic(alone, ground) else alone


def law_ebic(force: ResidualForce, trial: FittedHypothesis) -> float:
    """EBIC of a law on top of a trial, under the trial's noise; that of the trial where there is no law."""
    bench, extra = trial.bench, trial.hypothesis.extra
    if force.world is None:
        return extended_bic(trial.chi2, extra, bench.observations, 0, 1)
    forward = Forward(bench.design, force.world, ())
    whole = len(force.fit.states) == len(bench.design.runs)  # or the law was found on windows, and on no whole runs
    fit = profile.fit(forward, bench.noise, np.zeros(0), force.fit.states if whole else trial.fit.states, iterations=4)
    return extended_bic(fit.chi2, extra + len(force.numbers), bench.observations, 0, 1)


def _law(
    trial: FittedHypothesis, near: Near | None, most_terms: int, budget: float, cancelled: Callable[[], bool] | None
) -> ResidualForce:
    return describe_unexplained(
        trial.bench.design,
        trial.bench.noise,
        trial.hypothesis.unknowns,
        trial.fit,
        world=trial.hypothesis.world.with_substep(trial.bench.design.world.time.substep),
        most_terms=most_terms,
        near=near,
        budget=budget,
        cancelled=cancelled,
    )


def _without_forces(ground: FittedHypothesis, best: FittedHypothesis) -> FittedHypothesis | None:
    """The best hypothesis less its forces, fitted; None where nothing is left of it."""
    hypothesis, values = best.hypothesis, best.values
    recording = best.bench.design.recording
    base = Hypothesis(best.bench.design.world, best.hypothesis.base)
    while any(_is_force(p) for p in hypothesis.parts):
        index = next(i for i, p in enumerate(hypothesis.parts) if _is_force(p))
        less = without_part(base, hypothesis, index, values, recording)
        if less is None:
            return None
        hypothesis, values = less
    if not hypothesis.parts:
        return None
    ways = [best.bench.fit(hypothesis, values, states) for states in (best.fit.states, ground.fit.states)]
    return min(ways, key=lambda t: t.chi2)


def _is_force(part: Part) -> bool:
    """Whether an effect could be written as an acceleration of the bodies."""
    return part.candidate.group == "force" and not part.candidate.torque
