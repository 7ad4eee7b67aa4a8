"""One step of a world, each stage a function of its own module."""

from dataclasses import dataclass
from typing import Any

import warp as wp

from polyworld.solver.spatial.constraints import build_rows, note_forces, separate_overlaps, set_contact_targets
from polyworld.solver.spatial.contacts import find_contacts
from polyworld.solver.spatial.episodes import record_contacts
from polyworld.solver.spatial.impacts import set_effect_friction, time_to_impact
from polyworld.solver.spatial.motion import FASTEST, end_orientation, end_position, set_pose
from polyworld.solver.spatial.prediction import note_reactions, predict, sweep_bodies
from polyworld.solver.spatial.slipping import end_slips
from polyworld.solver.spatial.system import System

MAX_IMPACTS = 32  # parts into which impacts may cut a step; what is left then is solved without rebound
MANY = 4  # impacts and parts after them, from which on bodies may rebound early, see `Joining`
# Approaches slower than one step's fall do not rebound: a body at rest would else never come to rest.
SLOWEST_IMPACT = wp.float64(1.0e-4)  # without gravity [m/s]


@dataclass(frozen=True)
class Joining:
    """Joint stages of a step, as Warp functions; see `joint_step` for each, and `free_step` for none.

    Worlds without joints have kernels of their own, which are quicker to compile and to run.

    early: where many bodies collide in a step, those that would touch this part of it later rebound with the others:
    they are then no farther apart than steps place them anyway, and few parts are enough. 0 where joints bring bodies
    back to each other at once: they would rebound again and again in no time.
    """

    solve_velocities: Any
    longest_part: Any
    time_to_stop: Any
    resolve_impacts: Any
    begin: Any
    solve: Any
    carries: Any
    finish: Any
    early: float


def stepping(joining: Joining) -> Any:
    """Return the Warp function `advance`."""
    solve_velocities, begin, solve, finish = joining.solve_velocities, joining.begin, joining.solve, joining.finish
    longest_part, time_to_stop, carries = joining.longest_part, joining.time_to_stop, joining.carries
    resolve_impacts, early = joining.resolve_impacts, wp.constant(wp.float64(joining.early))

    @wp.func
    def advance(
        system: System, w: int, k: int, previous_half: int, gravity: wp.vec3d, start: wp.float64, h: wp.float64
    ) -> int:
        """One step of length h from time `start`, in as many parts as impacts cut it into.

        Returns which half of the contact arrays holds the step's contacts.
        """
        geometry = system.geometry
        parameters = system.parameters
        joints = system.joints
        state = system.state
        fall = wp.length(gravity) * h
        threshold = fall + SLOWEST_IMPACT
        state[0].slowest[k] = threshold
        time = start
        left = h
        impacts = wp.int32(0)
        half = wp.int32(previous_half)
        while left > wp.float64(0.0):
            sweep_bodies(geometry, state, k, fall, left)
            half = 1 - half
            solve_velocities(joints, state, k, geometry[0].lock)
            find_contacts(geometry, state, k, half, wp.float64(0.0))
            build_rows(state, k, half, geometry[0].lock)
            if parameters[0].contact_laws > 0:
                set_effect_friction(parameters, state, w, k, half, threshold, left)
            part = longest_part(joints, state, k, h, left)
            slowest = threshold
            state[0].early[k] = wp.float64(0.0)
            if impacts >= MANY:
                state[0].early[k] = early * h
            if impacts < MAX_IMPACTS:
                if resolve_impacts(parameters, joints, state, w, k, half, threshold) > 0:
                    impacts += 1
                    continue  # the bodies now move elsewhere: look again what they may hit
                whole = part
                part = time_to_impact(state, k, half, part, threshold, gravity)
                part = time_to_stop(joints, state, k, part)
                if part < whole:
                    impacts += 1
            else:
                slowest = FASTEST
            begin(joints, state, k, time, part)
            predict(geometry, parameters, state, w, k, half, threshold, gravity, time, part)
            set_contact_targets(state, k, half, part, slowest)
            solve(joints, state, k, half, part)
            note_forces(state, k, half, part)
            end_slips(state, k, half, part)
            separate_overlaps(state, k, half, part)
            for i in range(state[0].objects):
                if state[0].bodies[k, i].active == 1 and not carries(joints, i):
                    bodies = state[0].bodies
                    set_pose(bodies, k, i, end_position(bodies, k, i, part), end_orientation(bodies, k, i, part))
            finish(joints, state, k, half, part, geometry[0].lock)
            if parameters[0].forces > 0 and wp.float64(2.0) * part >= h:
                note_reactions(state, k, part)
            if system.log[0].record == 1:
                record_contacts(system.log, state, w, k, half, time, part)
            left -= part
            time += part
        return half

    return advance
