"""Measure the conditions under which bodies were seen to move: region, speeds, spin, contacts."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.effects.conditions import Conditions
from polyworld.estimation.linkage import is_held
from polyworld.screening.tracks import Track, subject
from polyworld.world import World, geometry
from polyworld.world.distances import distance_to_static
from polyworld.world.parameters import object_mass
from polyworld.world.representations.joint import Joint, Slider
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere

Array = NDArray[np.float64]

STRIDES = 24  # segments of a run to read speeds from
NEAR = 0.25  # of a body's radius: gap within which tracks count as touching
SLIDING = 0.2  # contact that lasts this long is no bounce [s]


def tracks(world: World, recording: Recording) -> list[Track]:
    """Return the tracks of all rigid bodies in all runs."""
    return [t for t in subject(world, recording).tracks if world.is_rigid(t.object)]


def conditions(world: World, recording: Recording) -> Conditions:
    """Measure the conditions that a recording covers. Raises ValueError where it holds no position."""
    if _LAST and _LAST[0][0] is world and _LAST[0][1] is recording:
        return _LAST[0][2]
    found = _conditions(world, recording)
    _LAST[:] = [(world, recording, found)]
    return found


# Every candidate asks for the same ones in turn.
_LAST: list[tuple[World, Recording, Conditions]] = []


def _conditions(world: World, recording: Recording) -> Conditions:
    everything = np.concatenate([run.positions.reshape(-1, 3) for run in recording.runs])
    seen = np.isfinite(everything)
    if not seen.any():
        raise ValueError(
            "the recording holds no position: effects are sized by where bodies go; of a body whose turns alone were "
            "measured, as by an encoder on its hinge, give also where its centre then is"
        )
    fallback = np.mean([_start(world, n) for n in world.moving_names], axis=0)
    lower = np.where(seen.any(axis=0), np.min(np.where(seen, everything, np.inf), axis=0), fallback)
    upper = np.where(seen.any(axis=0), np.max(np.where(seen, everything, -np.inf), axis=0), fallback)
    speeds = np.concatenate([_speeds(run) for run in recording.runs])
    duration = float(max(run.times[-1] - run.times[0] for run in recording.runs))
    speed = max(float(np.sqrt(np.mean(speeds**2))) if len(speeds) else 0.0, 1e-6)
    gravity = np.asarray(world.environment.gravity, dtype=float)
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    supported = world.planar and world.environment.motion_plane.supports and float(gravity @ normal) < 0.0
    pull = _pull(world, gravity, normal, supported)
    radii = [geometry.circumscribed_radius(o.shape) for o in world.objects]
    masses = [object_mass(o) for o in world.objects]
    # Of a plane oblique to the axes: the two that its normal is least along.
    free = sorted(np.argsort(np.abs(normal), kind="stable")[:2].tolist()) if world.planar else [0, 1, 2]
    axes = [a for a in free if seen[:, a].any()]
    variance = np.array([np.var(everything[seen[:, a], a]) if seen[:, a].any() else 0.0 for a in range(3)])
    paths = list(tracks(world, recording))
    places = [np.where(np.isfinite(t.places), t.places, (lower + upper) / 2) for t in paths]
    solid = [_filled(world, t) for t in paths]
    near = [touching(world, t) for t in solid]
    return Conditions(
        lower=lower,
        upper=upper,
        spread=max(float(np.sqrt(np.mean(variance[axes]))) if axes else 0.0, 1e-3, max(radii, default=0.0)),
        axes=tuple(axes),
        speed=speed,
        fastest=float(max(speeds.max(initial=0.0), speed)),
        spin=_spin(world, recording),
        duration=duration,
        frame=min((float(np.median(np.diff(r.times))) for r in recording.runs if len(r.times) > 1), default=duration),
        gravity=gravity,
        acceleration=pull if pull > 1e-9 else speed / max(duration, 1e-6),
        masses=tuple(masses),
        ball_radii=tuple(geometry.equivalent_radius(o.shape) for o in world.objects),
        mass=float(np.median(masses)) if masses else 1.0,
        radius=float(np.median(radii)) if radii else 0.0,
        drop=float(np.median([o.shape.radius for o in world.objects if isinstance(o.shape, Sphere)] or [0.0])),
        deformables=bool(world.deformables),
        planar=world.planar,
        supported=supported,
        bounces=any(touching(world, t, margin=_longest_step(t)).any() for t in solid),
        meetings=_meetings(world, recording),
        slides=supported or any(_lasts(t, n) for t, n in zip(solid, near, strict=True)),
        rubs=any(o.friction > 0.0 for o in world.objects),
        turns=any(np.isfinite(m).any() for run in recording.runs for m in (run.orientations, run.angular_velocities)),
        unturned=_unturned(world, recording),
        places=np.concatenate([*places, np.zeros((0, 3))]),
        touching=np.concatenate([*near, np.zeros(0, dtype=bool)]),
    )


def _pull(world: World, gravity: Array, normal: Array, supported: bool) -> float:
    """Acceleration [m/s^2] that gravity gives along the motion, or friction where gravity presses bodies on a plane."""
    pull = float(np.linalg.norm(gravity - (gravity @ normal) * normal if world.planar else gravity))
    if not supported:
        return pull
    rubbing = world.environment.motion_plane.friction
    if rubbing is None:
        rubbing = max((o.friction for o in world.objects), default=0.0)
    return max(pull, rubbing * float(-gravity @ normal))


def _unturned(world: World, recording: Recording) -> dict[str, tuple[str, ...]]:
    """Return runs, by free rigid body, in which its places but not its turns were measured."""
    rigid = {o.name for o in world.objects if not is_held(world, o.name)}
    found: dict[str, tuple[str, ...]] = {}
    for run in recording.runs:
        for column, name in enumerate(run.names):
            seen = np.isfinite(run.positions[:, column]).any(axis=0)
            turned = np.isfinite(run.orientations[:, column]).all(axis=-1).sum() >= 2
            if name in rigid and seen.sum() >= 2 and not turned:
                found[name] = (*found.get(name, ()), run.name)
    return found


def _start(world: World, name: str) -> Array:
    return np.asarray(world.object(name).position if world.is_rigid(name) else (0.0, 0.0, 0.0), dtype=float)


def _speeds(run: Run) -> Array:
    """Return speeds over stretches of a run long enough that noise does not make them; components not seen count as
    still."""
    stride = max(1, (len(run.times) - 1) // STRIDES)
    span = run.times[stride:] - run.times[:-stride]
    moved = run.positions[stride:] - run.positions[:-stride]
    known = np.isfinite(moved).any(axis=-1)
    speeds: Array = np.sqrt(np.nansum(moved**2, axis=-1)) / span[:, None]
    return speeds[known]


def _spin(world: World, recording: Recording) -> float:
    """Return a typical spin [rad/s]: as described, as measured, or as orientations turn from sample to sample."""
    found = [float(np.linalg.norm(o.angular_velocity)) for o in world.objects if any(o.angular_velocity)]
    for track in tracks(world, recording):
        run = recording.run(track.run)
        column = run.names.index(track.object)
        spins, q = run.angular_velocities[:, column], run.orientations[:, column]
        spun, rows = np.isfinite(spins).any(axis=-1), np.flatnonzero(np.isfinite(q).all(axis=-1))
        if spun.any():
            found.append(float(np.median(np.linalg.norm(np.nan_to_num(spins[spun]), axis=-1))))
        elif len(rows) >= 2:
            cosine = np.abs(np.einsum("tk,tk->t", q[rows[1:]], q[rows[:-1]]))
            rate = 2.0 * np.arccos(np.clip(cosine, 0.0, 1.0)) / np.diff(run.times[rows])
            found.append(float(np.median(rate)))
    return float(np.median(found)) if found else 0.0


def reach(world: World, item: RigidObject) -> float:
    """Distance from a body's centre within which a surface may touch it [m]; planar worlds: within the plane."""
    if not world.planar:
        return geometry.circumscribed_radius(item.shape)
    axes = geometry.plane_axes(world.environment.motion_plane)
    outline, disc = geometry.planar_outline(item.shape, geometry.quaternion_matrix(np.asarray(item.orientation)), axes)
    return float(np.linalg.norm(outline, axis=1).max() + disc)


def moment_arm(world: World, joint: Joint) -> float:
    """Return the moment arm [m] of a body's weight about its joint; 1 for sliders, whose efforts are forces."""
    if isinstance(joint, Slider):
        return 1.0
    item = world.object(joint.object)
    arm = float(np.linalg.norm(np.subtract(item.position, joint.anchor)))
    return max(arm, 0.5 * reach(world, item))


def touching(world: World, track: Track, margin: float = 0.0) -> NDArray[np.bool_]:
    """At which of a track's instants (T,) the body is within reach of a static."""
    item = world.object(track.object)
    full = np.all(np.isfinite(track.places), axis=1)
    near = np.zeros(len(track.times), dtype=bool)
    limit = (
        reach(world, item) * (1.0 + (NEAR if isinstance(item.shape, Sphere) else 0.0))
        + 4.0 * track.noise.max()
        + margin
    )
    places = np.where(full[:, None], track.places, 0.0)
    for static in world.statics:
        near |= full & (distance_to_static(static, places) <= limit)
    return near


def _filled(world: World, track: Track) -> Track:
    """Return a track that stays, along axes that its run never measured, where the world has the body."""
    never = ~np.isfinite(track.places).any(axis=0)
    return replace(track, places=np.where(never, _start(world, track.object), track.places)) if never.any() else track


def _longest_step(track: Track) -> float:
    """Longest way between two samples [m]."""
    path = np.linalg.norm(np.diff(track.places, axis=0), axis=1)
    return float(np.nanmax(path)) if np.isfinite(path).any() else 0.0


def _lasts(track: Track, near: NDArray[np.bool_]) -> bool:
    """Return whether a contact, near (T,), lasts too long for a bounce."""
    ends = np.flatnonzero(np.diff(np.concatenate([[0], near, [0]]).astype(int)))
    longest = int((ends[1::2] - ends[::2]).max(initial=0))
    return longest * track.interval >= SLIDING


def _meetings(world: World, recording: Recording) -> tuple[tuple[str, str], ...]:
    """Return pairs of rigid bodies that come within reach of each other and no joint holds together."""
    joined = {frozenset((j.object, j.other)) for j in world.joints if j.kind != "spring"}
    reaches = {o.name: reach(world, o) for o in world.objects}
    found: dict[tuple[str, str], None] = {}
    for run in recording.runs:
        for a, b in itertools.combinations([n for n in run.names if n in reaches], 2):
            if frozenset((a, b)) in joined or (a, b) in found:
                continue
            apart = np.linalg.norm(run.positions[:, run.names.index(a)] - run.positions[:, run.names.index(b)], axis=1)
            slack = float(np.nan_to_num(np.abs(np.diff(apart))).max(initial=0.0))
            if np.any(apart <= (1.0 + NEAR) * (reaches[a] + reaches[b]) + slack):
                found[(a, b)] = None
    return tuple(found)
