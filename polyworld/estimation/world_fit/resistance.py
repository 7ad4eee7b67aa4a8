"""Choose further laws of resistance by evidence: joints' dry friction and damping, viscous and quadratic resistance.

Sliding friction and rolling resistance are fitted anyway. Every further law is at zero in the fit without it; a score
test (Rao 1948) predicts from its derivative there by how much chi-square would fall, the other unknowns adjusted. Those
of enough predicted gain are fitted, since far from zero their order may be another, and the best is kept where twice
the log-likelihood grows by more than the logarithm of the number of observations (Schwarz 1978); laws kept before that
are no longer worth that much are dropped. Until none is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.unknown import Unknown
from polyworld.estimation.world_fit.determinable import Shown
from polyworld.estimation.world_fit.multistart import Start
from polyworld.estimation.world_fit.plausible import joint_unknowns
from polyworld.estimation.world_fit.problem import FitProblem
from polyworld.estimation.world_fit.refine import GOOD, descend
from polyworld.estimation.world_fit.result import Status
from polyworld.estimation.world_fit.search import Cancelled
from polyworld.estimation.world_fit.settings import ResistanceSettings
from polyworld.world import Effect, World
from polyworld.world.parameters import specification

Array = NDArray[np.float64]

AIR = "air_resistance"


@dataclass(frozen=True)
class Law:
    """A candidate: what it is called, the world that has it, at zero, and its unknown."""

    name: str
    world: World
    unknown: Unknown


@dataclass(frozen=True)
class Tested:
    """A law that was tested. gain: fall of chi-square, predicted, or fitted where it was fitted; needed: to be kept."""

    name: str
    gain: float
    needed: float
    kept: bool


def laws_of_resistance(
    world: World, tracks: ObservedTracks, taken: set[str], settings: ResistanceSettings | None = None
) -> list[Law]:
    """Return laws that a spatial world of rigid bodies may have beside friction and rolling resistance.

    taken: paths that are fitted already.
    """
    beyond = (settings or ResistanceSettings()).beyond
    shown = Shown(world, tracks)
    moving = tuple(name for name in shown.begins if shown.states[name].moves)
    if not moving:
        return []
    found = [Law(u.name, world, u) for u in joint_unknowns(world, tracks) if u.paths[0] not in taken]
    paths = tuple(f"objects.{o.name}.linear_damping" for o in world.objects)
    if not taken & set(paths) and not any(world.object(n).linear_damping for n in moving):
        found.append(Law("linear_damping", world, _at_zero("linear_damping", world, paths, beyond)))
    drags = ("quadratic_damping", "quadratic_drag", "linear_drag")
    if not any(effect.kind in drags for effect in world.effects):
        air = Effect(name=AIR, kind="quadratic_damping", parameters={"rate": 0.0})
        with_air = world.model_copy(update={"effects": (*world.effects, air)})
        found.append(Law("quadratic_damping", with_air, _at_zero(AIR, with_air, (f"effects.{AIR}.rate",), beyond)))
    return found


def choose_resistance(
    problem: FitProblem,
    start: Start,
    laws: Sequence[Law],
    *,
    settings: ResistanceSettings | None = None,
    cancelled: Cancelled | None = None,
) -> tuple[FitProblem, Start, tuple[Tested, ...]]:
    """Add laws to a fit while the evidence asks for them, and drop those that a later one makes needless.

    Returns the problem and fit that has them.
    """
    settings = settings or ResistanceSettings()
    first = start.best
    if first.status != "completed":
        return problem, start, ()
    refitted = partial(_fitted, problem, settings.iterations, cancelled)
    needed = float(np.log(max(_count(problem), 2)))
    best = _Fitted((), problem, problem.space.coordinates(first.by_name), first.loss)
    tested: dict[str, Tested] = {}
    while cancelled is None or not cancelled():
        left = [law for law in laws if law.name not in best.names]
        trials: list[_Fitted] = []
        for law, gain in zip(left, _predicted(problem, best, left, settings.step), strict=True):
            tested[law.name] = Tested(law.name, gain, needed, False)
            if gain >= settings.worth_fitting * needed:
                trials.append(refitted(best, (*best.laws, law)))
                tested[law.name] = Tested(law.name, _gain(best, trials[-1]), needed, False)
        deepest = max((_gain(best, trial) for trial in trials), default=0.0)
        if deepest <= needed:
            break
        # Of laws that explain about the same, the first listed is the more ordinary one.
        found = next(trial for trial in trials if _gain(best, trial) >= deepest - needed)
        tested[found.laws[-1].name] = Tested(found.laws[-1].name, _gain(best, found), needed, True)
        for law in best.laws:
            without = refitted(found, tuple(o for o in found.laws if o is not law))
            if _gain(without, found) <= needed:
                tested[law.name] = Tested(law.name, _gain(without, found), needed, False)
                found = without
        if found.loss >= best.loss:
            break
        best = found
    if best.laws:
        best.problem.begin()
        result = best.problem.finish("prefixes", best.status, best.at, None, first.history, first.seed)
        start = Start(start.searched, result)
    return best.problem, start, tuple(tested.values())


@dataclass(frozen=True)
class _Fitted:
    """A fit, at search coordinates `at` (P,), that has some laws beside those of the problem without any."""

    laws: tuple[Law, ...]
    problem: FitProblem
    at: Array
    loss: float
    status: Status = "completed"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its laws."""
        return tuple(law.name for law in self.laws)

    @property
    def noise(self) -> float:
        """Variance of the residuals it leaves, in units of the stated one, and at least that."""
        return max(self.loss, 1.0)

    @property
    def values(self) -> dict[str, float]:
        """Values by name."""
        found = self.problem.space.values(self.at)
        return {u.name: float(v) for u, v in zip(self.problem.space.unknowns, found, strict=True)}


def _gain(few: _Fitted, many: _Fitted) -> float:
    """Twice the difference of log-likelihoods.

    The variance of the noise is the stated one where a fit comes below it, and what the fit leaves where it does not.
    """
    misfits = [fit.loss - 1.0 if fit.loss < 1.0 else float(np.log(fit.loss)) for fit in (few, many)]
    return _count(many.problem) * (misfits[0] - misfits[1])


def _with_laws(problem: FitProblem, laws: Sequence[Law]) -> FitProblem:
    own = {effect.name for effect in problem.world.effects}
    effects = {e.name: e for law in laws for e in law.world.effects if e.name not in own}
    world = problem.world.model_copy(update={"effects": (*problem.world.effects, *effects.values())})
    return problem.with_unknowns((*problem.space.unknowns, *(law.unknown for law in laws)), world)


def _fitted(
    problem: FitProblem, iterations: int, cancelled: Cancelled | None, before: _Fitted, laws: tuple[Law, ...]
) -> _Fitted:
    """Refit with other laws from the values before; problem: the one without any law."""
    wider = _with_laws(problem, laws)
    values = {u.name: before.values.get(u.name, u.start) for u in wider.space.unknowns}
    at = wider.space.coordinates(values)
    at, _, status = descend(wider, at, wider.samples, iterations=iterations, enough=GOOD, cancelled=cancelled)
    return _Fitted(laws, wider, at, wider.loss(at), status)


def _predicted(problem: FitProblem, best: _Fitted, laws: Sequence[Law], step: float) -> list[float]:
    """Return falls of chi-square by the score test of each law at zero, in units of the noise that the fit leaves."""
    if not laws:
        return []
    base, at = best.problem, best.at
    root = np.sqrt(base.huber_weights(at))
    residual = root * base.residuals(at[None])[0]
    others = base.difference_quotients(at, step * base.space.width) * base.space.width * root[:, None]
    ridge = np.vstack([others, 1e-6 * np.eye(others.shape[1])])
    found = []
    for law in laws:
        wider = _with_laws(problem, (*best.laws, law))
        values = best.values | {law.unknown.name: law.unknown.start}
        width, last = wider.space.width, np.arange(len(wider.space.width)) == len(wider.space.width) - 1
        quotients = wider.difference_quotients(wider.space.coordinates(values), step * width, only=last)
        own = quotients[:, -1] * width[-1] * root
        target = np.concatenate([own, np.zeros(others.shape[1])])
        adjusted = own - others @ np.linalg.lstsq(ridge, target, rcond=None)[0]
        size, score = float(adjusted @ adjusted), -float(adjusted @ residual)
        shows = size > 1e-12 * float(own @ own) and score > 0.0
        found.append(score**2 / size / best.noise if shows else 0.0)
    return found


def _count(problem: FitProblem) -> float:
    return problem.objective.weight(problem.samples)


def _at_zero(name: str, world: World, paths: tuple[str, ...], beyond: float) -> Unknown:
    spec = specification(world, paths[0])
    usual = spec.search[1]
    return Unknown(name, paths, spec.unit, 0.0, 0.0, min(beyond * usual, spec.upper), 0.25 * usual)
