"""Stages of a step without joints: the counterparts of `joint_step`, most of which do nothing."""

import warp as wp

from polyworld.solver.spatial.contact_solve import contact_solver
from polyworld.solver.spatial.impacts import impact_solver, kinetic_energy
from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.layout import State
from polyworld.solver.spatial.step import Joining


@wp.func
def hold(_joints: wp.array[Joints], _state: wp.array[State], _k: int, _h: wp.float64, _contacts: int) -> wp.float64:
    return wp.float64(0.0)


@wp.func
def energy(_joints: wp.array[Joints], state: wp.array[State], k: int, a: int, b: int) -> wp.float64:
    return kinetic_energy(state[0].bodies[k, a]) + kinetic_energy(state[0].bodies[k, b])


@wp.func
def undo_joints(_joints: wp.array[Joints], _state: wp.array[State], _k: int) -> None:
    pass


@wp.func
def solve_velocities(_joints: wp.array[Joints], _state: wp.array[State], _k: int, _lock: wp.vec3d) -> None:
    pass


@wp.func
def all_left(
    _joints: wp.array[Joints], _state: wp.array[State], _k: int, _h: wp.float64, left: wp.float64
) -> wp.float64:
    return left


@wp.func
def whole(_joints: wp.array[Joints], _state: wp.array[State], _k: int, h: wp.float64) -> wp.float64:
    return h


@wp.func
def begin(_joints: wp.array[Joints], _state: wp.array[State], _k: int, _time: wp.float64, _h: wp.float64) -> None:
    pass


@wp.func
def carries(_joints: wp.array[Joints], _i: int) -> bool:
    return False


@wp.func
def finish(
    _joints: wp.array[Joints], _state: wp.array[State], _k: int, _half: int, _h: wp.float64, _lock: wp.vec3d
) -> None:
    pass


solve_manifolds, solve_contacts = contact_solver(hold, accelerated=True)

FREE = Joining(
    solve_velocities=solve_velocities,
    longest_part=all_left,
    time_to_stop=whole,
    resolve_impacts=impact_solver(solve_manifolds, energy, undo_joints),
    begin=begin,
    solve=solve_contacts,
    carries=carries,
    finish=finish,
    early=0.25,
)
