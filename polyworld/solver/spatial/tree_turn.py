"""Two steps of bodies on a tree of joints, as far as nothing comes near them."""

import warp as wp

from polyworld.solver.spatial.contacts import find_contacts
from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.joint_step import solve_joint_velocities
from polyworld.solver.spatial.layout import State
from polyworld.solver.spatial.prediction import sweep_bodies
from polyworld.solver.spatial.system import System
from polyworld.solver.spatial.tree_step import move_tree

NEAREST = wp.float64(1.0 / 16.0)  # part of both steps in which a body near by may be passed without a touch


@wp.func(inline=False)
def follow_tree(
    system: System, w: int, k: int, previous_half: int, gravity: wp.vec3d, start: wp.float64, whole: wp.float64
) -> tuple[wp.float64, int]:
    """Move the bodies on in their joints' freedoms by `whole` from time `start`, or by as much as goes.

    Returns by how much [s], and which half of the contact arrays was written last.
    """
    geometry = system.geometry
    joints = system.joints
    state = system.state
    done = wp.float64(0.0)
    half = wp.int32(previous_half)
    if not held_together(joints, state, k, geometry[0].lock):
        return done, half
    part = whole
    while done < whole:
        part = wp.min(part, whole - done)
        half = 1 - half
        sweep_bodies(geometry, state, k, wp.length(gravity) * part, part)
        find_contacts(geometry, state, k, half)
        if state[0].manifold_count[k, half] > 0:
            if part <= NEAREST * whole:
                break
            part = NEAREST * whole
        else:
            gone = move_tree(system.parameters, joints, state, w, k, gravity, start + done, part)
            done += gone
            if gone < part:
                break
            part = wp.float64(2.0) * part
    if done < whole:
        joints[0].tree.known[k] = 0
    return done, half


@wp.func
def held_together(joints: wp.array[Joints], state: wp.array[State], k: int, lock: wp.vec3d) -> bool:
    """Check whether all bodies are active; their joints then hold them."""
    for i in range(state[0].objects):
        if state[0].bodies[k, i].active == 0:
            return False
    for j in range(joints[0].count):
        if joints[0].joint[k, j].active == 0:
            solve_joint_velocities(joints, state, k, lock)
            return True
    return True
