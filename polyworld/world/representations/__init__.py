"""Describe the physical models of objects: rigid, rope, cloth, soft, fluid.

A new deformable material is one entry of the registry, `polyworld.world.materials`: its description, mesh, stage and
the rest; `polyworld.materials.rope` is one to copy.
"""
