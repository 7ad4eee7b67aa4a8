"""From a world to its motion: one solver for planar, one for spatial rigid bodies, one for coupled materials.

Read `rollout` first (which solver runs what), then `core.simulator` and the `simulator` and `step` of planar, spatial,
coupled.
"""
