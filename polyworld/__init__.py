"""Worlds in, trajectories and events out.

Describe a `World`, find `overlaps` at its start, `rollout` it or drive it with a `stepper`, `branch` it by
interventions, `compare` the rollouts, `query` them. From data: `read_recording`, `fit` a `Study`, `find_gap`.

Rooms from the ground up: `core` (arrays of Warp) and `executors` (bags of independent pieces), `effects` (one law a
file; add an effect there) and `expressions`, `world` (descriptions; `world.materials` is the registry), `model`
(meshes), `edits` (interventions), `trajectory`, `solver` (planar, spatial, coupled and the materials'), `probing`
(predicates, readouts, comparison), `data` (recordings), `screening`, `estimation` (fits), `gap` (what is missing;
`gap.choose` decides), `pictures`, and `materials` (one entry a material; add a deformable there).
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from polyworld.data.recording import Recording
    from polyworld.data.recording_csv import read_recording
    from polyworld.edits.interventions import Intervention, branch
    from polyworld.estimation.fit import FitOptions, fit
    from polyworld.estimation.study import Study, StudyRun
    from polyworld.gap.method import find_gap
    from polyworld.gap.report import GapReport
    from polyworld.pictures.motion import plot
    from polyworld.probing.compare import Comparison, compare
    from polyworld.probing.overlaps import Overlap, overlaps
    from polyworld.probing.predicates import Predicate
    from polyworld.probing.query import QueryResult, query
    from polyworld.solver.core.saved_state import SavedState
    from polyworld.solver.rollout import Simulator, predicted_cost, rollout, simulator, state_at
    from polyworld.solver.stepper import Control, Stepper, stepper
    from polyworld.trajectory import BatchTrajectory, Event, Rollout, Trajectory
    from polyworld.world import World

__all__ = [
    "BatchTrajectory",
    "Comparison",
    "Control",
    "Event",
    "FitOptions",
    "GapReport",
    "Intervention",
    "Overlap",
    "Predicate",
    "QueryResult",
    "Recording",
    "Rollout",
    "SavedState",
    "Simulator",
    "Stepper",
    "Study",
    "StudyRun",
    "Trajectory",
    "World",
    "branch",
    "compare",
    "find_gap",
    "fit",
    "overlaps",
    "plot",
    "predicted_cost",
    "query",
    "read_recording",
    "rollout",
    "simulator",
    "state_at",
    "stepper",
]

# Imported when they are asked for: a server that has only been asked what it can do needs none of them.
_HOMES = {
    "polyworld.data.recording": ("Recording",),
    "polyworld.data.recording_csv": ("read_recording",),
    "polyworld.edits.interventions": ("Intervention", "branch"),
    "polyworld.estimation.fit": ("FitOptions", "fit"),
    "polyworld.estimation.study": ("Study", "StudyRun"),
    "polyworld.gap.method": ("find_gap",),
    "polyworld.gap.report": ("GapReport",),
    "polyworld.pictures.motion": ("plot",),
    "polyworld.probing.compare": ("Comparison", "compare"),
    "polyworld.probing.overlaps": ("Overlap", "overlaps"),
    "polyworld.probing.predicates": ("Predicate",),
    "polyworld.probing.query": ("QueryResult", "query"),
    "polyworld.solver.core.saved_state": ("SavedState",),
    "polyworld.solver.rollout": ("Simulator", "predicted_cost", "rollout", "simulator", "state_at"),
    "polyworld.solver.stepper": ("Control", "Stepper", "stepper"),
    "polyworld.trajectory": ("BatchTrajectory", "Event", "Rollout", "Trajectory"),
    "polyworld.world": ("World",),
}


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(home), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
