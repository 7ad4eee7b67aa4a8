"""Pictures of a world: its forms at one moment, rays cast at them, liquids and shadows laid over.

Read `render` first, then `scene` and `raycast`; each material's form is one function in `deformable_pictures`.
"""
