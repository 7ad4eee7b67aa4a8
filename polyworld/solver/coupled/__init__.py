"""The coupled solver: rigid bodies, ropes, cloth, soft bodies and fluids in one scene.

Read `stage` (what a material provides), `assembly` (which are there), `shard` (a step of all of them) and `simulator`.
"""
