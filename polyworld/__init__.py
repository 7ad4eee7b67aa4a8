"""Worlds in, trajectories and events out.

Describe a `World`, `rollout` it, `branch` it by interventions, `compare` the rollouts, `query` them.
"""

from polyworld.core import warp_settings
from polyworld.edits.interventions import Intervention, branch
from polyworld.probing.compare import Comparison, compare
from polyworld.probing.predicates import Predicate
from polyworld.probing.query import QueryResult, query
from polyworld.solver.rollout import Simulator, rollout, simulator
from polyworld.trajectory import BatchTrajectory, Event, Rollout, Trajectory
from polyworld.world import World

__all__ = [
    "BatchTrajectory",
    "Comparison",
    "Event",
    "Intervention",
    "Predicate",
    "QueryResult",
    "Rollout",
    "Simulator",
    "Trajectory",
    "World",
    "branch",
    "compare",
    "query",
    "rollout",
    "simulator",
    "warp_settings",
]
