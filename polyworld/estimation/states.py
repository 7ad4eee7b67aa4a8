"""Coordinates of the initial state of a run, with guesses from its first samples.

A free body has its position and velocity, its turn where its orientation was measured, and its spin where that or the
orientation was measured, or where it is a ball that lies on something and rubs it. Bodies that joints hold to the world
and to each other have one coordinate and one rate a joint: places and velocities follow.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from polyworld.data.noise import noise_level
from polyworld.data.recording import Run
from polyworld.estimation.initial_support import (
    EARLY,
    is_aloft,
    is_supported,
    keeps_height,
    may_be_supported,
    rest_place,
)
from polyworld.estimation.linkage import is_held, linkages
from polyworld.estimation.readout import owner
from polyworld.estimation.unknown import Guess, StateMap, of_paths
from polyworld.world import World, geometry
from polyworld.world.materials import material_of
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere
from polyworld.world.symmetry import rotation_vector

Array = NDArray[np.float64]

LENGTH = 0.05  # ordinary change of a position [m], of a velocity [m/s] tenfold
SPIN = 6.0  # ordinary spin of a body whose spin was not measured [rad/s]
TURN = 0.1  # ordinary change of an angle [rad], of a rate [rad/s] tenfold
ERRORS = 3.0  # standard errors of a sum of squares, beyond which what a line leaves is not noise


def state_coordinates(world: World, run: Run) -> tuple[StateMap, ...]:
    """Return the coordinates of all objects that a run shows.

    Components that were not measured keep the values of the world's description.
    """
    found = [*linkage_states(world, run)]
    for name in dict.fromkeys(owner(name) for name in run.names):
        if not world.is_rigid(name):
            columns = [k for k, n in enumerate(run.names) if owner(n) == name]
            seen = np.isfinite(run.positions[:, columns]).sum(axis=(0, 1)) >= 2
            found.append(deformable_state(world, name, "".join(a for a in free_axes(world) if seen["xyz".index(a)])))
        elif not is_held(world, name):
            found.append(_free(world, world.object(name), run))
    return tuple(found)


def linkage_states(world: World, run: Run) -> tuple[StateMap, ...]:
    """Return the coordinates of the linkages of which a run shows a body."""
    found = []
    for whole in linkages(world):
        if any(link.item.name in run.names for link in whole.links):
            linkage = whole.of_run(run)
            start, n = linkage.first_guess(run), len(linkage.labels)
            labels = tuple(f"{linkage.links[0].item.name}.{label}" for label in linkage.labels)
            typical = np.tile([TURN, 10.0 * TURN], n // 2)
            found.append(StateMap(labels, start, typical, np.tile([0.0, np.inf], (n, 1)), linkage.overrides))
    return tuple(found)


def _free(world: World, item: RigidObject, run: Run) -> StateMap:
    column, begin = run.names.index(item.name), item.start_time
    planar = item.representation == "rigid_planar"
    normal = np.abs(geometry.plane_axes(world.environment.motion_plane)[2]) if planar else np.zeros(3)
    times = run.times - run.times[0] + run.lead
    gravity = np.zeros(3) if planar else np.asarray(world.environment.gravity)
    found: dict[str, Guess] = {}
    fixed: dict[str, float] = {}
    widths: dict[str, float] = {}
    supports: int | None = None
    for axis, letter in enumerate("xyz"):
        values = run.positions[:, column, axis]
        rows = np.flatnonzero(np.isfinite(values) & (times >= begin - 1e-9))
        if len(rows) < 2 or normal[axis] > 1.0 - 1e-9:
            continue
        fall = float(gravity[axis])
        level = item.velocity[axis] == 0.0 and keeps_height(times[rows] - begin, values[rows], fall)
        supported = level and may_be_supported(world, item, run)
        supports = axis if supported else supports
        known = rest_place(world, item, run, axis) if supported else None
        if known is not None and not is_aloft(times[rows], values[rows], known):
            fixed[f"position.{letter}"] = known
            continue
        if supported and known is None:
            found[f"position.{letter}"] = float(np.mean(values[rows][:EARLY])), LENGTH
            continue
        place, speed = _line(times[rows] - begin, values[rows], fall)
        found |= {f"position.{letter}": (place, LENGTH), f"velocity.{letter}": (speed, 10.0 * LENGTH)}
    turned, spin = run.orientations[:, column], initial_spin(run, column)
    rows = np.flatnonzero(np.all(np.isfinite(turned), axis=-1) & (times >= begin - 1e-9))
    if len(rows) >= 2:
        early = turned[rows[:EARLY]]
        steps = rotation_vector(early[1:], early[:-1]) / np.diff(times[rows[:EARLY]])[:, None]
        spin = np.where(np.isfinite(spin), spin, np.median(steps, axis=0))
        turn = rotation_vector(early[:1], np.asarray(item.orientation)[None])[0]
        for axis, letter in enumerate("xyz"):
            if not planar or normal[axis] > 1.0 - 1e-9:
                found[f"rotation.{letter}"] = float(turn[axis]), TURN
                found[f"angular_velocity.{letter}"] = float(spin[axis]), 10.0 * TURN
    else:
        for axis in _measured_axes(run, column, normal):
            found[f"angular_velocity.{'xyz'[axis]}"] = float(np.nan_to_num(spin[axis])), 10.0 * TURN
    if supports is not None and isinstance(item.shape, Sphere) and item.friction and not _known_spin(item, found):
        found |= _rolling(item.shape.radius, found, supports, float(gravity[supports]))
    if len(rows) < 2 and planar and _spin_shows(world, item):
        axis = int(np.argmax(normal))
        label = f"angular_velocity.{'xyz'[axis]}"
        if label not in found:  # at rest no slope shows the direction
            found[label] = item.angular_velocity[axis] or 10.0 * TURN, 10.0 * TURN
            widths[label] = SPIN
    elif len(rows) < 2 and not any(item.angular_velocity) and _is_lifted(world, item):
        axes = [int(np.argmax(normal))] if planar else [0, 1, 2]
        found = {f"angular_velocity.{'xyz'[axis]}": (0.0, SPIN) for axis in axes} | found
    head = f"objects.{item.name}."
    paths = {head + label: guess for label, guess in found.items()}
    for effect in world.effects:
        if effect.kind == "unseen_spin_lift" and effect.enabled and item.name in (effect.objects or (item.name,)):
            rates = [f"rate_{letter}" for letter in "xyz"]
            own = {f"effects.{effect.name}.{r}": (effect.parameters.get(r, 0.0), 10.0 * TURN) for r in rates}
            paths |= own
    return of_paths(paths, {head + k: (0.0, v) for k, v in widths.items()}, {head + k: v for k, v in fixed.items()})


def _known_spin(item: RigidObject, found: Mapping[str, Guess]) -> bool:
    """Return whether the spin of a body was measured or described."""
    return any(label.startswith("angular_velocity") for label in found) or any(item.angular_velocity)


def _rolling(radius: float, found: Mapping[str, Guess], axis: int, gravity: float) -> dict[str, Guess]:
    """Return the spin [rad/s] by label with which a ball that lies on something rolls as fast as it moves, as most do.

    axis: of gravity [m/s^2]. Components of motions that were not measured are left out.
    """
    up = np.zeros(3)
    up[axis] = -np.sign(gravity)
    rolling: dict[str, Guess] = {}
    for other in range(3):
        label = f"velocity.{'xyz'[other]}"
        if other != axis and label in found:
            about = 3 - axis - other
            rate = float(np.cross(up, found[label][0] * np.eye(3)[other])[about] / radius)
            rolling[f"angular_velocity.{'xyz'[about]}"] = rate, max(SPIN, abs(rate))
    return dict(sorted(rolling.items()))


def _measured_axes(run: Run, column: int, normal: Array) -> list[int]:
    """Return axes along which the spin of an object was measured and may differ from zero; normal (3,): of its motion
    plane, zero for bodies that move in space."""
    axes = np.flatnonzero(np.isfinite(run.angular_velocities[:, column]).any(axis=0)).tolist()
    return [a for a in axes if not normal.any() or a == int(np.argmax(normal))]


def _is_lifted(world: World, item: RigidObject) -> bool:
    """Return whether the path of a body in flight depends on its spin."""
    return any(
        e.kind == "magnus_lift"
        and e.enabled
        and e.parameters.get("coefficient")
        and item.name in (e.objects or (item.name,))
        for e in world.effects
    )


def _spin_shows(world: World, item: RigidObject) -> bool:
    """Return whether the path of a body on a motion plane depends on a spin that nobody measured: through friction of
    its contacts, or through a patch that both slides and spins."""
    plane = world.environment.motion_plane
    meets = item.friction > 0.0 and len(world.objects) + len(world.statics) > 1
    rubs = plane.supports and item.friction > 0.0 and plane.friction != 0.0
    return meets or (rubs and item.torsional_radius != 0.0)


def initial_spin(run: Run, column: int) -> Array:
    """Return the first angular velocity (3,) [rad/s] of an object, world axes; NaN for components never measured.

    It is read off the straight line that describes as many of the first samples as it can within their noise: noise
    averages out, and where the spin decays or an impact changes it, the line ends.
    """
    spin = np.full(3, np.nan)
    for axis, course in enumerate(run.angular_velocities[:, column].T):
        seen = np.isfinite(course)
        if seen.any():
            spin[axis] = _first_value(run.times[seen] - run.times[seen][0], course[seen])
    return spin


def _first_value(times: Array, values: Array) -> float:
    first, count, noise = float(values[0]), EARLY, float(np.nan_to_num(noise_level(times, values)))
    while count <= len(values):
        line = np.polyfit(times[:count], values[:count], 1)
        rest = values[:count] - np.polyval(line, times[:count])
        free = count - 2
        if float(rest @ rest) > noise**2 * (free + ERRORS * np.sqrt(2.0 * free)):
            break
        first = float(line[1])
        if count == len(values):
            break
        count = min(2 * count, len(values))
    return first


def deformable_state(world: World, name: str, axes: str) -> StateMap:
    """Return where a deformable object begins and how fast, as a whole: its shape at the start is the world's.

    axes: along which it moves. What is held somewhere, and fluids, start as the world says: they cannot be shifted off
    what holds them.
    """
    held = any(name in (a.object, a.to) for a in world.attachments) or any(p.rope == name for p in world.pulleys)
    if held or material_of(world.deformable(name)).form == "liquid":
        return of_paths({})
    velocity = getattr(world.item(name), "velocity", (0.0, 0.0, 0.0))
    found: dict[str, Guess] = {f"objects.{name}.shift.{a}": (0.0, LENGTH) for a in axes}
    return of_paths(found | {f"objects.{name}.velocity.{a}": (velocity["xyz".index(a)], 10.0 * LENGTH) for a in axes})


def free_axes(world: World) -> str:
    """World axes along which objects move: an oblique motion plane needs all three to be varied."""
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    return "".join(a for i, a in enumerate("xyz") if not (world.planar and abs(normal[i]) > 1.0 - 1e-9))


def _line(times: Array, values: Array, acceleration: float) -> tuple[float, float]:
    """Return value and slope at time 0 of the first samples (m,): with the curvature of a free fall, or with none where
    they say that the body is supported."""
    if acceleration and is_supported(times, values, acceleration):
        acceleration = 0.0
    times, values = times[:EARLY], values[:EARLY] - 0.5 * acceleration * times[:EARLY] ** 2
    slope, place = np.polyfit(times, values, 1)
    return float(place), float(slope)
