"""Initial states of objects, read off the beginning of their tracks.

From its first observation on, an object moves freely until something touches it. Over that stretch a quadratic
in time describes its path well; the polynomial's constant and slope are the initial position and velocity, and
their covariance says how well they are known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.data.noise import noise_levels
from polyworld.data.tracks import ObservedTracks
from polyworld.world import World, geometry
from polyworld.world.symmetry import rotation_between, turn_about

Array = NDArray[np.float64]

NOISE_FLOOR = 1e-4  # [m] and [rad]; no track is taken to be more exact than this
SLOWEST = 0.03  # [m/s]; an object slower than this and indistinguishable from rest is at rest
SLOWEST_TURN = 0.1  # [rad/s]; the same for rotation
SHORTEST = 5  # samples a path is fitted to at least
VAGUE = 0.2  # [m/s]; a short path whose curvature leaves its velocity less certain than this is taken as straight
CURVING = 0.5  # [m/s^2]; how much a path taken as straight may curve all the same
KEPT = 0.8  # share of a stretch that is kept when something ended it
BIAS = 2.0  # factor on standard deviations: a stretch is long enough for its quadratic to be biased by about one
FIRST = 8  # samples from which a first place, velocity or turn is taken
CLEARLY = 2.0  # ratio of the squares of a fall's and a line's misfit from which one of them is the better
MISFIT = 4.0  # standard deviations by which a mean squared residual exceeds the noise where free motion has ended


@dataclass(frozen=True)
class InitialState:
    """State at an object's first observation, and how accurately the track determines it.

    frame: when it was first observed, in units of seconds_per_frame. position (3,) [m], velocity (3,) [m/s],
    orientation (4,) w, x, y, z or None where none was observed, angular_velocity (3,) [rad/s].
    The *_sd are standard deviations, the largest over the axes. moves: whether the object moves (or turns) in
    the free stretch, which ends at frame `free_until`; noise [m] is the track's own scatter about smooth
    motion. samples counts the observations of the stretch.
    """

    name: str
    frame: float
    position: Array
    position_sd: float
    velocity: Array
    velocity_sd: float
    orientation: Array | None
    orientation_sd: float
    angular_velocity: Array
    angular_velocity_sd: float
    moves: bool
    free_until: float
    noise: float
    samples: int


def initial_states(
    tracks: ObservedTracks,
    *,
    seconds_per_frame: float | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> dict[str, InitialState]:
    """Initial state of every track with at least two observations; others are absent from the result.

    seconds_per_frame: default the tracks' own. gravity [m/s^2]: with which a short path may be that of free fall.
    """
    step = tracks.seconds_per_frame if seconds_per_frame is None else seconds_per_frame
    states: dict[str, InitialState] = {}
    for column, name in enumerate(tracks.names):
        if np.count_nonzero(tracks.confidence[:, column] > 0.0) >= 2:
            states[name] = _initial_state(tracks, column, step, np.array(gravity))
    return states


def with_initial_states(world: World, tracks: ObservedTracks) -> World:
    """The world with every tracked object placed and set in motion as its track begins.

    An object first seen after frame 0 joins the simulation at that frame. In planar worlds the position's
    height above the motion plane, and the orientation's tilt, stay as the world has them, and so does the spin of what
    was not seen to turn.
    """
    axes = geometry.plane_axes(world.environment.motion_plane)
    frame, gravity = world.time.seconds_per_frame, world.environment.gravity
    states = initial_states(tracks, seconds_per_frame=frame, gravity=gravity)
    data = world.model_dump()
    for item in data["objects"]:
        state = states.get(item["name"])
        if state is None:
            continue
        position, velocity, spin = state.position, state.velocity, state.angular_velocity
        if state.orientation is None or tracks.symmetry[tracks.index(state.name)] == 0:
            spin = np.asarray(item["angular_velocity"])
        if world.planar:
            n = axes[2]
            position = position + n * (n @ (np.asarray(item["position"]) - position))
            velocity = velocity - n * (n @ velocity)
            spin = n * (n @ spin)
        item["position"] = tuple(float(v) for v in position)
        item["velocity"] = tuple(float(v) for v in velocity)
        item["angular_velocity"] = tuple(float(v) for v in spin)
        item["start_time"] = float(state.frame * world.time.seconds_per_frame)
        if state.orientation is not None and not world.planar:
            item["orientation"] = tuple(float(v) for v in state.orientation)
        elif state.orientation is not None and tracks.symmetry[tracks.index(state.name)] != 0:
            rest = np.asarray(item["orientation"])
            order = np.array([tracks.symmetry[tracks.index(state.name)]])
            angle = turn_about(state.orientation[None, None], rest[None], axes[2], order)[0, 0]
            turned = geometry.quaternion_product(geometry.rotation_quaternion(axes[2] * angle), rest)
            item["orientation"] = tuple(float(v) for v in turned)
    return World.model_validate(data)


def _initial_state(tracks: ObservedTracks, column: int, step: float, gravity: Array) -> InitialState:
    rows = np.flatnonzero(tracks.confidence[:, column] > 0.0)
    times = (tracks.moments[rows] - tracks.moments[rows[0]]) * step
    points = tracks.positions[rows, column]
    stated = float(np.median(tracks.position_sigma[rows, column]))
    scatter, varied = _scatter(times, points, stated)
    # Where a track is smoother than it claims to be exact, the rest of its error drifts slowly: half-way between
    # the two (geometrically) is what a stretch is judged and a velocity known by, and of the position the part
    # that does not scatter is not averaged away.
    noise = float(np.sqrt(scatter * max(stated, scatter)))
    drift = float(np.sqrt(max(stated**2 - (2.0 * scatter) ** 2, 0.0)))  # twice: the scatter is itself an estimate
    weight = np.sqrt(tracks.confidence[rows, column])
    count = free_stretch(times, points, weight, noise, varied)
    path, covariance = _polynomial(times[:count], points[:count], weight[:count], noise)
    position_sd, velocity_sd = BIAS * np.sqrt(np.diag(covariance)[:2])
    if velocity_sd > VAGUE and len(path) > 2:
        path, covariance = _straight_or_falling(times[:count], points[:count], weight[:count], noise, gravity)
        position_sd, velocity_sd = BIAS * np.sqrt(np.diag(covariance)[:2])
        velocity_sd = np.hypot(velocity_sd, CURVING * times[count - 1] / 2.0)
    velocity = path[1] if len(path) > 1 else np.zeros(3)
    speed = float(np.linalg.norm(velocity))
    resting = speed < max(SLOWEST, 4.0 * velocity_sd) and _stays(points[:count], noise)
    if resting:
        mean_weight = weight[:count, None] ** 2
        path = np.array([(points[:count] * mean_weight).sum(axis=0) / mean_weight.sum(), np.zeros(3)])
        position_sd = noise / np.sqrt(mean_weight.sum())
        velocity = np.zeros(3)
    if tracks.position_spread is not None:  # a distance from a camera has one error for the whole stretch
        away, receding = _spread(times[:count], tracks.position_spread[rows[:count], column])
        position_sd, velocity_sd = np.hypot(position_sd, away), np.hypot(velocity_sd, receding)
    turn = _initial_rotation(tracks, column, int(rows[0]), int(rows[count - 1]), step)
    orientation, orientation_sd, spin, spin_sd = turn
    turning = bool(np.linalg.norm(spin) > max(SLOWEST_TURN, 4.0 * spin_sd))
    return InitialState(
        name=tracks.names[column],
        frame=float(tracks.moments[rows[0]]),
        position=path[0],
        position_sd=float(np.hypot(position_sd, drift)),
        velocity=velocity,
        velocity_sd=float(velocity_sd),
        orientation=orientation,
        orientation_sd=orientation_sd,
        angular_velocity=spin if turning else np.zeros(3),
        angular_velocity_sd=spin_sd,
        moves=not resting or turning,
        free_until=float(tracks.moments[rows[count - 1]]),
        noise=scatter,
        samples=count,
    )


def free_stretch(times: Array, points: Array, weight: Array, noise: float, varied: int) -> int:
    """How many leading samples one quadratic in time describes within the noise.

    The stretch is grown sample by sample and ends before the fit's mean squared residual, or that of its last
    three samples, exceeds what `noise` allows by `MISFIT` standard deviations of a mean of squares: a
    collision, or drag that a quadratic cannot follow. varied: how many components carry noise.
    """
    count = min(SHORTEST, len(times))
    for end in range(count + 1, len(times) + 1):
        path, _ = _polynomial(times[:end], points[:end], weight[:end], noise)
        squares = ((_at(path, times[:end]) - points[:end]) * weight[:end, None] / noise) ** 2
        freedom = max(end - len(path), 1) * varied
        last = 3 * varied
        if squares.sum() / freedom > 1.0 + MISFIT * np.sqrt(2.0 / freedom) or squares[
            -3:
        ].sum() / last > 1.0 + 1.5 * MISFIT * np.sqrt(2.0 / last):
            break
        count = end
    # An event shows only some samples after it began: what was accepted last may belong to it.
    return count if count == len(times) else max(min(SHORTEST, len(times)), int(KEPT * count))


def _scatter(times: Array, values: Array, stated: float) -> tuple[float, int]:
    # Components that were never measured, such as a height taken from the floor, are constant and carry no noise.
    own = noise_levels(times, values)
    varied = max(1, int(np.count_nonzero(own > 0.1 * np.max(own)))) if np.all(np.isfinite(own)) else values.shape[1]
    if np.all(np.isfinite(own)):
        return max(NOISE_FLOOR, min(stated, float(own.max())) if stated > 0.0 else float(own.max())), varied
    return max(NOISE_FLOOR, stated), varied


def _polynomial(times: Array, points: Array, weight: Array, noise: float, largest: int = 2) -> tuple[Array, Array]:
    degree = min(largest, 2 if len(times) >= SHORTEST else min(1, len(times) - 1))
    design = np.vander(times, degree + 1, increasing=True) * weight[:, None]
    normal_matrix = design.T @ design
    inverse = np.linalg.pinv(normal_matrix)
    path = inverse @ (design.T @ (points * weight[:, None]))
    covariance = np.zeros((2, 2))
    size = min(2, degree + 1)
    covariance[:size, :size] = inverse[:size, :size] * noise**2
    return path, covariance


def _straight_or_falling(
    times: Array, points: Array, weight: Array, noise: float, gravity: Array
) -> tuple[Array, Array]:
    """Fit a straight line or a free fall, whichever is nearer to the points."""
    fits = []
    for acceleration in (np.zeros(3), gravity):
        fallen = 0.5 * times[:, None] ** 2 * acceleration
        path, covariance = _polynomial(times, points - fallen, weight, noise, largest=1)
        off = np.sum(((_at(path, times) + fallen - points) * weight[:, None]) ** 2)
        fits.append((float(off), path, covariance))
    _, path, covariance = min(fits, key=lambda fit: fit[0])
    return path, covariance


def line_or_fall(times: Array, values: Array, acceleration: float) -> tuple[float, float]:
    """Return value and slope at time 0 of the first samples (m,): with the curvature of a fall, or straight where they
    clearly say that something supports the body. As many samples are asked as it takes to decide."""
    fallen = 0.5 * acceleration * times**2
    for count in (FIRST, 2 * FIRST, 4 * FIRST):
        t, y, f = times[:count], values[:count], fallen[:count]
        straight, falling = (float(np.sum((v - np.polyval(np.polyfit(t, v, 1), t)) ** 2)) for v in (y, y - f))
        if len(t) >= 4 and max(straight, falling) > CLEARLY * min(straight, falling):
            fallen = fallen if falling < straight else 0.0 * fallen
            break
    slope, place = np.polyfit(times[:FIRST], (values - fallen)[:FIRST], 1)
    return float(place), float(slope)


def first_value(times: Array, values: Array) -> float:
    """Return the first of the values (m,) of a series without its noise, as far as one path describes them; NaN where
    none was measured."""
    seen = np.isfinite(values)
    if not seen.any():
        return np.nan
    t, y = times[seen] - times[seen][0], values[seen][:, None]
    noise = max(float(np.nan_to_num(noise_levels(t, y)[0])), 1e-9 * float(np.abs(y).max()), 1e-12)
    weight = np.ones(len(t))
    count = free_stretch(t, y, weight, noise, 1)
    return float(_polynomial(t[:count], y[:count], weight[:count], noise)[0][0, 0])


def _spread(times: Array, spread: Array) -> tuple[float, float]:
    """Standard deviations of place [m] and velocity [m/s] at the start, of what errs by a spread (T, 3) [m] with time.

    The largest over the axes.
    """
    path = np.polynomial.polynomial.polyfit(times, spread, min(1, len(times) - 1))
    away = float(np.abs(path[0]).max())
    return away, float(np.abs(path[1]).max()) if len(path) > 1 else 0.0


def _at(path: Array, times: Array) -> Array:
    values: Array = np.vander(times, len(path), increasing=True) @ path
    return values


def _stays(points: Array, noise: float) -> bool:
    third = max(1, len(points) // 3)
    drift = np.linalg.norm(np.median(points[-third:], axis=0) - np.median(points[:third], axis=0))
    return bool(drift < 6.0 * noise)


def _initial_rotation(
    tracks: ObservedTracks, column: int, first: int, last: int, step: float
) -> tuple[Array | None, float, Array, float]:
    rows = np.arange(first, last + 1)
    seen = tracks.orientation_confidence[rows, column] > 0.0
    rows = rows[seen & np.all(np.isfinite(tracks.orientations[rows, column]), axis=-1)]
    if len(rows) == 0:
        return None, float("nan"), np.zeros(3), 0.0
    start = tracks.orientations[rows[0], column]
    if len(rows) < 3 or tracks.symmetry[column] == 0:
        return start, float("nan"), np.zeros(3), 0.0
    q = tracks.orientations[rows, column]
    increments = rotation_between(q[1:], q[:-1], tracks.symmetry[column])
    angles = np.concatenate([np.zeros((1, 3)), np.cumsum(increments, axis=0)])
    times = (tracks.moments[rows] - tracks.moments[first]) * step
    noise, varied = _scatter(times, angles, float(np.std(np.diff(angles, axis=0))))
    weight = np.sqrt(tracks.orientation_confidence[rows, column])
    count = free_stretch(times, angles, weight, noise, varied)
    path, covariance = _polynomial(times[:count], angles[:count], weight[:count], noise)
    orientation_sd, spin_sd = BIAS * np.sqrt(np.diag(covariance))
    spin = path[1]
    if np.linalg.norm(spin) <= max(SLOWEST_TURN, 4.0 * float(spin_sd)):
        path = angles.mean(axis=0)[None]
        orientation_sd = noise / np.sqrt(len(angles))
    turned = geometry.quaternion_product(geometry.rotation_quaternion(path[0]), start)
    return turned, float(orientation_sd), spin, float(spin_sd)
