"""The planar rigid solver: one thread a world, `step.py` is the page that reads like the algorithm."""

from polyworld.solver.planar.simulator import PlanarSimulator

__all__ = ["PlanarSimulator"]
