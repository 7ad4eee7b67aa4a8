"""The planar rigid solver: one thread a world, the whole rollout inside one kernel."""

from polyworld.solver.planar.simulator import PlanarSimulator

__all__ = ["PlanarSimulator"]
