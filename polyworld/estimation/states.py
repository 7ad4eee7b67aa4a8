"""Coordinates of initial states: of free bodies, bodies on a surface, linkages of joints, deformables.

A body has its place and velocity; its turn where that was measured, and its spin where that or the turn was measured or
its path depends on it. On a surface it moves along that, turns about its normal, and rolls. Bodies that joints hold to
the world and to each other have one coordinate and one rate a joint. How bodies begin is read off a stretch of tracks
(`stretch_state`) or off a run of a recording (`state_coordinates`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.initial_states import FIRST, InitialState, first_value, initial_states, line_or_fall
from polyworld.data.recording import Run
from polyworld.estimation.declared import SKIDS, Rolling, can_roll
from polyworld.estimation.fit_settings import Gaussian, PriorSettings
from polyworld.estimation.linkage import is_held, linkages
from polyworld.estimation.readout import owner
from polyworld.estimation.stretches import Stretch
from polyworld.estimation.support import Support, rolling_spin, support_in_run, supports
from polyworld.estimation.unknown import Guess, StateMap, free_axes, joined, of_paths
from polyworld.world import Effect, World, geometry
from polyworld.world.materials import material_of
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere
from polyworld.world.symmetry import rotation_vector

Array = NDArray[np.float64]

LENGTH = 0.05  # ordinary change of a position [m], of a velocity [m/s] tenfold
SPIN = 6.0  # ordinary spin of a body whose spin was not measured [rad/s]
TURN = 0.1  # ordinary change of an angle [rad], of a rate [rad/s] tenfold
STEEPEST = 0.2  # slip of a rolling start, as a share of its spin


@dataclass(frozen=True)
class Beginning:
    """How a body begins. axes: along which its place is a coordinate. turn (3,) [rad]: from its described orientation,
    None where it was not measured. about: axes about which it may turn; spun: those about which its spin was measured.
    unseen: axis -> first guess, ordinary change and deviation of a prior about `spin`, where it shows otherwise."""

    position: Array
    velocity: Array
    axes: Sequence[int]
    moves: bool
    turn: Array | None
    about: Sequence[int]
    spin: Array
    spun: Sequence[int]
    unseen: Mapping[int, tuple[float, float, float]] = field(default_factory=dict)


def stretch_state(stretch: Stretch, settings: PriorSettings, rolling: Rolling) -> StateMap:
    """Return the coordinates of a stretch's initial state, from the one that its world has.

    Never observed: as the world has them.
    """
    world, tracks = stretch.world, stretch.tracks
    seen = initial_states(tracks, seconds_per_frame=world.time.seconds_per_frame, gravity=world.environment.gravity)
    on = supports(world, tracks)
    parts: list[StateMap] = []
    if world.joints:
        run = Run.of_tracks("run", tracks)
        parts += linkage_states(world, run.columns([i for i, n in enumerate(run.names) if world.is_rigid(n)]))
    for item in world.objects:
        state = seen.get(item.name)
        if state is not None and stretch.carried:  # a collision may leave a speed that looks like rest
            state = replace(state, moves=True)
        if is_held(world, item.name) or (state is None and not stretch.carried):
            continue
        symmetry = tracks.symmetry[tracks.index(item.name)] if item.name in tracks.names else 0
        begins, support = _of_track(world, item, state, symmetry, settings), on.get(item.name)
        parts.append(_supported(item, begins, support, rolling, settings) if support else _free(item, begins))
    loose = [d for d in world.deformables if d.name in tracks.observed_names and material_of(d).turns]
    return joined([*parts, *(deformable_state(world, d.name, free_axes(world)) for d in loose)])


def _of_track(
    world: World, item: RigidObject, state: InitialState | None, symmetry: int, settings: PriorSettings
) -> Beginning:
    moves = state is None or state.moves
    turned = state is not None and state.orientation is not None and symmetry != 0
    unseen = moves and not turned and state is not None and can_roll(item) and not world.planar
    sd = settings.surface_speed / float(getattr(item.shape, "radius", 1.0))
    spin = np.asarray(item.angular_velocity)
    return Beginning(
        np.asarray(item.position),
        np.asarray(item.velocity),
        ["xyz".index(a) for a in free_axes(world)],
        moves,
        np.zeros(3) if turned else None,
        _about(world),
        spin,
        _about(world) if moves and turned else (),
        {a: (float(spin[a]), 0.2 * sd, sd) for a in range(3)} if unseen else {},
    )


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
            item = world.object(name)
            begins, support = _of_run(world, item, run), support_in_run(world, item, run)
            if support is not None:
                rolls = support.rolls and item.friction > 0.0 and not any(item.angular_velocity)
                support = replace(support, rolls=rolls, turns=bool(begins.spun) and isinstance(item.shape, Sphere))
                found.append(_supported(item, begins, support, "rolls", PriorSettings()))
            else:
                found.append(_free(item, begins))
            found += _of_effects(world, item)
    return tuple(found)


def _of_run(world: World, item: RigidObject, run: Run) -> Beginning:
    column = run.names.index(item.name)
    times, places = run.times - run.times[0] + run.lead - item.start_time, run.positions[:, column]
    present = times >= -1e-9
    gravity = np.zeros(3) if world.planar else np.asarray(world.environment.gravity)
    position, velocity = np.array(item.position), np.array(item.velocity)
    axes = [a for a in ("xyz".index(a) for a in free_axes(world)) if np.isfinite(places[present, a]).sum() >= 2]
    for a in axes:
        rows = present & np.isfinite(places[:, a])
        position[a], velocity[a] = line_or_fall(times[rows], places[rows, a], float(gravity[a]))
    series = run.angular_velocities[:, column]
    spin = np.array([first_value(run.times, column) for column in series.T])
    about, turn = _about(world), None
    spun = [a for a in np.flatnonzero(np.isfinite(spin)).tolist() if not world.planar or a in about]
    rows = np.flatnonzero(np.isfinite(run.orientations[:, column]).all(axis=-1) & present)[:FIRST]
    if len(rows) >= 2:
        early = run.orientations[rows, column]
        steps = rotation_vector(early[1:], early[:-1]) / np.diff(times[rows])[:, None]
        spin, spun = np.where(np.isfinite(spin), spin, np.median(steps, axis=0)), about
        turn = rotation_vector(early[:1], np.asarray(item.orientation)[None])[0]
    spin = np.where(np.isfinite(spin), spin, item.angular_velocity)
    unseen: dict[int, tuple[float, float, float]] = {}
    if turn is None and world.planar and _spin_shows(world, item):  # at rest no slope shows the direction
        unseen = {a: (float(spin[a]) or 10.0 * TURN, 10.0 * TURN, SPIN) for a in about if a not in spun}
    elif turn is None and not any(item.angular_velocity) and _is_lifted(world, item):
        unseen = {a: (0.0, SPIN, np.inf) for a in about if a not in spun}
    return Beginning(position, velocity, axes, True, turn, about, spin, spun, unseen)


def _of_effects(world: World, item: RigidObject) -> list[StateMap]:
    """Return spins of a body that effects have of their own, since they are no motion that shows otherwise."""
    own = [e for e in _acting(world, item) if e.kind == "unseen_spin_lift"]
    rates = [(e, f"rate_{a}") for e in own for a in "xyz"]
    paths = {f"effects.{e.name}.{rate}": (e.parameters.get(rate, 0.0), 10.0 * TURN) for e, rate in rates}
    return [of_paths(paths)] if paths else []


def _acting(world: World, item: RigidObject) -> list[Effect]:
    return [e for e in world.effects if e.enabled and item.name in (e.objects or (item.name,))]


def _is_lifted(world: World, item: RigidObject) -> bool:
    """Return whether the path of a body in flight depends on its spin."""
    return any(e.kind == "magnus_lift" and e.parameters.get("coefficient") for e in _acting(world, item))


def _spin_shows(world: World, item: RigidObject) -> bool:
    """Return whether the path of a body on a motion plane depends on a spin that nobody measured: through friction of
    its contacts, or through a patch that both slides and spins."""
    plane = world.environment.motion_plane
    rubs = plane.supports and plane.friction != 0.0 and item.torsional_radius != 0.0
    return item.friction > 0.0 and (rubs or len(world.objects) + len(world.statics) > 1)


def _free(item: RigidObject, begins: Beginning) -> StateMap:
    """Return a body's place, its velocity if it moves, its turn where that was measured, and a spin that may matter."""
    found: dict[str, Guess] = {f"position.{'xyz'[a]}": (float(begins.position[a]), LENGTH) for a in begins.axes}
    if begins.moves:
        found |= {f"velocity.{'xyz'[a]}": (float(begins.velocity[a]), 10.0 * LENGTH) for a in begins.axes}
    if begins.turn is not None:
        found |= {f"rotation.{'xyz'[a]}": (float(begins.turn[a]), TURN) for a in begins.about}
    found |= {f"angular_velocity.{'xyz'[a]}": (float(begins.spin[a]), 10.0 * TURN) for a in begins.spun}
    priors: dict[str, Gaussian] = {}
    for a, (start, typical, sd) in begins.unseen.items():
        found[f"angular_velocity.{'xyz'[a]}"] = start, typical
        priors[f"angular_velocity.{'xyz'[a]}"] = float(begins.spin[a]), sd
    head = f"objects.{item.name}."
    return of_paths({head + k: v for k, v in found.items()}, {head + k: v for k, v in priors.items()})


def _supported(
    item: RigidObject, begins: Beginning, support: Support, rolling: Rolling, settings: PriorSettings
) -> StateMap:
    """Return a body's place and velocity along its support, heading about the normal, and how much its spin slips."""
    n, head = support.normal, f"objects.{item.name}."
    across = [a for a in range(3) if a != int(np.argmax(np.abs(n)))]
    tangents = np.eye(3)[across] - np.outer(n[across], n)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    if abs(float(tangents[0] @ tangents[1])) > 1e-12:
        tangents[1] = np.cross(n, tangents[0])
    kept = [k for k, a in enumerate(across) if a in begins.axes]
    level = [k for k in kept if tangents[k].max() > 1.0 - 1e-12]  # along a world axis, whose coordinate is kept
    names = ["xyz"[across[k]] if k in level else str(k + 1) for k in kept]
    first = np.array([tangents[k] @ support.position if k in level else 0.0 for k in kept])
    tangents = tangents[kept]
    moves, ball = begins.moves, isinstance(item.shape, Sphere)
    heading = begins.turn is not None and not ball and len(begins.about) == 3  # none in a plane across the surface
    rolls = support.rolls and moves and not support.turns
    phased = heading and rolls and support.axis is not None  # how far it has rolled shows
    ratio = 1.0 if rolling == "rolls" else 0.0
    found: dict[str, Guess] = {f"position.{k}": (float(v), LENGTH) for k, v in zip(names, first, strict=True)}
    if moves:
        speeds = np.linalg.lstsq(tangents.T, begins.velocity, rcond=None)[0]
        found |= {f"velocity.{k}": (float(v), 10.0 * LENGTH) for k, v in zip(names, speeds, strict=True)}
    found |= {angle: (0.0, TURN) for angle, shown in (("heading", heading), ("phase", phased)) if shown}
    if heading and moves:
        found["turning"] = (float(begins.spin @ n), 10.0 * TURN)
    if ball and begins.turn is not None:
        found |= {f"rotation.{'xyz'[a]}": (float(begins.turn[a]), TURN) for a in begins.about}
    if support.turns and moves:
        found |= {f"angular_velocity.{'xyz'[a]}": (float(begins.spin[a]), 10.0 * TURN) for a in begins.spun}
    if rolls and rolling != "skids":
        found["roll"] = (ratio, STEEPEST)
    frame = of_paths(found, {"roll": (ratio, settings.slip)})
    index, described = {label: i for i, label in enumerate(found)}, np.asarray(item.orientation)
    beside = begins.velocity - n * (n @ begins.velocity) - tangents.T @ (tangents @ begins.velocity)  # not measured

    def overrides(values: Array, _: Mapping[str, Array]) -> dict[str, Array]:
        count, along = len(tangents), np.zeros((len(values), 3))
        place = support.position + (values[:, :count] - first) @ tangents
        if moves:
            along = beside + values[:, count : 2 * count] @ tangents
        spin = np.tile(np.zeros(3) if rolls or heading else begins.spin, (len(values), 1))
        headings = values[:, index["heading"]] if heading else np.zeros(len(values))
        if "roll" in index:
            rolled = np.array([rolling_spin(item, support.headed(h), v) for h, v in zip(headings, along, strict=True)])
            spin = rolled * values[:, [index["roll"]]]
        if "turning" in index:
            spin = spin + values[:, [index["turning"]]] * n
        paths: dict[str, Array] = {}
        for k, a in enumerate("xyz"):
            paths[f"{head}position.{a}"], paths[f"{head}velocity.{a}"] = place[:, k], along[:, k]
            about = f"angular_velocity.{a}"
            paths[head + about] = values[:, index[about]] if about in index else spin[:, k]
            if f"rotation.{a}" in index:
                paths[f"{head}rotation.{a}"] = values[:, index[f"rotation.{a}"]]
        if heading:
            turn = geometry.rotation_quaternion(headings[:, None] * n)
            if phased:
                phase = geometry.rotation_quaternion(values[:, [index["phase"]]] * np.asarray(support.axis))
                turn = geometry.quaternion_product(turn, phase)
            turn = rotation_vector(geometry.quaternion_product(turn, support.orientation), described)
            paths |= {f"{head}rotation.{a}": turn[:, k] for k, a in enumerate("xyz")}
        if rolls and rolling == "skids":
            paths[f"{head}rolling_resistance"] = np.full(len(values), SKIDS * getattr(item.shape, "radius", 1.0))
        return paths

    return replace(frame, labels=tuple(f"{item.name}.{label}" for label in found), overrides=overrides)


def linkage_states(world: World, run: Run) -> tuple[StateMap, ...]:
    """Return the coordinates of the linkages of which a run shows a body."""
    found = []
    for whole in linkages(world):
        if any(link.item.name in run.names for link in whole.links):
            linkage = whole.of_run(run)
            labels = tuple(f"{linkage.links[0].item.name}.{label}" for label in linkage.labels)
            typical, prior = np.tile([TURN, 10.0 * TURN], len(labels) // 2), np.tile([0.0, np.inf], (len(labels), 1))
            found.append(StateMap(labels, linkage.first_guess(run), typical, prior, linkage.overrides))
    return tuple(found)


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


def _about(world: World) -> list[int]:
    """World axes about which objects turn."""
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    return [int(np.argmax(np.abs(normal)))] if world.planar else [0, 1, 2]
