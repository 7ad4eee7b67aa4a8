"""Pictures of a world: ray casting of solids, deformable surfaces and liquids on their camera.

Read `render` first, then `raycast`, `rasterize` and what they shade.
"""
