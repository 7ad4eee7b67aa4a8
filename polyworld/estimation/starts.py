"""Initial states of a stretch as coordinates: free bodies, bodies on a surface, linkages of joints, deformables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.initial_states import InitialState, initial_states
from polyworld.data.recording import Run
from polyworld.estimation.declared import SKIDS, Rolling, can_roll
from polyworld.estimation.fit_settings import Gaussian, PriorSettings
from polyworld.estimation.linkage import is_held
from polyworld.estimation.states import LENGTH, TURN, deformable_state, free_axes, linkage_states
from polyworld.estimation.stretches import Stretch
from polyworld.estimation.support import Support, rolling_spin, supports
from polyworld.estimation.unknown import Guess, StateMap, joined, of_paths
from polyworld.world import World, geometry
from polyworld.world.materials import material_of
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere
from polyworld.world.symmetry import rotation_vector

Array = NDArray[np.float64]

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
    if world.joints:
        run = Run.of_tracks("run", tracks)
        rigid = [i for i, n in enumerate(run.names) if world.is_rigid(n)]
        parts += linkage_states(world, run.columns(rigid))
    for item in world.objects:
        state = seen.get(item.name)
        if state is not None and stretch.carried:  # a collision may leave a speed that looks like rest
            state = replace(state, moves=True)
        if is_held(world, item.name) or (state is None and not stretch.carried):
            continue
        symmetry = tracks.symmetry[tracks.index(item.name)] if item.name in tracks.names else 0
        support = on.get(item.name)
        if support is not None and state is not None:
            parts.append(_supported(item, state, support, symmetry, settings, rolling))
        else:
            parts.append(_free(world, item, state, symmetry, settings))
    loose = [d for d in world.deformables if d.name in tracks.observed_names and material_of(d).turns]
    return joined([*parts, *(deformable_state(world, d.name, free_axes(world)) for d in loose)])


def _free(
    world: World, item: RigidObject, state: InitialState | None, symmetry: int, settings: PriorSettings
) -> StateMap:
    """Return a body's place, its velocity if it moves, its turn where that was measured, and a spin that may matter."""
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    about = "xyz"[int(np.argmax(np.abs(normal)))] if world.planar else "xyz"
    moves = state is None or state.moves
    turned = state is not None and state.orientation is not None and symmetry != 0
    unseen = moves and not turned and state is not None and can_roll(item) and not world.planar
    sd = settings.surface_speed / float(getattr(item.shape, "radius", 1.0))
    rows = [("position", free_axes(world), LENGTH, True), ("velocity", free_axes(world), 10.0 * LENGTH, moves)]
    rows += [("rotation", about, TURN, turned), ("angular_velocity", about, 10.0 * TURN, moves and turned)]
    rows += [("angular_velocity", "xyz", 0.2 * sd, unseen)]
    found: dict[str, Guess] = {}
    priors: dict[str, Gaussian] = {}
    for field, axes, typical, shown in rows:
        for a in axes if shown else "":
            start = 0.0 if field == "rotation" else getattr(item, field)["xyz".index(a)]
            found[f"objects.{item.name}.{field}.{a}"] = (start, typical)
            if unseen and field == "angular_velocity":
                priors[f"objects.{item.name}.{field}.{a}"] = (start, sd)
    return of_paths(found, priors)


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
    along = np.linalg.lstsq(tangents.T, np.asarray(item.velocity), rcond=None)[0]
    heading = state.orientation is not None and symmetry != 0 and not isinstance(item.shape, Sphere)
    rolls = support.rolls and moves and not support.turns
    phased = heading and rolls and support.axis is not None  # how far it has rolled shows
    ratio = 1.0 if rolling == "rolls" else 0.0
    found: dict[str, Guess] = {"along.1": (0.0, LENGTH), "along.2": (0.0, LENGTH)}
    if moves:
        found |= {f"speed.{k + 1}": (float(v), 10.0 * LENGTH) for k, v in enumerate(along)}
    if heading:
        found["heading"] = (0.0, TURN)
    if phased:
        found["phase"] = (0.0, TURN)
    if heading and moves:
        found["turning"] = (float(np.asarray(item.angular_velocity) @ n), 10.0 * TURN)
    if support.turns:
        found |= {f"rotation.{a}": (0.0, TURN) for a in "xyz"}
    if support.turns and moves:
        found |= {f"spin.{a}": (v, 10.0 * TURN) for a, v in zip("xyz", item.angular_velocity, strict=True)}
    if rolls and rolling != "skids":
        found["roll"] = (ratio, STEEPEST)
    frame = of_paths(found, {"roll": (ratio, settings.slip)})
    index = {label: i for i, label in enumerate(found)}
    radius = float(getattr(item.shape, "radius", 1.0))

    def overrides(values: Array, _: Mapping[str, Array]) -> dict[str, Array]:
        count = len(values)
        place = support.position + values[:, :2] @ tangents
        along = values[:, 2:4] @ tangents if moves else np.zeros((count, 3))
        spin = np.zeros((count, 3))
        paths: dict[str, Array] = {}
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
            paths[f"{head}position.{a}"], paths[f"{head}velocity.{a}"] = place[:, k], along[:, k]
            paths[f"{head}angular_velocity.{a}"] = spin[:, k]
            if heading:
                paths[f"{head}rotation.{a}"] = turned[:, k]
            elif support.turns:
                paths[f"{head}rotation.{a}"] = values[:, index[f"rotation.{a}"]]
        if rolls and rolling == "skids":
            paths[f"{head}rolling_resistance"] = np.full(count, SKIDS * radius)
        return paths

    return replace(frame, labels=tuple(f"{item.name}.{label}" for label in found), overrides=overrides)
