"""System identification: fit a world's unknown numbers until its motion matches the observed one."""

from polyworld.identification.accuracy import Accuracy, accuracy, trajectory_rmse
from polyworld.identification.cem import CemSettings
from polyworld.identification.default_parameters import default_parameters
from polyworld.identification.determinable import reasons_undeterminable
from polyworld.identification.fit import FitProgress, FitSettings, fit, fit_by_random_search
from polyworld.identification.free_parameters import FitParameter
from polyworld.identification.multistart import MultistartSettings, Start, fit_refined
from polyworld.identification.objective import Objective, ObjectiveSettings
from polyworld.identification.refine import RefineSettings, refine
from polyworld.identification.result import FitResult, FittedValue, LossPoint, Undetermined

__all__ = [
    "Accuracy",
    "CemSettings",
    "FitParameter",
    "FitProgress",
    "FitResult",
    "FitSettings",
    "FittedValue",
    "LossPoint",
    "MultistartSettings",
    "Objective",
    "ObjectiveSettings",
    "RefineSettings",
    "Start",
    "Undetermined",
    "accuracy",
    "default_parameters",
    "fit",
    "fit_by_random_search",
    "fit_refined",
    "reasons_undeterminable",
    "refine",
    "trajectory_rmse",
]
