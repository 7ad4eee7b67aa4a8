"""Two steps or more of bodies on a tree of joints, as far as nothing comes near them."""

from typing import Any

import warp as wp

from polyworld.solver.spatial.contacts import find_contacts
from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.joint_step import solve_joint_velocities
from polyworld.solver.spatial.layout import Geometry, Parameters, State
from polyworld.solver.spatial.system import System
from polyworld.solver.spatial.tree_step import move_tree

NEAREST = wp.float64(1.0 / 16.0)  # part of both steps in which a body near by may be passed without a touch
ROUNDING = wp.float64(1.0e-12)  # part of both steps


@wp.func(inline=False)
def follow_tree(
    system: System,
    w: int,
    k: int,
    previous_half: int,
    gravity: wp.vec3d,
    start: wp.float64,
    whole: wp.float64,
    room: wp.float64,
) -> tuple[wp.float64, int]:
    """Move the bodies on in their joints' freedoms by `whole` from time `start`, or by as much as goes.

    By up to `room` where all forces are smooth functions of the motion. Returns by how much [s], and which half of the
    contact arrays was written last.
    """
    geometry = system.geometry
    joints = system.joints
    state = system.state
    done = wp.float64(0.0)
    half = wp.int32(previous_half)
    if not held_together(joints, state, k, geometry[0].lock):
        return done, half
    end = whole
    if smooth_forces(system.parameters, joints, k):
        end = room
    part = joints[0].tree.clear[k]
    if part <= wp.float64(0.0):
        part = whole
    nearest = NEAREST * whole
    while done < end:
        left = end - done
        part = wp.min(part, left)
        wanted = joints[0].tree.wanted[k]
        if wanted > wp.float64(0.0) and part > wanted:
            part = wp.min(wanted, wp.max(wp.float64(0.5) * left, nearest))
        half = 1 - half
        sweep_links(geometry, joints, state, k, wp.length(gravity), part)
        find_contacts(geometry, state, k, half, part)
        if state[0].manifold_count[k, half] > 0:
            if part <= nearest or done >= whole:
                joints[0].tree.clear[k] = wp.min(part, nearest)
                break
            part = wp.max(wp.float64(0.5) * part, nearest)
        else:
            gone = move_tree(system.parameters, joints, state, w, k, gravity, start + done, part, whole)
            if gone <= wp.float64(0.0):
                break
            done += gone
            if end - done < ROUNDING * whole:
                done = end
            part = wp.float64(2.0) * part
            joints[0].tree.clear[k] = part
    if done < whole:
        joints[0].tree.known[k] = 0
    return done, half


@wp.func
def sweep_links(
    geometry: wp.array[Geometry], joints: wp.array[Joints], state: wp.array[State], k: int, g: wp.float64, h: wp.float64
) -> None:
    """Bound how far any point of each body may come within h from where its velocity alone would lead it."""
    for n in range(joints[0].tree.count):
        i = joints[0].tree.kinds[n].body
        turning = wp.length(state[0].bodies[k, i].w) * geometry[0].bound[i]
        state[0].bodies[k, i].swept = h * (turning + h * (g + joints[0].tree.links[k, n].bend))


@wp.func
def smooth_forces(parameters: wp.array[Parameters], joints: wp.array[Joints], k: int) -> bool:
    """Check that no effect, dry friction, stop or motor may set in and end again within a long step."""
    if parameters[0].forces > 0:
        return False
    for j in range(joints[0].count):
        d = joints[0].kinds[j]
        if d.bounded + d.driven > 0 or joints[0].joint[k, j].friction > wp.float64(0.0):
            return False
    return True


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


def following(advance: Any) -> Any:
    """Return the Warp function `advance_far` of the function `advance` for one step."""

    @wp.func
    def advance_far(
        system: System,
        w: int,
        k: int,
        previous_half: int,
        gravity: wp.vec3d,
        start: wp.float64,
        whole: wp.float64,
        room: wp.float64,
    ) -> tuple[int, wp.float64]:
        """Two steps of half the length `whole` from time `start`, or up to `room` on a tree that touches nothing.

        Returns which half of the contact arrays holds the contacts of the last, and by how much all moved on [s].
        """
        half = wp.int32(previous_half)
        done = wp.float64(0.0)
        if system.joints[0].tree.count > 0:
            done, half = follow_tree(system, w, k, previous_half, gravity, start, whole, room)
            if done >= whole:
                return half, done
        h = wp.float64(0.5) * (whole - done)
        half = advance(system, w, k, half, gravity, start + done, h)
        return advance(system, w, k, half, gravity, start + done + h, h), whole

    return advance_far
