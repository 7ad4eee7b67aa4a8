"""The laws of effects, one by one, at given states of bodies: as the solvers apply them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.effects import MAX_PARAMETERS, Motion
from polyworld.expressions.effect import EXPRESSION, law_of
from polyworld.model import model_of
from polyworld.solver.core.effect_contacts import contact_friction
from polyworld.solver.core.effect_forces import effect_forces
from polyworld.solver.core.effect_table import Effects
from polyworld.solver.spatial.layout import OPTIONS
from polyworld.world import Effect, World

wp.set_module_options(OPTIONS)

Array = NDArray[np.float64]
FLOOR = wp.constant(-1)  # the supporting plane as the other side of a contact


@dataclass(frozen=True)
class Bodies:
    """m bodies or nodes: mass [kg], radius [m], time [s] and contact (m,); positions [m], velocities [m/s] and spins
    [rad/s] (m, 3). See `polyworld.effects.Motion`."""

    mass: Array
    radius: Array
    positions: Array
    velocities: Array
    spins: Array
    times: Array
    contact: Array


@wp.kernel
def _accelerations(
    effects: Effects,
    gravity: wp.vec3d,
    mass: wp.array[wp.float64],
    radius: wp.array[wp.float64],
    x: wp.array[wp.vec3d],
    v: wp.array[wp.vec3d],
    omega: wp.array[wp.vec3d],
    time: wp.array[wp.float64],
    contact: wp.array[wp.float64],
    out: wp.array2d[wp.vec3d],
) -> None:
    e, i = wp.tid()
    b = Motion()
    b.mass = mass[i]
    b.radius = radius[i]
    b.x = x[i]
    b.v = v[i]
    b.omega = omega[i]
    b.t = time[i]
    b.contact = contact[i]
    b.gravity = gravity
    out[e, i] = wp.spatial_top(effect_forces(effects, 0, e, b)) / mass[i]


@wp.kernel
def _frictions(effects: Effects, mu: wp.float64, x: wp.array[wp.vec3d], out: wp.array2d[wp.float64]) -> None:
    e, i = wp.tid()
    out[e, i] = contact_friction(effects, 0, e, FLOOR, mu, x[i], wp.vec3d())


def enabled(world: World) -> list[Effect]:
    """Return the effects of a world that are switched on, in order."""
    return [effect for effect in world.effects if effect.enabled]


def has_force(effect: Effect) -> bool:
    """Return whether an effect pushes bodies; others change what happens at contacts."""
    return effect.kind == EXPRESSION or law_of(effect).force is not None


def accelerations_of(world: World, bodies: Bodies) -> Array:
    """Return the acceleration (e, m, 3) that each enabled effect gives bodies it acts on [m/s^2].

    Of planar worlds, its part in the plane of motion.
    """
    count, m = len(enabled(world)), len(bodies.mass)
    if not (count and m):
        return np.zeros((count, m, 3))
    with buffers.on_cpu():
        vectors = (buffers.array(values, wp.vec3d) for values in (bodies.positions, bodies.velocities, bodies.spins))
        scalars = (buffers.doubles(values) for values in (bodies.times, bodies.contact))
        out = buffers.zeros((count, m), wp.vec3d)
        sizes = [buffers.doubles(bodies.mass), buffers.doubles(bodies.radius)]
        gravity = wp.vec3d(*world.environment.gravity)
        buffers.launch(_accelerations, (count, m), [_each(world), gravity, *sizes, *vectors, *scalars, out])
        found: Array = buffers.read(out).copy()
    if world.planar:
        normal = model_of(world).plane_axes[2]
        found -= (found @ normal)[..., None] * normal
    return found


def frictions_of(world: World, positions: Array, coefficient: float) -> Array:
    """Return the Coulomb coefficients (e, m) that each enabled effect makes of one, of contacts with the floor or a
    static at positions (m, 3)."""
    count, m = len(enabled(world)), len(positions)
    if not (count and m):
        return np.full((count, m), coefficient)
    with buffers.on_cpu():
        out = buffers.zeros((count, m), wp.float64)
        places = buffers.array(positions, wp.vec3d)
        buffers.launch(_frictions, (count, m), [_each(world), wp.float64(coefficient), places, out])
        found: Array = buffers.read(out).copy()
    return found


def _each(world: World) -> Effects:
    """Return the enabled effects so that effect e alone acts on body e."""
    own = model_of(world).arrays()
    count = len(own.effect_kind)
    table = Effects()
    table.kind = buffers.ints(own.effect_kind)
    table.acts = buffers.ints(np.eye(count))
    table.parameters = buffers.doubles(own.effect_parameters.reshape(1, count, MAX_PARAMETERS))
    table.programs = buffers.doubles(own.effect_programs)
    return table
