"""The kernels: one thread a world; a whole run with the time loop inside, or one step of each world."""

from functools import cache
from typing import Any

import warp as wp

from polyworld.solver.core.time_table import Schedule
from polyworld.solver.spatial.free_step import FREE
from polyworld.solver.spatial.joint_step import JOINED, load_joints
from polyworld.solver.spatial.layout import OPTIONS, Parameters, Samples, State
from polyworld.solver.spatial.prediction import first_diverged, load_bodies
from polyworld.solver.spatial.step import stepping
from polyworld.solver.spatial.system import System
from polyworld.solver.spatial.tree_turn import following

wp.set_module_options(OPTIONS)

SLACK = wp.float64(1.0e-9)  # times of steps and starts differ by rounding [s]


@cache
def roll_out_kernel(jointed: bool) -> Any:
    """Return the kernel that runs worlds from start to end, for worlds with joints or without."""
    if jointed:
        return _roll_out(following(stepping(JOINED)), 2)
    return _roll_out(single(stepping(FREE)), 1)


@cache
def step_kernel(jointed: bool) -> Any:
    """Return the kernel that advances worlds by one step, for worlds with joints or without."""
    return _step_worlds(stepping(JOINED if jointed else FREE))


def single(advance: Any) -> Any:
    """Return the Warp function `advance_one` that takes one step and has the signature of `following`'s."""

    @wp.func
    def advance_one(
        system: System,
        w: int,
        k: int,
        previous_half: int,
        gravity: wp.vec3d,
        start: wp.float64,
        h: wp.float64,
        _room: wp.float64,
    ) -> tuple[int, wp.float64]:
        return advance(system, w, k, previous_half, gravity, start, h), h

    return advance_one


@wp.func
def calls_left(left: wp.float64, each: wp.float64) -> int:
    """Steps of about the length `each` that fill the time that is left."""
    return wp.max(wp.int32(wp.ceil(left / each - SLACK)), wp.int32(1))


@wp.func
def activate_objects(
    parameters: wp.array[Parameters], state: wp.array[State], start: wp.array[wp.float64], w: int, time: wp.float64
) -> None:
    """Activate objects from their start time on."""
    scale = parameters[0].time_scale[w % parameters[0].time_scale.shape[0]]
    for i in range(state[0].objects):
        if time >= start[i] * scale - SLACK:
            state[0].bodies[w, i].active = 1


@wp.kernel
def load_worlds(system: System, start: wp.array[wp.float64]) -> None:
    """Put the bodies of world w in row w of the state, where they start."""
    w = wp.tid()
    load_bodies(system.geometry, system.parameters, system.state, w, w)
    load_joints(system.joints, system.state, w, w)
    activate_objects(system.parameters, system.state, start, w, wp.float64(0.0))


def _roll_out(advance: Any, together: int) -> Any:
    """together: how many steps `advance` takes at a time, or more where it can."""

    @wp.kernel(module="unique", module_options=OPTIONS)
    def roll_out(
        system: System, schedule: wp.array[Schedule], samples: wp.array[Samples], first: int, slot: int, apart: int
    ) -> None:
        """Roll world first + tid out through the segments of its schedule, working in row slot + apart tid.

        On a CPU the threads of a launch run one after the other, so one row serves them all (apart 0) and stays in the
        cache; where they run at the same time each has its own (apart 1).
        """
        w = first + wp.tid()
        k = slot + apart * wp.tid()
        parameters = system.parameters
        state = system.state
        scale = parameters[0].time_scale[w % parameters[0].time_scale.shape[0]]
        gravity = parameters[0].gravity[w % parameters[0].gravity.shape[0]]
        time = schedule[0].begin[w]
        half = state[0].half[k]
        if time < wp.float64(0.0):
            load_bodies(system.geometry, parameters, state, w, k)
            load_joints(system.joints, state, w, k)
            time = wp.float64(0.0)
            half = wp.int32(0)
        own = schedule[0].own[w]
        for segment in range(schedule[0].reach[w]):
            for i in range(state[0].objects):
                if schedule[0].joins[i] == segment:
                    state[0].bodies[k, i].active = 1
            end = schedule[0].end[own, segment] * scale
            steps = schedule[0].steps[own, segment]
            calls = (steps + together - 1) // together
            while calls > 0:
                left = end - time
                h = left / wp.float64(calls)
                half, gone = advance(system, w, k, half, gravity, time, h, left)
                time += gone
                calls -= 1
                if gone > h:
                    calls = wp.int32(0)
                    if gone < left:
                        calls = calls_left(end - time, h)
                diverged = first_diverged(state, k)
                if diverged >= 0:
                    samples[0].outcome.diverged_object[w] = diverged
                    samples[0].outcome.diverged_time[w] = time
                    return
                if state[0].overflowed[k] == 1:
                    samples[0].outcome.overflowed[w] = 1
                    samples[0].outcome.diverged_time[w] = time
                    return
            time = end
            sample = schedule[0].sample[own, segment]
            if sample >= 0:
                for i in range(state[0].objects):
                    samples[0].position[w, sample, i] = state[0].bodies[k, i].x
                    samples[0].orientation[w, sample, i] = state[0].bodies[k, i].q
                    samples[0].velocity[w, sample, i] = state[0].bodies[k, i].v
                    samples[0].angular_velocity[w, sample, i] = state[0].bodies[k, i].w
        state[0].half[k] = half

    return roll_out


def _step_worlds(advance: Any) -> Any:
    @wp.kernel(module="unique", module_options=OPTIONS)
    def step_worlds(
        system: System,
        start: wp.array[wp.float64],
        time: wp.array[wp.float64],
        h: wp.array[wp.float64],
        half: wp.array[wp.int32],
        diverged: wp.array[wp.int32],
    ) -> None:
        """One step of world w; half says which half of its contact arrays holds the last step's contacts."""
        w = wp.tid()
        parameters = system.parameters
        state = system.state
        if h[w] <= wp.float64(0.0) or diverged[w] >= 0 or state[0].overflowed[w] == 1:
            return
        gravity = parameters[0].gravity[w % parameters[0].gravity.shape[0]]
        half[w] = advance(system, w, w, half[w], gravity, time[w], h[w])
        diverged[w] = first_diverged(state, w)
        activate_objects(parameters, state, start, w, time[w] + h[w])

    return step_worlds
