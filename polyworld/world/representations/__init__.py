"""Describe the physical models of objects: rigid, rope, cloth, soft, fluid.

A new deformable material is described here and joins `Deformable` of `world.world` and `parameter_tables`; it gets its
nodes in `model`, and moved by a `MaterialStage` (`solver.coupled.stage`) that `solver.coupled.assembly` lists.
"""
