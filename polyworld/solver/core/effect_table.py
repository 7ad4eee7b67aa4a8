"""The enabled effects of worlds as kernels read them."""

import warp as wp

from polyworld.effects import Vec8


@wp.struct
class Effects:
    """Enabled effects (e,) of worlds of n objects, as in `model.arrays.RigidArrays`.

    kind (e,); acts (e, n): 1 where one acts on an object; parameters (1 or W, e, 8); programs (rows, 4) of expressions.
    """

    kind: wp.array[wp.int32]
    acts: wp.array2d[wp.int32]
    parameters: wp.array3d[wp.float64]
    programs: wp.array2d[wp.float64]


@wp.func
def effect_values(effects: Effects, world: int, e: int) -> Vec8:
    """Return the parameter values of effect e in a world."""
    row = world % effects.parameters.shape[0]
    p = Vec8()
    for k in range(8):
        p[k] = effects.parameters[row, e, k]
    return p
