"""Fit a world as it is, its initial states and base unknowns alone, and predict what was left out."""

from __future__ import annotations

from polyworld.data.recording import Recording
from polyworld.estimation.unknown import Unknown
from polyworld.gap.fitting import Fitted, fit
from polyworld.gap.ground import ground_of
from polyworld.gap.held_out import folds_of, predict_left_out
from polyworld.gap.hypothesis import Hypothesis
from polyworld.gap.settings import GapSettings
from polyworld.world import World


def examined(
    world: World, recording: Recording, base: tuple[Unknown, ...] = (), settings: GapSettings | None = None
) -> Fitted:
    """Fit a world to a recording and predict every fold of it. Raises ValueError where the recording does not fit."""
    settings = settings or GapSettings()
    ground = ground_of(world, recording, settings)
    return predicted(fit(ground, Hypothesis(ground.world, base), growing=True, scale=1.0))


def predicted(fitted: Fitted) -> Fitted:
    """Return a fit with what it predicts of every fold without it."""
    predict_left_out(fitted, folds_of(fitted.ground, fitted.ground.settings))
    return fitted
