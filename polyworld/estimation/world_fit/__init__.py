"""Fit a world's unknown numbers until its motion matches one video's tracks and shapes."""

from polyworld.estimation.unknown import Unknown
from polyworld.estimation.world_fit.accuracy import Accuracy, accuracy
from polyworld.estimation.world_fit.cem import CemSettings
from polyworld.estimation.world_fit.default_unknowns import default_unknowns
from polyworld.estimation.world_fit.multistart import Start, in_order, multistart, restarts
from polyworld.estimation.world_fit.objective import Objective, ObjectiveSettings
from polyworld.estimation.world_fit.posterior import PosteriorSample, sample_posterior
from polyworld.estimation.world_fit.problem import FitProblem
from polyworld.estimation.world_fit.refine import refine
from polyworld.estimation.world_fit.result import FitResult, FittedValue, Undetermined
from polyworld.estimation.world_fit.search import SearchProgress, SearchSettings, fit, fit_by_random_search

__all__ = [
    "Accuracy",
    "CemSettings",
    "FitProblem",
    "FitResult",
    "FittedValue",
    "Objective",
    "ObjectiveSettings",
    "PosteriorSample",
    "SearchProgress",
    "SearchSettings",
    "Start",
    "Undetermined",
    "Unknown",
    "accuracy",
    "default_unknowns",
    "fit",
    "fit_by_random_search",
    "in_order",
    "multistart",
    "refine",
    "restarts",
    "sample_posterior",
]
