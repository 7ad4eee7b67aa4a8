"""Coordinates of the initial states of a run, and how they become parameters of the world.

A free body has its position and velocity, its turn where its orientation was measured, and its spin where that or the
orientation was measured, or where it is a ball that lies on something and rubs it. Bodies that joints hold to the world
and to each other have one coordinate and one rate a joint: places and velocities follow.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Run
from polyworld.estimation.initial_support import is_aloft, is_supported, keeps_height, may_be_supported, rest_place
from polyworld.estimation.linkage import Linkage, is_held, linkages
from polyworld.estimation.measured_spin import initial_spin
from polyworld.world import World, geometry
from polyworld.world.materials import material_of
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere
from polyworld.world.symmetry import rotation_vector

Array = NDArray[np.float64]

EARLY = 8  # samples from which a first velocity is taken
SHORT_WINDOWS = (2, 4)  # the same where an impact may follow soon
LENGTH = 0.05  # ordinary change of a position [m], of a velocity [m/s] tenfold
SPIN = 6.0  # ordinary spin of a body whose spin was not measured [rad/s]
TURN = 0.1  # ordinary change of an angle [rad], of a rate [rad/s] tenfold


@dataclass(frozen=True)
class StateCoordinates:
    """The coordinates (N,) of one object's initial state in one run.

    kind: free, or jointed: then they are those of all bodies of a linkage, and named after its first.
    labels (N,). start (N,): first guess. typical (N,): ordinary changes. spread (N,): how far a coordinate of which
    nothing was measured may ordinarily be from zero, else 0. short_window (K, N): estimates from fewer samples, in case
    a body hits something right after the start. known: components that are not fitted: the position of a ball that lies
    on something, a spin that was measured without an orientation.
    """

    name: str
    kind: Literal["free", "jointed"]
    labels: tuple[str, ...]
    start: Array
    typical: Array
    spread: Array
    short_window: Array
    known: Mapping[str, float] = field(default_factory=dict)
    linkage: Linkage | None = None

    def overrides(self, values: Array, given: Mapping[str, Array]) -> dict[str, Array]:
        """Parameter path -> values (k,) for coordinates (k, N); `given`: parameters (k,) that differ from it."""
        if self.linkage is not None:
            return self.linkage.overrides(values, given)
        known = {label: np.full(len(values), v) for label, v in self.known.items()}
        found = {label: values[:, i] for i, label in enumerate(self.labels)}
        return {_path(self.name, label): v for label, v in (known | found).items()}


def _path(name: str, label: str) -> str:
    return label if label.startswith("effects.") else f"objects.{name}.{label}"


def state_coordinates(world: World, run: Run) -> tuple[StateCoordinates, ...]:
    """Return the coordinates of all objects that a run shows, with guesses from its first samples.

    Components that were not measured keep the values of the world's description.
    """
    jointed = linkages(world)
    found = [_jointed(k, run) for k in jointed if any(link.item.name in run.names for link in k.links)]
    owners = dict.fromkeys(name.split("#", 1)[0] for name in run.names)
    for name in owners:
        if not world.is_rigid(name):
            found.append(_deformable(name, world, run))
            continue
        item = world.object(name)
        column = run.names.index(name)
        if not is_held(world, name):
            short_window = np.array([_free(world, item, run, column, count).start for count in SHORT_WINDOWS])
            found.append(replace(_free(world, item, run, column, EARLY), short_window=short_window))
    return tuple(found)


def with_unobserved_spins(world: World, states: tuple[StateCoordinates, ...]) -> tuple[StateCoordinates, ...]:
    """Return coordinates with the spins of balls that nobody measured among them: within a run these are not what a
    run's description says, and show where the balls touch something."""
    if world.planar or not (world.statics or len(world.objects) > 1):
        return states
    found = []
    for own in states:
        known = any(label.startswith("angular_velocity") for label in own.labels)
        is_ball = own.linkage is None and not known and world.is_rigid(own.name)
        if not (is_ball and world.object(own.name).friction):
            found.append(own)
            continue
        none, spread = np.zeros(3), np.full(3, SPIN)
        found.append(
            replace(
                own,
                labels=(*own.labels, *(f"angular_velocity.{a}" for a in "xyz")),
                start=np.concatenate([own.start, none]),
                typical=np.concatenate([own.typical, spread / 6.0]),
                spread=np.concatenate([own.spread, spread]),
                short_window=np.concatenate([own.short_window, np.zeros((len(own.short_window), 3))], axis=1),
            )
        )
    return tuple(found)


def _free(world: World, item: RigidObject, run: Run, column: int, early: int) -> StateCoordinates:
    labels: list[str] = []
    start: list[float] = []
    typical: list[float] = []
    fixed: dict[str, float] = {}
    supports: int | None = None
    planar = item.representation == "rigid_planar"
    normal = np.abs(geometry.plane_axes(world.environment.motion_plane)[2]) if planar else np.zeros(3)
    gravity = np.zeros(3) if planar else np.asarray(world.environment.gravity)
    begin = item.start_time
    times = run.times - run.times[0] + run.lead
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
        if known is not None and not is_aloft(values[rows], known):
            fixed[f"position.{letter}"] = known
            continue
        if supported and known is None:
            labels.append(f"position.{letter}")
            start.append(float(np.mean(values[rows][:EARLY])))
            typical.append(LENGTH)
            continue
        place, speed = _line(times[rows] - begin, values[rows], fall, early)
        labels += [f"position.{letter}", f"velocity.{letter}"]
        start += [place, speed]
        typical += [LENGTH, 10.0 * LENGTH]
    turned, spin = run.orientations[:, column], initial_spin(run, column)
    rows = np.flatnonzero(np.all(np.isfinite(turned), axis=-1) & (times >= begin - 1e-9))
    if len(rows) >= 2:
        first = np.asarray(item.orientation)
        first_rows = rows[:early]
        steps = rotation_vector(turned[first_rows[1:]], turned[first_rows[:-1]]) / np.diff(times[first_rows])[:, None]
        first_spin = np.where(np.isfinite(spin), spin, np.median(steps, axis=0))
        turn = rotation_vector(turned[rows[0]][None], first[None])[0]
        for axis, letter in enumerate("xyz"):
            if planar and normal[axis] < 1.0 - 1e-9:
                continue
            labels += [f"rotation.{letter}", f"angular_velocity.{letter}"]
            start += [float(turn[axis]), float(first_spin[axis])]
            typical += [TURN, 10.0 * TURN]
    else:
        for axis in _measured_axes(run, column, normal):
            labels.append(f"angular_velocity.{'xyz'[axis]}")
            start.append(float(np.nan_to_num(spin[axis])))
            typical.append(10.0 * TURN)
    for effect in world.effects:
        if effect.kind == "unseen_spin_lift" and effect.enabled and item.name in (effect.objects or (item.name,)):
            labels += [f"effects.{effect.name}.rate_{letter}" for letter in "xyz"]
            start += [effect.parameters.get(f"rate_{letter}", 0.0) for letter in "xyz"]
            typical += [10.0 * TURN] * 3
    if supports is not None and isinstance(item.shape, Sphere) and not _known_spin(item, labels):
        rolling = _rolling(item.shape.radius, dict(zip(labels, start, strict=True)), supports, float(gravity[supports]))
        labels += list(rolling)
        start += list(rolling.values())
        typical += [max(SPIN, abs(rate)) for rate in rolling.values()]
    spread = np.zeros(len(labels))
    axis = int(np.argmax(normal))
    label = f"angular_velocity.{'xyz'[axis]}"
    if len(rows) < 2 and planar and label not in labels and _spin_shows(world, item):
        labels.append(label)
        start.append(item.angular_velocity[axis] or 10.0 * TURN)  # at rest no slope shows the direction
        typical.append(10.0 * TURN)
        spread = np.append(spread, SPIN)
    elif len(rows) < 2 and label not in labels and not any(item.angular_velocity) and _is_lifted(world, item):
        axes = [int(np.argmax(normal))] if planar else [0, 1, 2]
        labels += [f"angular_velocity.{'xyz'[axis]}" for axis in axes]
        start += [0.0] * len(axes)
        typical += [SPIN] * len(axes)
        spread = np.append(spread, np.zeros(len(axes)))
    return StateCoordinates(
        item.name,
        "free",
        tuple(labels),
        np.array(start),
        np.array(typical),
        spread,
        np.repeat(np.array(start)[None], len(SHORT_WINDOWS), axis=0),
        fixed,
    )


def _known_spin(item: RigidObject, labels: list[str]) -> bool:
    """Return whether the spin of a body was measured or described, or does nothing without friction."""
    return (
        any(label.startswith("angular_velocity") for label in labels) or any(item.angular_velocity) or not item.friction
    )


def _rolling(radius: float, start: Mapping[str, float], axis: int, gravity: float) -> dict[str, float]:
    """Return the spin [rad/s] by label with which a ball that lies on something rolls as fast as it moves, as most do.

    axis: of gravity [m/s^2]. Components of motions that were not measured are left out.
    """
    up = np.zeros(3)
    up[axis] = -np.sign(gravity)
    found = {}
    for other in range(3):
        speed = start.get(f"velocity.{'xyz'[other]}")
        if other != axis and speed is not None:
            spin = np.cross(up, speed * np.eye(3)[other]) / radius
            about = 3 - axis - other
            found[f"angular_velocity.{'xyz'[about]}"] = float(spin[about])
    return dict(sorted(found.items()))


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


def _jointed(whole: Linkage, run: Run) -> StateCoordinates:
    linkage = whole.of_run(run)
    start = linkage.first_guess(run)
    n = len(start)
    typical = np.tile([TURN, 10.0 * TURN], n // 2)
    short_window = np.repeat(start[None], len(SHORT_WINDOWS), axis=0)
    name = linkage.links[0].item.name
    return StateCoordinates(name, "jointed", linkage.labels, start, typical, np.zeros(n), short_window, linkage=linkage)


def _deformable(name: str, world: World, run: Run) -> StateCoordinates:
    """Return where a deformable object begins and how fast, as a whole: its shape at the start is the world's.

    What is held somewhere, and fluids, start as the world says: they cannot be shifted off what holds them.
    """
    fixed = any(a.object == name for a in world.attachments) or any(p.rope == name for p in world.pulleys)
    fixed = fixed or material_of(world.deformable(name)).form == "liquid"
    labels = [] if fixed else [f"{field}.{axis}" for axis in "xyz" for field in ("shift", "velocity")]
    if world.planar:
        normal = np.abs(geometry.plane_axes(world.environment.motion_plane)[2])
        labels = [label for label in labels if normal["xyz".index(label[-1])] < 1.0 - 1e-9]
    columns = [k for k, n in enumerate(run.names) if n.split("#", 1)[0] == name]
    seen = np.isfinite(run.positions[:, columns]).sum(axis=(0, 1)) >= 2
    labels = [label for label in labels if seen["xyz".index(label[-1])]]
    velocity = getattr(world.item(name), "velocity", (0.0, 0.0, 0.0))
    start = np.array([0.0 if label.startswith("shift") else velocity["xyz".index(label[-1])] for label in labels])
    typical = np.array([LENGTH if label.startswith("shift") else 10.0 * LENGTH for label in labels])
    short_window = np.repeat(start[None], len(SHORT_WINDOWS), axis=0)
    return StateCoordinates(name, "free", tuple(labels), start, typical, np.zeros(len(labels)), short_window)


def _line(times: Array, values: Array, acceleration: float, early: int) -> tuple[float, float]:
    """Value and slope at time 0 of so many first samples (m,): with the curvature of a free fall, or with none where
    they say that the body is supported."""
    if acceleration and is_supported(times, values, acceleration):
        acceleration = 0.0
    times, values = times[:early], values[:early] - 0.5 * acceleration * times[:early] ** 2
    slope, place = np.polyfit(times, values, 1)
    return float(place), float(slope)
