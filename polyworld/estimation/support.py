"""Infer which bodies a fixed level or sloping surface supports at first, and begin them on it.

A body on a surface keeps its distance from it: it has no velocity along the surface's normal, it lies on one of its
faces or rolls, and what a track shows otherwise is noise. Started from that noise it would hop.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.initial_states import InitialState, initial_states
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.fit_settings import SupportSettings
from polyworld.world import StaticObject, World, geometry
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Capsule, Cylinder, Plane, Sphere

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Support:
    """A body on a fixed surface at first.

    static: name of what supports it. normal (3,): of the surface. position (3,) [m], orientation (4,): of the body in
    contact, nearest to what was observed. axis (3,): about which it rolls, None for a ball, which rolls about any, and
    for what lies on a face. rolls: whether it can. height [m]: of its centre over the surface. turns: a ball whose
    rotation was measured, and therefore its spin.
    """

    static: str
    normal: Array
    position: Array
    orientation: Array
    axis: Array | None
    rolls: bool
    height: float
    turns: bool = False

    def headed(self, angle: float) -> Support:
        """Return the support of the body turned about the normal [rad]."""
        if self.axis is None or angle == 0.0:
            return self
        turn = geometry.quaternion_matrix(geometry.rotation_quaternion(self.normal * angle))
        return replace(self, axis=turn @ self.axis)


def supports(world: World, tracks: ObservedTracks, settings: SupportSettings | None = None) -> dict[str, Support]:
    """Support of every tracked body of a spatial world that keeps its height over a fixed surface as its track begins.

    Surfaces are planes and the faces of boxes that look upward. Bodies that a joint holds are left out.
    """
    if world.planar or world.deformables:
        return {}
    settings = settings or SupportSettings()
    held = {name for joint in world.joints for name in (joint.object, joint.other)}
    frame, gravity = world.time.seconds_per_frame, world.environment.gravity
    states = initial_states(tracks, seconds_per_frame=frame, gravity=gravity)
    found: dict[str, Support] = {}
    for item in world.objects:
        state = states.get(item.name)
        if state is None or item.name in held:
            continue
        column = tracks.index(item.name)
        rows = np.flatnonzero(tracks.confidence[:, column] > 0.0)
        rows = rows[tracks.moments[rows] <= max(state.free_until, state.frame + 2)][: settings.steady]
        points = tracks.positions[rows, column]
        times = tracks.moments[rows] * world.time.seconds_per_frame
        noise = float(max(state.noise, np.median(tracks.coordinate_sigma[rows, column])))
        faces = [face for face in _faces(world.statics, state.position) if face[2][2] >= settings.upward]
        own = [_on(item, state, points, times, noise, *face, settings) for face in faces]
        best = [s for s in own if s is not None]
        if best:
            nearest = min(best, key=lambda s: float(np.linalg.norm(s.position - state.position)))
            turns = isinstance(item.shape, Sphere) and state.orientation is not None and tracks.symmetry[column] != 0
            found[item.name] = replace(nearest, turns=turns)
    return found


def with_supports(world: World, tracks: ObservedTracks, settings: SupportSettings | None = None) -> World:
    """Return the world with supported bodies in contact with what supports them, without velocity along its normal.

    Bodies that lie on a face turn about the normal alone; balls, and cylinders on their side, begin to roll without
    slip, as what has moved on a floor for a while does.
    """
    found = supports(world, tracks, settings)
    objects = []
    for item in world.objects:
        support = found.get(item.name)
        if support is None:
            objects.append(item)
            continue
        n = support.normal
        velocity = np.asarray(item.velocity) - n * (n @ np.asarray(item.velocity))
        spin = n * (n @ np.asarray(item.angular_velocity))
        if support.turns:
            spin = np.asarray(item.angular_velocity)
        elif support.rolls:
            spin = rolling_spin(item, support, velocity) + (0.0 if support.axis is None else spin)
        state = {"position": support.position, "orientation": support.orientation, "velocity": velocity}
        fields = {key: tuple(float(v) for v in value) for key, value in (state | {"angular_velocity": spin}).items()}
        objects.append(item.model_copy(update=fields))
    return world.model_copy(update={"objects": tuple(objects)})


def rolling_spin(item: RigidObject, support: Support, velocity: Array) -> Array:
    """Angular velocity (3,) [rad/s] of a body that rolls without slip at a velocity (3,) along its support."""
    assert isinstance(item.shape, Sphere | Cylinder | Capsule)
    spin = np.cross(support.normal, velocity) / item.shape.radius
    rolling: Array = spin if support.axis is None else support.axis * (support.axis @ spin)
    return rolling


def _faces(statics: tuple[StaticObject, ...], place: Array) -> list[tuple[str, Array, Array]]:
    """Name, a point and the normal of planes, and of the topmost faces of boxes that lie under a place."""
    found: list[tuple[str, Array, Array]] = []
    for static in statics:
        turn = geometry.quaternion_matrix(np.asarray(static.orientation))
        centre = np.asarray(static.position)
        if isinstance(static.shape, Plane):
            normal = np.asarray(static.shape.normal) / np.linalg.norm(static.shape.normal)
            found.append((static.name, centre + turn @ normal * static.shape.offset, turn @ normal))
        elif isinstance(static.shape, Box):
            half = np.asarray(static.shape.half_extents)
            local = turn.T @ (place - centre)
            axis = int(np.argmax(np.abs(turn[2])))
            sign = float(np.sign(turn[2, axis]))
            others = [k for k in range(3) if k != axis]
            if np.all(np.abs(local[others]) <= half[others]) and sign * local[axis] > 0.0:
                found.append((static.name, centre + turn[:, axis] * sign * half[axis], turn[:, axis] * sign))
    return found


def _on(
    item: RigidObject,
    state: InitialState,
    points: Array,
    times: Array,
    noise: float,
    static: str,
    at: Array,
    normal: Array,
    settings: SupportSettings,
) -> Support | None:
    """Return a body's support by one face, None where it is off it, leaves it or stands on an edge."""
    seen = np.asarray(item.orientation if state.orientation is None else state.orientation)
    lain = _lain(item, seen, normal, settings.flat)
    if lain is None:
        return None
    orientation, reach, axis, rolls = lain
    heights = (points - at) @ normal - reach
    count = len(heights)
    if abs(float(heights.mean())) > settings.close * reach + settings.sigmas * noise / np.sqrt(count):
        return None
    if count >= 3:
        spread = times - times.mean()
        slope = float(spread @ heights) / float(spread @ spread)
        if abs(slope) > settings.sigmas * noise / float(np.sqrt(spread @ spread)):
            return None
    position = state.position - normal * ((state.position - at) @ normal - reach)
    return Support(static, normal, position, orientation, axis, rolls, reach)


def _lain(
    item: RigidObject, orientation: Array, normal: Array, flat: float
) -> tuple[Array, float, Array | None, bool] | None:
    """Return how a body lies on a face: its orientation turned flat, the height of its centre, the axis about which it
    rolls.

    None for shapes that lie in no simple way, or that stand on an edge.
    """
    orientation = orientation / np.linalg.norm(orientation)  # measured ones may be rounded
    shape, turn = item.shape, geometry.quaternion_matrix(orientation)
    if isinstance(shape, Sphere):
        return orientation, shape.radius, None, True
    if isinstance(shape, Box):
        axis = int(np.argmax(np.abs(turn.T @ normal)))
        goal = normal * np.sign(turn[:, axis] @ normal)
        turned = _turned_to(orientation, turn[:, axis], goal, flat)
        return None if turned is None else (turned, shape.half_extents[axis], None, False)
    if isinstance(shape, Cylinder | Capsule):
        axis_now = turn[:, 2]
        upright = abs(float(axis_now @ normal))
        if upright > flat and isinstance(shape, Cylinder):
            turned = _turned_to(orientation, axis_now, normal * np.sign(axis_now @ normal), flat)
            return None if turned is None else (turned, shape.half_height, None, False)
        level = axis_now - normal * (axis_now @ normal)
        if np.linalg.norm(level) < flat:
            return None
        level = level / np.linalg.norm(level)
        turned = _turned_to(orientation, axis_now, level, flat)
        return None if turned is None else (turned, shape.radius, level, True)
    return None


def _turned_to(orientation: Array, direction: Array, goal: Array, flat: float) -> Array | None:
    """Return an orientation turned the short way so that a world direction comes to lie along another; None if its
    cosine is below `flat`."""
    cosine = float(direction @ goal)
    if cosine < flat:
        return None
    axis = np.cross(direction, goal)
    size = float(np.linalg.norm(axis))
    if size < 1e-12:
        return orientation
    turned: Array = geometry.quaternion_product(
        geometry.rotation_quaternion(axis / size * np.arctan2(size, cosine)), orientation
    )
    return turned
