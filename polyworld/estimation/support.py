"""Infer which bodies a fixed level or sloping surface supports at first, and begin them on it.

A body on a surface keeps its distance from it: it has no velocity along the surface's normal, it lies on one of its
faces or rolls, and what a track shows otherwise is noise. Started from that noise it would hop.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.initial_states import FIRST, initial_states
from polyworld.data.noise import noise_levels
from polyworld.data.recording import Run
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.fit_settings import SupportSettings
from polyworld.probing.closest_approach import gap_to_statics
from polyworld.world import StaticObject, World, geometry
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Capsule, Cylinder, Plane, Sphere

Array = NDArray[np.float64]

SETTINGS = SupportSettings()
LEVEL = (32, 64)  # least and greatest number of samples of a run that must be level
RESTLESS = 2.0  # times its noise by which a level height may scatter
CLOSE = 0.2  # radii of the ball around it, beyond its noise, within which a body may touch what supports it
EXACT = 1e-9  # [m] noise of computed places


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


@dataclass(frozen=True)
class _Course:
    """The first places (m, 3) [m] of a body at times (m,) [s], with their noise [m]; where (3,) and how it begins."""

    item: RigidObject
    times: Array
    places: Array
    noise: float
    place: Array
    orientation: Array


def supports(world: World, tracks: ObservedTracks) -> dict[str, Support]:
    """Support of every tracked body that keeps its height over a fixed surface as its track begins.

    Surfaces are planes and the faces of boxes that look upward. Bodies that a joint holds are left out.
    """
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
        rows = rows[tracks.moments[rows] <= max(state.free_until, state.frame + 2)][: SETTINGS.steady]
        noise = float(max(state.noise, np.median(tracks.coordinate_sigma[rows, column])))
        seen = np.asarray(item.orientation if state.orientation is None else state.orientation)
        own = _Course(item, tracks.moments[rows] * frame, tracks.positions[rows, column], noise, state.position, seen)
        support = _nearest(own, _faces(world.statics, state.position))
        if support is not None:
            turns = isinstance(item.shape, Sphere) and state.orientation is not None and tracks.symmetry[column] != 0
            found[item.name] = replace(support, turns=turns)
    return found


def support_in_run(world: World, item: RigidObject, run: Run) -> Support | None:
    """Return the support of a body that keeps its height as a run begins: a face, or whatever is near below it.

    All of its first samples must be level: on few of them noise alone can look so, and a speed left out would ruin the
    run. Along axes that were not measured it is where the world has it.
    """
    gravity = np.asarray(world.environment.gravity, dtype=float)
    course, size = _first_course(item, run), float(np.linalg.norm(gravity))
    if course is None or world.planar or not size or abs(float(gravity @ np.asarray(item.velocity))) > 0.0:
        return None
    measured = np.asarray(np.isfinite(run.positions[:, run.names.index(item.name)]).any(axis=0))
    if len(course.times) < LEVEL[0] or np.any((gravity != 0.0) & ~measured):
        return None
    support = _nearest(course, _faces(world.statics, course.place))
    if support is None and _near_something(world, course, run):
        up = -gravity / size
        lain = _lain(item, course.orientation, up)
        if lain is not None:
            support = _on(course, "", course.places.mean(axis=0) - lain[1] * up, up)
    return support


def _first_course(item: RigidObject, run: Run) -> _Course | None:
    column = run.names.index(item.name)
    times, places = run.times - run.times[0] + run.lead, run.positions[:, column]
    measured = np.isfinite(places).any(axis=0)
    rows = np.flatnonzero(np.isfinite(places[:, measured]).all(axis=1) & (times >= item.start_time - 1e-9))
    if not measured.any() or not len(rows):
        return None
    places = np.where(measured, places, item.position)[rows[: LEVEL[1]]]
    noise = float(np.nan_to_num(noise_levels(run.times, run.positions[:, column])).max())
    turned = run.orientations[rows, column]
    turned = turned[np.isfinite(turned).all(axis=1)]
    orientation = turned[0] if len(turned) else np.asarray(item.orientation)
    return _Course(item, times[rows[: LEVEL[1]]], places, noise, places[:FIRST].mean(axis=0), orientation)


def _near_something(world: World, course: _Course, run: Run) -> bool:
    """Return whether a body begins so near to another, or to a fixed one without faces, that this may support it.

    Of other bodies only the balls around them are looked at, and deformable ones may be anywhere.
    """
    reach = geometry.circumscribed_radius(course.item.shape)
    close = course.noise + CLOSE * reach
    for other in (o for o in world.objects if o.name != course.item.name):
        seen = _first_course(other, run) if other.name in run.names else None
        apart = course.place - (np.asarray(other.position) if seen is None else seen.place)
        if np.linalg.norm(apart) <= reach + geometry.circumscribed_radius(other.shape) + close:
            return True
    without = tuple(s for s in world.statics if not isinstance(s.shape, Plane | Box))
    bare = world.model_copy(update={"statics": without})
    near = gap_to_statics(bare, course.item.shape, course.place, course.orientation) <= close
    return near or bool(world.deformables)


def _nearest(course: _Course, faces: list[tuple[str, Array, Array]]) -> Support | None:
    """Return the support by the face that is nearest to where a body begins."""
    own = [_on(course, *face) for face in faces if face[2][2] >= SETTINGS.upward]
    return min((s for s in own if s), key=lambda s: float(np.linalg.norm(s.position - course.place)), default=None)


def with_supports(world: World, tracks: ObservedTracks) -> World:
    """Return the world with supported bodies in contact with what supports them, without velocity along its normal.

    Bodies that lie on a face turn about the normal alone; balls, and cylinders on their side, begin to roll without
    slip, as what has moved on a floor for a while does.
    """
    found = supports(world, tracks)
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
        turn, centre = geometry.quaternion_matrix(np.asarray(static.orientation)), np.asarray(static.position)
        if isinstance(static.shape, Plane):
            normal = turn @ np.asarray(static.shape.normal) / np.linalg.norm(static.shape.normal)
            found.append((static.name, centre + normal * static.shape.offset, normal))
        elif isinstance(static.shape, Box):
            half = np.asarray(static.shape.half_extents)
            local = turn.T @ (place - centre)
            axis = int(np.argmax(np.abs(turn[2])))
            sign = float(np.sign(turn[2, axis]))
            others = [k for k in range(3) if k != axis]
            if np.all(np.abs(local[others]) <= half[others]) and sign * local[axis] > 0.0:
                found.append((static.name, centre + turn[:, axis] * sign * half[axis], turn[:, axis] * sign))
    return found


def _on(course: _Course, static: str, at: Array, normal: Array) -> Support | None:
    """Return a body's support by one face, None where it is off it, leaves it, hops or stands on an edge."""
    lain = _lain(course.item, course.orientation, normal)
    if lain is None:
        return None
    orientation, reach, axis, rolls = lain
    heights, noise = (course.places - at) @ normal - reach, max(course.noise, EXACT)
    count = len(heights)
    off, slack = float(heights.mean()), SETTINGS.sigmas * noise / np.sqrt(count)
    if off > SETTINGS.close * reach + slack or off < -reach - slack:  # it cannot be within: its plane of motion is off
        return None
    if count >= 3:
        spread = course.times - course.times.mean()
        slope = float(spread @ heights) / float(spread @ spread)
        left = float(np.std(heights - slope * spread))
        noise = max(noise, left) if count >= LEVEL[0] else noise
        hops = count >= LEVEL[0] and left > RESTLESS * max(course.noise, EXACT)
        if hops or abs(slope) > SETTINGS.sigmas * noise / float(np.sqrt(spread @ spread)):
            return None
    position = course.place - normal * ((course.place - at) @ normal - reach)
    return Support(static, normal, position, orientation, axis, rolls, reach)


def _lain(item: RigidObject, orientation: Array, normal: Array) -> tuple[Array, float, Array | None, bool] | None:
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
        turned = _turned_to(orientation, turn[:, axis], goal)
        return None if turned is None else (turned, shape.half_extents[axis], None, False)
    if isinstance(shape, Cylinder | Capsule):
        axis_now = turn[:, 2]
        upright = abs(float(axis_now @ normal))
        if upright > SETTINGS.flat and isinstance(shape, Cylinder):
            turned = _turned_to(orientation, axis_now, normal * np.sign(axis_now @ normal))
            return None if turned is None else (turned, shape.half_height, None, False)
        level = axis_now - normal * (axis_now @ normal)
        if np.linalg.norm(level) < SETTINGS.flat:
            return None
        level = level / np.linalg.norm(level)
        turned = _turned_to(orientation, axis_now, level)
        return None if turned is None else (turned, shape.radius, level, True)
    return None


def _turned_to(orientation: Array, direction: Array, goal: Array) -> Array | None:
    """Return an orientation turned the short way so that a world direction comes to lie along another; None if it is
    not nearly there."""
    cosine = float(direction @ goal)
    if cosine < SETTINGS.flat:
        return None
    axis = np.cross(direction, goal)
    size = float(np.linalg.norm(axis))
    if size < 1e-12:
        return orientation
    turned: Array = geometry.quaternion_product(
        geometry.rotation_quaternion(axis / size * np.arctan2(size, cosine)), orientation
    )
    return turned
