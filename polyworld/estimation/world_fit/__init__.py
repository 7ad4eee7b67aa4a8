"""Fit a world's unknown numbers until its motion matches one video's tracks and shapes."""

from polyworld.estimation.cem import CemSettings
from polyworld.estimation.support import supports, with_supports
from polyworld.estimation.unknown import Unknown
from polyworld.estimation.world_fit.accuracy import Accuracy, accuracy
from polyworld.estimation.world_fit.alternatives import alternative_minima
from polyworld.estimation.world_fit.bounds import refit_with_wider_bounds
from polyworld.estimation.world_fit.default_unknowns import default_unknowns
from polyworld.estimation.world_fit.determinable import Shown
from polyworld.estimation.world_fit.multistart import Start, in_order, multistart, restarts
from polyworld.estimation.world_fit.objective import Objective, ObjectiveSettings
from polyworld.estimation.world_fit.outlying import Outlying, outlying_frames
from polyworld.estimation.world_fit.plausible import plausible_unknowns
from polyworld.estimation.world_fit.posterior import PosteriorSample, sample_posterior
from polyworld.estimation.world_fit.prefixes import fit_by_prefixes
from polyworld.estimation.world_fit.problem import DescentStep, FitProblem
from polyworld.estimation.world_fit.refine import refine
from polyworld.estimation.world_fit.release import release_shared
from polyworld.estimation.world_fit.resistance import Tested, choose_resistance, laws_of_resistance
from polyworld.estimation.world_fit.result import FitResult, FittedValue, Undetermined
from polyworld.estimation.world_fit.search import SearchProgress, SearchSettings, fit, fit_by_random_search
from polyworld.estimation.world_fit.settings import (
    OrdinarySettings,
    PrefixSettings,
    ResistanceSettings,
    SupportSettings,
    WideningSettings,
)
from polyworld.estimation.world_fit.support_constraints import support_constraints

__all__ = [
    "Accuracy",
    "CemSettings",
    "DescentStep",
    "FitProblem",
    "FitResult",
    "FittedValue",
    "Objective",
    "ObjectiveSettings",
    "OrdinarySettings",
    "Outlying",
    "PosteriorSample",
    "PrefixSettings",
    "ResistanceSettings",
    "SearchProgress",
    "SearchSettings",
    "Shown",
    "Start",
    "SupportSettings",
    "Tested",
    "Undetermined",
    "Unknown",
    "WideningSettings",
    "accuracy",
    "alternative_minima",
    "choose_resistance",
    "default_unknowns",
    "fit",
    "fit_by_prefixes",
    "fit_by_random_search",
    "in_order",
    "laws_of_resistance",
    "multistart",
    "outlying_frames",
    "plausible_unknowns",
    "refine",
    "refit_with_wider_bounds",
    "release_shared",
    "restarts",
    "sample_posterior",
    "support_constraints",
    "supports",
    "with_supports",
]
