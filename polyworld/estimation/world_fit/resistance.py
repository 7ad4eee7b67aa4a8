"""Choose further laws of resistance by evidence: joints' dry friction and damping, viscous and quadratic resistance.

Sliding friction and rolling resistance are fitted anyway. Every further law is at zero in the fit without it; a score
test (Rao 1948) predicts from its derivative there by how much chi-square would fall, the other unknowns adjusted. The
best is fitted and kept where chi-square falls by more than the logarithm of the number of observations (Schwarz 1978),
until none is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.unknown import Unknown
from polyworld.estimation.world_fit.determinable import Shown
from polyworld.estimation.world_fit.multistart import Start
from polyworld.estimation.world_fit.plausible import joint_unknowns
from polyworld.estimation.world_fit.problem import FitProblem
from polyworld.estimation.world_fit.refine import descend
from polyworld.estimation.world_fit.search import Cancelled
from polyworld.parameters import specification
from polyworld.tracks import ObservedTracks
from polyworld.world import Effect, World

Array = NDArray[np.float64]

AIR = "air_resistance"
ITERATIONS = 6
STEP = 2e-3  # of a law's range, by which its derivative at zero is taken
PROMISING = 0.5  # share of the needed fall that a score test must predict: it is linear, and errs on the low side


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


def laws_of_resistance(world: World, tracks: ObservedTracks, taken: set[str]) -> list[Law]:
    """Laws that a spatial world of rigid bodies may have beside friction and rolling resistance.

    taken: paths that are fitted already.
    """
    shown = Shown(world, tracks)
    moving = tuple(name for name in shown.begins if shown.states[name].moves)
    if not moving:
        return []
    found = [Law(u.name, world, u) for u in joint_unknowns(world, tracks) if u.paths[0] not in taken]
    paths = tuple(f"objects.{o.name}.linear_damping" for o in world.objects)
    if not taken & set(paths) and not any(world.object(n).linear_damping for n in moving):
        found.append(Law("linear_damping", world, _at_zero("linear_damping", world, paths)))
    drags = ("quadratic_damping", "quadratic_drag", "linear_drag")
    if not any(effect.kind in drags for effect in world.effects):
        air = Effect(name=AIR, kind="quadratic_damping", parameters={"rate": 0.0})
        with_air = world.model_copy(update={"effects": (*world.effects, air)})
        found.append(Law("quadratic_damping", with_air, _at_zero(AIR, with_air, (f"effects.{AIR}.rate",))))
    return found


def choose_resistance(
    problem: FitProblem, start: Start, laws: Sequence[Law], *, cancelled: Cancelled | None = None
) -> tuple[FitProblem, Start, tuple[Tested, ...]]:
    """Add laws to a fit one by one while the evidence asks for them; returns the problem and fit that has them."""
    tested: list[Tested] = []
    left = list(laws)
    needed = float(np.log(max(_count(problem), 2)))
    while left and start.best.status == "completed" and not (cancelled is not None and cancelled()):
        gains = [_predicted(problem, start, law) for law in left]
        # Of laws that explain about the same, the first listed is the more ordinary one.
        best = next(i for i, gain in enumerate(gains) if gain >= max(gains) - needed)
        if gains[best] < PROMISING * needed:
            tested += [Tested(law.name, gain, needed, False) for law, gain in zip(left, gains, strict=True)]
            break
        law = left.pop(best)
        wider = _with_law(problem, law)
        values = start.best.by_name | {law.unknown.name: law.unknown.start}
        wider.begin()
        at, history, status = descend(
            wider, wider.space.coordinates(values), wider.samples, iterations=ITERATIONS, cancelled=cancelled
        )
        gain = _chi_square(problem, start.best.loss) - _chi_square(wider, wider.loss(at))
        kept = gain > needed
        tested.append(Tested(law.name, gain, needed, kept))
        if kept:
            problem = wider
            start = Start(start.searched, wider.finish("prefixes", status, at, None, history, start.best.seed))
            left = [_upon(problem.world, other) for other in left]
    return problem, start, tuple(tested)


def _upon(world: World, law: Law) -> Law:
    """A law in a world that has been given others since."""
    own = {effect.name for effect in world.effects}
    missing = [effect for effect in law.world.effects if effect.name not in own]
    return Law(law.name, world.model_copy(update={"effects": (*world.effects, *missing)}), law.unknown)


def _with_law(problem: FitProblem, law: Law) -> FitProblem:
    return problem.with_unknowns((*problem.space.unknowns, law.unknown), law.world)


def _predicted(problem: FitProblem, start: Start, law: Law) -> float:
    """Fall of chi-square by the score test of a law at zero, in units of the noise that the fit leaves."""
    wider = _with_law(problem, law)
    space = wider.space
    at = space.coordinates(start.best.by_name | {law.unknown.name: law.unknown.start})
    jacobian = wider.difference_quotients(at, STEP * space.width) * space.width
    root = np.sqrt(wider.huber_weights(at))
    residual = root * wider.residuals(at[None])[0]
    weighted = jacobian * root[:, None]
    others, own = weighted[:, :-1], weighted[:, -1]
    ridge = np.vstack([others, 1e-6 * np.eye(others.shape[1])])
    zero = np.zeros(others.shape[1])
    adjusted = own - others @ np.linalg.lstsq(ridge, np.concatenate([own, zero]), rcond=None)[0]
    size = float(adjusted @ adjusted)
    if size <= 1e-12 * float(own @ own) or size == 0.0:
        return 0.0
    score = -float(adjusted @ residual)
    return score**2 / size / _noise(start) if score > 0.0 else 0.0


def _count(problem: FitProblem) -> float:
    return problem.objective.weight(problem.samples)


def _noise(start: Start) -> float:
    """Variance of the residuals that a fit leaves, at least what the tracks state."""
    return max(start.best.loss, 1.0)


def _chi_square(problem: FitProblem, loss: float) -> float:
    return loss * _count(problem)


def _at_zero(name: str, world: World, paths: tuple[str, ...]) -> Unknown:
    spec = specification(world, paths[0])
    upper = spec.search[1]
    return Unknown(name, paths, spec.unit, 0.0, 0.0, upper, 0.25 * upper)
