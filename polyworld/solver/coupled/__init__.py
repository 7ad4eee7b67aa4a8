"""The coupled solver: rigid bodies, ropes, cloth, soft bodies and fluids in one scene.

Read `step` first, one coupled step launch by launch; then `stage` (what a material provides), `assembly` (which are
there), `shard` (worlds and buffers of a thread) and `simulator`.
"""
