"""Initial states of a stretch as coordinates: free bodies, bodies on a surface, linkages of joints, deformables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.initial_states import InitialState, initial_states
from polyworld.data.recording import Run
from polyworld.estimation.declared import SKIDS, Rolling, can_roll
from polyworld.estimation.fit_settings import PriorSettings
from polyworld.estimation.states import linkage_states
from polyworld.estimation.stretches import Stretch
from polyworld.estimation.support import Support, rolling_spin, supports
from polyworld.estimation.unknown import StateMap, Unknown, joined, of_paths
from polyworld.world import World, geometry
from polyworld.world.materials import material_of
from polyworld.world.parameters import specification
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere
from polyworld.world.symmetry import rotation_vector

Array = NDArray[np.float64]

PLACE, SPEED, TURN, SPIN = 0.01, 0.1, 0.05, 0.5  # ordinary changes [m], [m/s], [rad], [rad/s]
UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])
STEEPEST = 0.2  # slip of a rolling start, as a share of its spin


def initial_state(stretch: Stretch, settings: PriorSettings, rolling: Rolling, *, free: bool = True) -> StateMap:
    """Return the coordinates of a stretch's initial state.

    Places of all tracked bodies and velocities of those that move; headings and spins where they were measured. Bodies
    on a surface move along it. Never observed: as the world has them. Not `free`: none.
    """
    if not free:
        return joined([])
    world, tracks = stretch.world, stretch.tracks
    seen = initial_states(tracks, seconds_per_frame=world.time.seconds_per_frame, gravity=world.environment.gravity)
    on = supports(world, tracks)
    parts: list[StateMap] = []
    held = {n for j in world.joints if j.kind != "spring" for n in (j.object, j.other)}
    if held:
        run = Run.of_tracks("run", tracks)
        rigid = [i for i, n in enumerate(run.names) if world.is_rigid(n)]
        parts += linkage_states(world, run.columns(rigid))
    for item in world.objects:
        state = seen.get(item.name)
        if state is not None and stretch.carried:  # a collision may leave a speed that looks like rest
            state = replace(state, moves=True)
        if item.name in held or (state is None and not stretch.carried):
            continue
        symmetry = tracks.symmetry[tracks.index(item.name)] if item.name in tracks.names else 0
        support = on.get(item.name)
        if support is not None and state is not None:
            parts.append(_supported(item, state, support, symmetry, settings, rolling))
        else:
            parts.append(of_paths(_free(world, item, state, symmetry, settings)))
    for soft in world.deformables:
        tied = any(soft.name in (a.object, a.to) for a in world.attachments)
        if soft.name in tracks.observed_names and material_of(soft).turns and not tied:
            fields = (("shift", PLACE * 2.0), ("velocity", SPEED * 2.0))
            parts.append(
                of_paths([_state(world, soft.name, f"{f}.{a}", 0.0, sd) for f, sd in fields for a in free_axes(world)])
            )
    return joined(parts)


def free_axes(world: World) -> str:
    """World axes along which objects move: an oblique motion plane needs all three to be varied."""
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    return "".join(a for i, a in enumerate("xyz") if not (world.planar and abs(normal[i]) > 1.0 - 1e-9))


def _state(
    world: World, name: str, field: str, start: float, typical: float, prior: tuple[float, float] | None = None
) -> Unknown:
    path = f"objects.{name}.{field}"
    spec = specification(world, path)
    return Unknown(f"{name}.{field}", (path,), spec.unit, start, spec.lower, spec.upper, typical, prior=prior)


def _free(
    world: World, item: RigidObject, state: InitialState | None, symmetry: int, settings: PriorSettings
) -> list[Unknown]:
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    moves = state is None or state.moves
    found = [_state(world, item.name, f"position.{a}", item.position["xyz".index(a)], PLACE) for a in free_axes(world)]
    if moves:
        found += [
            _state(world, item.name, f"velocity.{a}", item.velocity["xyz".index(a)], SPEED) for a in free_axes(world)
        ]
    about = "xyz"[int(np.argmax(np.abs(normal)))] if world.planar else "xyz"
    turned = state is not None and state.orientation is not None and symmetry != 0
    if turned:
        found += [_state(world, item.name, f"rotation.{a}", 0.0, TURN) for a in about]
    if moves and turned:
        rates = item.angular_velocity
        found += [_state(world, item.name, f"angular_velocity.{a}", rates["xyz".index(a)], SPIN) for a in about]
    elif moves and not world.planar and can_roll(item) and state is not None:
        sd = settings.surface_speed / float(getattr(item.shape, "radius", 1.0))
        rates = item.angular_velocity
        found += [
            _state(
                world, item.name, f"angular_velocity.{a}", rates["xyz".index(a)], 0.2 * sd, (rates["xyz".index(a)], sd)
            )
            for a in "xyz"
        ]
    return found


def _supported(
    item: RigidObject, state: InitialState, support: Support, symmetry: int, settings: PriorSettings, rolling: Rolling
) -> StateMap:
    """Return a body's place and velocity along its support, heading about the normal, and how much its spin slips."""
    n, head = support.normal, f"objects.{item.name}."
    tangents = np.eye(3)[[k for k in range(3) if k != int(np.argmax(np.abs(n)))]]
    tangents = tangents - np.outer(tangents @ n, n)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    if abs(float(tangents[0] @ tangents[1])) > 1e-12:
        tangents[1] = np.cross(n, tangents[0])
    moves = state.moves
    labels, start, typical = ["along.1", "along.2"], [0.0, 0.0], [PLACE, PLACE]
    prior = [[0.0, np.inf]] * 2
    velocity = np.asarray(item.velocity)
    if moves:
        labels += ["speed.1", "speed.2"]
        basis = np.linalg.lstsq(tangents.T, velocity, rcond=None)[0]
        start, typical, prior = (
            [*start, *(float(v) for v in basis)],
            [*typical, SPEED, SPEED],
            [*prior, *[[0.0, np.inf]] * 2],
        )
    heading = state.orientation is not None and symmetry != 0 and not isinstance(item.shape, Sphere)
    if heading:
        labels, start, typical, prior = [*labels, "heading"], [*start, 0.0], [*typical, TURN], [*prior, [0.0, np.inf]]
    rolls = support.rolls and moves and not support.turns
    phased = heading and rolls and support.axis is not None  # how far it has rolled shows
    if phased:
        labels, start, typical, prior = [*labels, "phase"], [*start, 0.0], [*typical, TURN], [*prior, [0.0, np.inf]]
    spins = heading and moves
    if spins:
        rate = float(np.asarray(item.angular_velocity) @ n)
        labels, start, typical, prior = [*labels, "turning"], [*start, rate], [*typical, SPIN], [*prior, [0.0, np.inf]]
    if support.turns:
        labels, start, typical = (
            [*labels, *(f"rotation.{a}" for a in "xyz")],
            [*start, *[0.0] * 3],
            [*typical, *[TURN] * 3],
        )
        prior = [*prior, *[[0.0, np.inf]] * 3]
        if moves:
            labels, typical = [*labels, *(f"spin.{a}" for a in "xyz")], [*typical, *[SPIN] * 3]
            start, prior = [*start, *(float(v) for v in item.angular_velocity)], [*prior, *[[0.0, np.inf]] * 3]
    ratio = 1.0 if rolling == "rolls" else 0.0
    if rolls and rolling != "skids":
        labels, start, typical, prior = (
            [*labels, "roll"],
            [*start, ratio],
            [*typical, STEEPEST],
            [*prior, [ratio, settings.slip]],
        )
    index = {label: i for i, label in enumerate(labels)}
    radius = float(getattr(item.shape, "radius", 1.0))

    def overrides(values: Array, _: Mapping[str, Array]) -> dict[str, Array]:
        count = len(values)
        place = support.position + values[:, :2] @ tangents
        along = values[:, 2:4] @ tangents if moves else np.zeros((count, 3))
        spin = np.zeros((count, 3))
        found: dict[str, Array] = {}
        if "roll" in index:
            headings = values[:, index["heading"]] if heading else np.zeros(count)
            rolled = np.array([rolling_spin(item, support.headed(h), v) for h, v in zip(headings, along, strict=True)])
            spin = rolled * values[:, [index["roll"]]]
        if "turning" in index:
            spin = spin + values[:, [index["turning"]]] * n
        if "spin.x" in index:
            spin = values[:, index["spin.x"] : index["spin.x"] + 3]
        turned = values[:, [index["heading"]]] * n if heading else np.zeros((count, 3))
        if phased:
            about = geometry.rotation_quaternion(values[:, [index["phase"]]] * np.asarray(support.axis))
            turned = rotation_vector(geometry.quaternion_product(geometry.rotation_quaternion(turned), about), UNTURNED)
        for k, a in enumerate("xyz"):
            found[f"{head}position.{a}"], found[f"{head}velocity.{a}"] = place[:, k], along[:, k]
            found[f"{head}angular_velocity.{a}"] = spin[:, k]
            if heading:
                found[f"{head}rotation.{a}"] = turned[:, k]
            elif support.turns:
                found[f"{head}rotation.{a}"] = values[:, index[f"rotation.{a}"]]
        if rolls and rolling == "skids":
            found[f"{head}rolling_resistance"] = np.full(count, SKIDS * radius)
        return found

    names = tuple(f"{item.name}.{label}" for label in labels)
    return StateMap(names, np.array(start), np.array(typical), np.array(prior, dtype=float), overrides)
