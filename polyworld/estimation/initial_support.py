"""Decide whether a body is supported when a run begins: then no velocity along gravity is fitted, nor spurious hops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.data.noise import noise_level
from polyworld.data.recording import Run
from polyworld.probing.closest_approach import gap_to_statics
from polyworld.world import World, geometry
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere, TriangleMesh

Array = NDArray[np.float64]

EARLY = 8  # samples in which something must show, and from which a first velocity is taken
CLEARLY = 2.0  # ratio of the squares of a fall's and a line's misfit from which one of them is the better
RESTLESS = 2.0  # times its noise, by third differences, beyond which a level height is not that of a body at rest
VARIES = 1.2  # times its noise beyond which a height may vary in truth
ALOFT = 1.5  # times its noise by which a mean height is off that of rest
STEEP = 4.0  # standard errors of its slope above which a height changes
CLOSE = 0.2  # radii of the ball around it, beyond its noise, within which a body may touch its support
TOUCHING = 1e-9  # gap that counts as none [m]
MOST_STEPS = 100


def keeps_height(times: Array, values: Array, acceleration: float) -> bool:
    """Return whether a body keeps its height (m,) from the start, by its first samples. acceleration: of a fall."""
    t, x = times[: 8 * EARLY], values[: 8 * EARLY]
    # All of them must be level: on the first few noise alone can look so, and a speed left out would ruin the run.
    if not acceleration or len(t) < 4 * EARLY:
        return False
    # No stretch from the start may fall: over a bounce a line can describe all of them better than one fall does.
    leanings = [_leaning(t[:count], x[:count], acceleration) for count in (EARLY, 2 * EARLY, 4 * EARLY, len(t))]
    if leanings[-1] <= 0 or min(leanings) < 0:
        return False
    (slope, _), covariance = np.polyfit(t, x, 1, cov="unscaled")
    rest = x - np.polyval(np.polyfit(t, x, 1), t)
    left = max(float(np.sqrt(rest @ rest / (len(t) - 2))), TOUCHING)
    if left > RESTLESS * max(noise_level(t, x), TOUCHING):  # it hops
        return False
    error = left * np.sqrt(covariance[0, 0])
    return bool(abs(slope) <= STEEP * error)


def is_aloft(times: Array, values: Array, rest: float) -> bool:
    """Return whether a ball whose height (m,) seems to stay the same hops in truth, hidden by the noise: on the whole
    it is off the height at which it would rest, and varies about its mean by more than the noise does.

    Only both together count: an observer may see every height wrongly, and noise that is correlated varies more than
    its third differences say.
    """
    x = values[: 8 * EARLY]
    noise = noise_level(times[: 8 * EARLY], x)
    return abs(float(np.mean(x)) - rest) > ALOFT * noise and float(np.std(x)) > VARIES * noise


def may_be_supported(world: World, item: RigidObject, run: Run) -> bool:
    """Return whether an object begins so near to another body, or to a fixed one, that this may support it.

    The place is the mean of the first samples. Of other bodies only the balls around them are looked at, and
    deformable ones may be anywhere.
    """
    if world.deformables:
        return True
    place, noise = _first_place(run, item)
    close = noise + CLOSE * geometry.circumscribed_radius(item.shape)
    if _beside_another(world, item, run, close):
        return True
    turns = run.orientations[:, run.names.index(item.name)]
    seen = turns[np.all(np.isfinite(turns), axis=-1)]
    return gap_to_statics(world, item.shape, place, seen[0] if len(seen) else np.asarray(item.orientation)) <= close


def _beside_another(world: World, item: RigidObject, run: Run, close: float) -> bool:
    """Return whether another body begins so near that it may support an object."""
    place, _ = _first_place(run, item)
    size = geometry.circumscribed_radius(item.shape)
    for other in world.objects:
        if other.name != item.name:
            there = _first_place(run, other)[0] if other.name in run.names else np.asarray(other.position)
            if np.linalg.norm(place - there) <= size + geometry.circumscribed_radius(other.shape) + close:
                return True
    return False


def rest_place(world: World, item: RigidObject, run: Run, axis: int) -> float | None:
    """Return where along the axis that gravity is parallel to a ball lies that may be supported by what is fixed below
    it [m].

    A place fitted to noise would let it fall from there, or throw it out of the floor, and it would hop. None where
    this is no ball, nothing fixed is near below it, another body may support it, or gravity leans. Triangle meshes give
    no distance.
    """
    gravity = np.asarray(world.environment.gravity, dtype=float)
    meshes = any(isinstance(s.shape, TriangleMesh) for s in world.statics)
    if not isinstance(item.shape, Sphere) or world.deformables or meshes:
        return None
    if np.count_nonzero(gravity) != 1 or not gravity[axis]:
        return None
    place, noise = _first_place(run, item)
    close = noise + CLOSE * item.shape.radius
    if _beside_another(world, item, run, close):
        return None
    down = np.zeros(3)
    down[axis] = np.sign(gravity[axis])
    falls = [_fall(world.model_copy(update={"statics": (s,)}), item, place - close * down, down) for s in world.statics]
    fall = min(falls, default=np.inf)
    return float(place[axis] + (fall - close) * down[axis]) if fall <= 2.0 * close else None


def _fall(world: World, item: RigidObject, place: Array, down: Array) -> float:
    """Return how far a ball at a place (3,) falls until it touches; infinite where it touches something at once, as a
    wall beside it, or nothing soon."""
    fallen = 0.0
    for _ in range(MOST_STEPS):  # never further than the gap, so never past anything
        gap = gap_to_statics(world, item.shape, place + fallen * down, np.asarray(item.orientation))
        if gap < TOUCHING:
            return fallen if fallen > 0.0 else np.inf
        fallen += gap
    return np.inf


def _first_place(run: Run, item: RigidObject) -> tuple[Array, float]:
    """Return where an object begins (3,), as described where it was not measured, and the largest noise of its
    coordinates."""
    place = np.asarray(item.position, dtype=float)
    largest = 0.0
    for axis, values in enumerate(run.positions[:, run.names.index(item.name)].T):
        seen = values[np.isfinite(values)]
        if len(seen):
            place[axis] = float(np.mean(seen[:EARLY]))
        largest = max(largest, float(np.nan_to_num(noise_level(run.times, values))))
    return place, largest


def is_supported(times: Array, values: Array, acceleration: float) -> bool:
    """Return whether a straight line describes the first samples clearly better than a fall. As many are used as it
    takes to decide; where they do not decide, the body falls."""
    for count in (EARLY, 2 * EARLY, 4 * EARLY):
        leaning = _leaning(times[:count], values[:count], acceleration)
        if leaning:
            return leaning > 0
    return False


def _leaning(times: Array, values: Array, acceleration: float) -> int:
    """Return 1 where a straight line describes the samples (m,) clearly better than a fall, -1 the other way round,
    else 0."""
    if len(times) < 4:
        return 0
    straight, falling = (
        float(np.sum((y - np.polyval(np.polyfit(times, y, 1), times)) ** 2))
        for y in (values, values - 0.5 * acceleration * times**2)
    )
    if max(straight, falling) <= CLEARLY * min(straight, falling):
        return 0
    return 1 if straight < falling else -1
