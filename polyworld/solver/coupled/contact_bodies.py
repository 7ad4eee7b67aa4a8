"""Rigid bodies during the inner steps: carried along as nodes push them, then handed to the rigid step.

Between two rigid steps a body is moved by what moved it in the last one, apart from the nodes: its weight where it
flies, nothing where it stands on a floor. What the nodes push meanwhile acts in the rigid step as a constant force.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from polyworld.core import buffers
from polyworld.effects.law import wrench
from polyworld.solver.coupled.mechanism import Mechanisms, build_mechanisms, reset_mechanisms
from polyworld.solver.coupled.nodes import Clock
from polyworld.solver.spatial.constraints import world_inverse_inertia
from polyworld.solver.spatial.layout import OPTIONS, Body
from polyworld.solver.spatial.motion import rotated
from polyworld.solver.spatial.stepper import RigidStepper
from polyworld.world import World

wp.set_module_options(OPTIONS)


LIGHT = wp.constant(wp.float64(3.0))  # push of the nodes, per weight, from which on a body is light beside them


@wp.struct
class Carried:
    """Of bodies (W, B): state at the start of the coupling step, and how they are carried through it.

    x, q, v, w: kept state. acceleration, turning: of all but the nodes. last, last_turning: what the step before
    showed beyond gravity. before, before_turning: velocities when the inner step began. inverse_inertia: world axes.
    h (W,): length of the step before. seen: 1 once it moved. flying: 0 while it rests on
    something rigid. gained, gained_turning: velocities of jointed bodies by the nodes' push in the step before.
    mechanisms: what joints hold together.
    """

    x: wp.array2d[wp.vec3d]
    q: wp.array2d[wp.quatd]
    v: wp.array2d[wp.vec3d]
    w: wp.array2d[wp.vec3d]
    acceleration: wp.array2d[wp.vec3d]
    turning: wp.array2d[wp.vec3d]
    last: wp.array2d[wp.vec3d]
    last_turning: wp.array2d[wp.vec3d]
    before: wp.array2d[wp.vec3d]
    before_turning: wp.array2d[wp.vec3d]
    inverse_inertia: wp.array2d[wp.mat33d]
    seen: wp.array2d[wp.int32]
    flying: wp.array2d[wp.int32]
    h: wp.array[wp.float64]
    gained: wp.array2d[wp.vec3d]
    gained_turning: wp.array2d[wp.vec3d]
    mechanisms: Mechanisms


@wp.func
def shorter(a: wp.vec3d, b: wp.vec3d) -> wp.vec3d:
    if wp.length_sq(a) < wp.length_sq(b):
        return a
    return b


@wp.func
def fall_on_joints(m: Mechanisms, bodies: wp.array2d[Body], pull: wp.vec3d, w: int, i: int) -> wp.spatial_vectord:
    """Accelerations of jointed body i by the weight of its group."""
    found = wp.spatial_vectord()
    for e in range(m.first[i], m.first[i] + m.count[i]):
        weight = pull * bodies[w, m.member[e]].mass
        found = found + wp.transpose(m.response[w, e]) * wrench(weight, wp.vec3d())
    return found


@wp.kernel
def begin_step(clock: Clock, objects: int, bodies: wp.array2d[Body], carried: Carried) -> None:
    """Note where the bodies are, and guess what will move them besides the nodes.

    The guess is what moved them in the last two steps, whichever was less: one impact is no lasting force.
    """
    w, i = wp.tid()
    if clock.h[w] <= wp.float64(0.0):
        return
    b = bodies[w, i]
    if i >= objects:
        return
    pull = clock.gravity[w % clock.gravity.shape[0]]
    fall = pull
    turning = wp.vec3d()
    jointed = carried.mechanisms.first[i] >= 0
    if jointed:
        falling = fall_on_joints(carried.mechanisms, bodies, pull, w, i)
        fall = wp.spatial_top(falling)
        turning = wp.spatial_bottom(falling)
    carried.acceleration[w, i] = fall
    carried.turning[w, i] = turning
    if carried.seen[w, i] == 1 and carried.h[w] > wp.float64(0.0):
        rate = wp.float64(1.0) / carried.h[w]
        pushed = b.push * b.inverse_mass
        pushed_turning = carried.inverse_inertia[w, i] * b.push_torque
        if jointed:
            pushed = carried.gained[w, i] * rate
            pushed_turning = carried.gained_turning[w, i] * rate + turning
        other = (b.v - carried.v[w, i]) * rate - pushed - fall
        carried.acceleration[w, i] = fall + shorter(other, carried.last[w, i])
        carried.last[w, i] = other
        other = (b.w - carried.w[w, i]) * rate - pushed_turning
        carried.turning[w, i] = turning + shorter(other, carried.last_turning[w, i])
        carried.last_turning[w, i] = other
        most = LIGHT * wp.length(pull)
        if carried.flying[w, i] == 1:
            most = most * wp.float64(0.5)
        held = wp.length(carried.acceleration[w, i] - pull) > wp.float64(0.5) * wp.length(pull)
        carried.flying[w, i] = wp.where(held and wp.length(b.push) * b.inverse_mass <= most, 0, 1)
    else:
        carried.flying[w, i] = 1
    carried.inverse_inertia[w, i] = world_inverse_inertia(bodies, w, i)
    carried.seen[w, i] = b.active
    carried.x[w, i] = b.x
    carried.q[w, i] = b.q
    carried.v[w, i] = b.v
    carried.w[w, i] = b.w


@wp.kernel
def note_length(clock: Clock, carried: Carried) -> None:
    w = wp.tid()
    if clock.h[w] > wp.float64(0.0):
        carried.h[w] = clock.h[w]


@wp.kernel
def accelerate_bodies(clock: Clock, objects: int, bodies: wp.array2d[Body], carried: Carried) -> None:
    w, i = wp.tid()
    t = clock.dt[w]
    if t <= wp.float64(0.0) or i >= objects or bodies[w, i].active == 0:
        return
    carried.before[w, i] = bodies[w, i].v
    carried.before_turning[w, i] = bodies[w, i].w
    bodies[w, i].v = bodies[w, i].v + carried.acceleration[w, i] * t
    bodies[w, i].w = bodies[w, i].w + carried.turning[w, i] * t


@wp.kernel
def carry_bodies(clock: Clock, objects: int, bodies: wp.array2d[Body], carried: Carried) -> None:
    """Positions from velocities.

    Of what flies, hangs or lies on deformable objects, the guessed acceleration acts half its velocity, as gravity
    does on nodes. What rests on something rigid moves with the mean of its velocities before and after, so that it
    stays; but for a body that is light beside what presses on it, which would swing against its support.
    """
    w, i = wp.tid()
    t = clock.dt[w]
    if t <= wp.float64(0.0) or i >= objects or bodies[w, i].active == 0:
        return
    half = wp.float64(0.5) * t
    if carried.flying[w, i] == 1:
        carried.before[w, i] = bodies[w, i].v - carried.acceleration[w, i] * t
        carried.before_turning[w, i] = bodies[w, i].w - carried.turning[w, i] * t
    bodies[w, i].x = bodies[w, i].x + (bodies[w, i].v + carried.before[w, i]) * half
    q = rotated(bodies[w, i].q, (bodies[w, i].w + carried.before_turning[w, i]) * half)
    bodies[w, i].q = q
    bodies[w, i].rotation = wp.quat_to_matrix(q)


@wp.kernel
def put_back_bodies(clock: Clock, objects: int, bodies: wp.array2d[Body], carried: Carried) -> None:
    """Back to the start of the step, with what the nodes gave as a force for the rigid step.

    The rigid step takes that force as constant. What its course within the step moved the bodies beyond that is
    added to the rigid motion: a load on a spring would otherwise gain energy.
    """
    w, i = wp.tid()
    if i >= objects or clock.h[w] <= wp.float64(0.0) or bodies[w, i].active == 0:
        return
    b = bodies[w, i]
    half = wp.float64(0.5) * clock.h[w]
    b.shift = b.x - (carried.x[w, i] + (carried.v[w, i] + b.v) * half)
    off = b.q * wp.quat_inverse(rotated(carried.q[w, i], (carried.w[w, i] + b.w) * half))
    b.rotation_shift = wp.vec3d(off[0], off[1], off[2]) * (wp.float64(2.0) * wp.sign(off[3]))
    gained = b.v - carried.v[w, i] - carried.acceleration[w, i] * clock.h[w]
    turned_by = b.w - carried.w[w, i] - carried.turning[w, i] * clock.h[w]
    b.x = carried.x[w, i]
    b.q = carried.q[w, i]
    b.v = carried.v[w, i]
    b.w = carried.w[w, i]
    b.rotation = wp.quat_to_matrix(b.q)
    if carried.mechanisms.first[i] >= 0:  # without what the joints gave, which the rigid step finds
        b.push = carried.mechanisms.impulse[w, i] / clock.h[w]
        b.push_torque = carried.mechanisms.angular_impulse[w, i] / clock.h[w]
        carried.gained[w, i] = gained
        carried.gained_turning[w, i] = turned_by
    else:
        inertia = b.rotation * b.inertia * wp.transpose(b.rotation)
        b.push = gained * (b.mass / clock.h[w])
        b.push_torque = (inertia * turned_by) * (b.mass / clock.h[w])
    bodies[w, i] = b


def carried_arrays(shape: tuple[int, int]) -> Carried:
    """Return the arrays of W x B bodies."""
    carried = Carried()
    vectors = ("x", "v", "w", "acceleration", "turning", "last", "last_turning", "before", "before_turning")
    for name in (*vectors, "gained", "gained_turning"):
        setattr(carried, name, buffers.zeros(shape, wp.vec3d))
    carried.q = buffers.zeros(shape, wp.quatd)
    carried.inverse_inertia = buffers.zeros(shape, wp.mat33d)
    carried.flying = buffers.zeros(shape, wp.int32)
    carried.seen = buffers.zeros(shape, wp.int32)
    carried.h = buffers.zeros(shape[0], wp.float64)
    return carried


class CarriedBodies:
    """The bodies of a RigidStepper while nodes push them."""

    def __init__(self, world: World, rigid: RigidStepper) -> None:
        self.bodies = rigid.bodies
        self.objects = len(world.objects)
        self.carried = carried_arrays(self.bodies.shape)
        w, count = self.bodies.shape
        self.mechanisms: Any = build_mechanisms(world, count, w)
        self.carried.mechanisms = self.mechanisms
        self._rigid = rigid
        self._along: Any = buffers.zeros((w, count), wp.spatial_vectord)

    def reset(self) -> None:
        """Forget the steps of the last run."""
        for name in (
            "acceleration",
            "turning",
            "last",
            "last_turning",
            "before",
            "inverse_inertia",
            "seen",
            "flying",
            "h",
        ):
            buffers.write(getattr(self.carried, name), 0)
        reset_mechanisms(self.mechanisms)

    def launch_begin(self, clock: Clock) -> None:
        """Launch what opens a coupling step."""
        if self.mechanisms.member.shape[0]:
            from polyworld.solver.coupled.mechanism_response import find_responses

            inputs = [clock, self._rigid.system, self.mechanisms, self._along]
            buffers.launch(find_responses, self.bodies.shape[0], inputs)
        self._launch(begin_step, [clock, self.objects, self.bodies, self.carried])
        buffers.launch(note_length, self.bodies.shape[0], [clock, self.carried])

    def launch_velocities(self, clock: Clock) -> None:
        """Launch the velocities of an inner step, before nodes push."""
        self._launch(accelerate_bodies, [clock, self.objects, self.bodies, self.carried])

    def launch_positions(self, clock: Clock) -> None:
        """Launch the positions of an inner step, after nodes pushed."""
        self._launch(carry_bodies, [clock, self.objects, self.bodies, self.carried])

    def launch_end(self, clock: Clock) -> None:
        """Launch what hands the bodies to the rigid step."""
        self._launch(put_back_bodies, [clock, self.objects, self.bodies, self.carried])

    def _launch(self, kernel: Any, inputs: list[Any]) -> None:
        if self.objects:
            buffers.launch(kernel, self.bodies.shape, inputs)
