"""One page a material: description, mesh, stage, parameters, what is said of it.

`polyworld.world.materials` says what an entry holds, and imports these pages as worlds need them; copy `rope` for a new
one.
"""
