"""Kernels that advance all worlds by one step, each from its own time by its own length."""

import warp as wp

from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.joint_step import load_joints
from polyworld.solver.spatial.layout import OPTIONS, Geometry, Log, Parameters, State
from polyworld.solver.spatial.step import advance, first_diverged, load_bodies

wp.set_module_options(OPTIONS)

SLACK = wp.float64(1.0e-9)  # times of steps and starts differ by rounding [s]


@wp.func
def let_in(parameters: Parameters, state: State, start: wp.array[wp.float64], w: int, time: wp.float64) -> None:
    """Objects take part from their start time on."""
    scale = parameters.time_scale[w % parameters.time_scale.shape[0]]
    for i in range(state.objects):
        if time >= start[i] * scale - SLACK:
            state.bodies[w, i].active = 1


@wp.kernel
def load_worlds(
    geometry: Geometry, parameters: Parameters, joints: Joints, state: State, start: wp.array[wp.float64]
) -> None:
    """Put the bodies of world w in row w of the state, where they start."""
    w = wp.tid()
    load_bodies(geometry, parameters, state, w, w)
    load_joints(joints, state, w, w)
    let_in(parameters, state, start, w, wp.float64(0.0))


@wp.kernel
def step_worlds(
    geometry: Geometry,
    parameters: Parameters,
    joints: Joints,
    state: State,
    log: Log,
    start: wp.array[wp.float64],
    time: wp.array[wp.float64],
    h: wp.array[wp.float64],
    half: wp.array[wp.int32],
    lost: wp.array[wp.int32],
) -> None:
    """One step of world w; half says which half of its contact arrays holds the last step's contacts."""
    w = wp.tid()
    if h[w] <= wp.float64(0.0) or lost[w] >= 0 or state.crowded[w] == 1:
        return
    gravity = parameters.gravity[w % parameters.gravity.shape[0]]
    half[w] = advance(geometry, parameters, joints, state, log, w, w, half[w], gravity, time[w], h[w])
    lost[w] = first_diverged(state, w)
    let_in(parameters, state, start, w, time[w] + h[w])
