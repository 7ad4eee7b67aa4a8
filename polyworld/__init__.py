"""Worlds in, trajectories and events out.

Describe a `World`, `rollout` it, `branch` it by interventions, `compare` the rollouts, `query` them.

Rooms from the ground up: `core` (arrays of Warp), `effects` (one law a file; add an effect there) and `expressions`,
`world` (descriptions; `world.materials` is the registry), `model` (meshes), `edits` (interventions), `trajectory`,
`solver` (planar, spatial, coupled and the materials'), `probing` (predicates, readouts, comparison), `data`
(recordings), `screening`, `estimation` (fits), `gap` (what is missing; `gap.ebic` decides), `pictures`, and `materials`
(one entry a material; add a deformable there).
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
