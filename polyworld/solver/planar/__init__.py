"""The planar rigid solver: one thread a world, one file a stage.

Read `step` first, the page that reads like the algorithm; then `contacts`, `impacts`, `constraints` and `motion`.
"""

from polyworld.solver.planar.simulator import PlanarSimulator

__all__ = ["PlanarSimulator"]
