"""Faults of whoever measured the motion, as candidates: what looks like missing physics and is not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld import geometry
from polyworld.estimation.candidate import Candidate, Variant
from polyworld.estimation.unknown import Unknown
from polyworld.gap.catalogue.adding import BODIES, neutral, of_path, with_parts
from polyworld.gap.dropped_frames import dropped_frame_leads
from polyworld.observer import MARGIN, Observer
from polyworld.recording import Recording, Run
from polyworld.shapes import Plane
from polyworld.world import StaticObject, World

Array = NDArray[np.float64]

ALL = BODIES | {"fluid", "fluid_planar"}
# Bounds of k r^2 where r is the largest distance seen, which distortion itself has changed: below, points would change
# order (k r^2 = -1/3 of the true distance); above, what was seen is one and a half times as far as it was.
LEAST, MOST = -0.3, 1.0
ORDINARY = 0.02
SLANTED = 0.7  # most that keystone times half the extent of what was seen may be
# Effects that know no direction and no place: they look the same in axes turned about gravity.
_ISOTROPIC = frozenset(
    {"linear_drag", "quadratic_drag", "quadratic_damping", "magnus_lift", "buoyancy", "spin_damping", "spin_drag"}
    | {"viscous_friction", "restitution_speed", "bounce_friction", "spin_coupling"}
)
# Effects whose course depends on the time since the start.
_TIMED = frozenset({"periodic_forcing", "expression"})


def observed(world: World, **faults: Any) -> World:
    """A child world whose observer has some fields replaced; one without faults where there was none."""
    return with_parts(world, observer=(world.observer or Observer()).model_copy(update=faults))


def _value(world: World, path: str, name: str, typical: float, **bounds: float) -> Unknown:
    assert world.observer is not None
    return of_path(world, (path,), name, world.observer.values[path], typical, **bounds)


def _one(world: World, unknowns: Iterable[Unknown], strength: str | None, **more: Any) -> Variant:
    listed = tuple(unknowns)
    return Variant(world, listed, (neutral(listed),), strength=strength, **more)


def _measured(recording: Recording) -> frozenset[int]:
    """Axes of which positions were measured."""
    return frozenset(a for run in recording.runs for a in range(3) if np.isfinite(run.positions[..., a]).any())


def _interval(run: Run) -> float:
    return float(np.median(np.diff(run.times)))


def _bare(world: World) -> bool:
    """Whether nothing in the world has a place or a size that data could be held against."""
    return not (world.statics or world.joints or world.deformables or world.effects)


def _scale(world: World, recording: Recording) -> tuple[Variant, ...]:
    del recording
    child = observed(world)
    scale = _value(child, "observer.scale", "scale", 0.03, lower=0.5, upper=2.0)
    # Free flight from free initial states: lengths have only gravity to be compared with.
    alike = ("gravity_error", "observer_clock", "buoyancy") if _bare(world) else ()
    return (_one(child, (scale,), "scale", same_as=alike),)


def _clock(world: World, recording: Recording) -> tuple[Variant, ...]:
    del recording
    child = observed(world)
    clock = _value(child, "observer.clock", "clock", 0.03, lower=0.5, upper=2.0)
    alike = ("gravity_error", "observer_scale", "buoyancy") if _bare(world) else ()
    return (_one(child, (clock,), "clock", same_as=alike),)


def _time_offset(world: World, recording: Recording) -> tuple[Variant, ...]:
    # Free initial states take up any offset, unless something tells when the world began.
    begins = (
        any(run.lead > 0.0 for run in recording.runs)
        or bool(world.deformables)
        or any(o.start_time > 0.0 for o in world.objects)
        or any(getattr(j, "other", None) is not None for j in world.joints)
        or any(getattr(j, "motor", None) is not None for j in world.joints)
        or any(e.enabled and e.kind in _TIMED for e in world.effects)
    )
    if not begins:
        return ()
    child = observed(world)
    interval = max(_interval(run) for run in recording.runs)
    most = MARGIN * interval
    offset = _value(child, "observer.time_offset", "time_offset", interval, lower=-most, upper=most)
    return (_one(child, (offset,), "time_offset"),)


def _tilt(world: World, recording: Recording) -> tuple[Variant, ...]:
    axes = [a for a in range(3) if _tilt_shows(world, recording, a)]
    if not axes:
        return ()
    child = observed(world)
    bound = 0.5
    unknowns = [
        _value(child, f"observer.tilt.{'xyz'[a]}", f"tilt_{'xyz'[a]}", 0.02, lower=-bound, upper=bound) for a in axes
    ]
    return (_one(child, unknowns, None, same_as=("tilt",) if _bare(world) else ()),)


def _tilt_shows(world: World, recording: Recording, axis: int) -> bool:
    """Whether axes turned about this one change what is seen, to first order, beyond what initial states take up."""
    others = {0, 1, 2} - {axis}
    if not others <= _measured(recording):
        return False
    about = np.eye(3)[axis]
    if world.planar:
        normal = geometry.plane_axes(world.environment.motion_plane)[2]
        if abs(about @ normal) < 1.0 - 1e-9 and np.max(np.abs(normal)) > 1.0 - 1e-9:
            return False
    gravity = np.asarray(world.environment.gravity)
    size = float(np.linalg.norm(gravity))
    upright = size == 0.0 or abs(about @ gravity) > (1.0 - 1e-9) * size
    if not upright:
        return True
    level = all(_level(s, about) for s in world.statics)
    free = not (world.joints or world.deformables)
    return not (level and free and all(e.kind in _ISOTROPIC for e in world.effects if e.enabled))


def _level(static: StaticObject, up: Array) -> bool:
    """Whether a static is a plane across a direction."""
    if not isinstance(static.shape, Plane):
        return False
    normal = geometry.quaternion_matrix(np.asarray(static.orientation)) @ np.asarray(static.shape.normal)
    return bool(abs(normal @ up) > (1.0 - 1e-9) * np.linalg.norm(normal))


def _distortion(world: World, recording: Recording) -> tuple[Variant, ...]:
    places = np.concatenate([run.positions.reshape(-1, 3) for run in recording.runs])
    axes = sorted(_measured(recording))
    lower, upper = np.zeros(3), np.zeros(3)
    lower[axes], upper[axes] = np.nanmin(places[:, axes], axis=0), np.nanmax(places[:, axes], axis=0)
    view = _sight(world, axes)
    across = np.array(axes) if view is None else np.array([a for a in axes if abs(view[a]) < 1.0 - 1e-9])
    if not len(across):
        return ()
    middle = 0.5 * (lower + upper)
    origin = np.zeros(3) if world.observer is None else np.asarray(world.observer.centre)
    made = [_bent(world, origin, places, across, view, "about the origin")]
    if not np.allclose(middle[across], origin[across], atol=0.05 * float(np.max(upper - lower))):
        made.append(_bent(world, middle, places, across, view, "about a point of its own", moving=True))
    return tuple(made)


def _bent(
    world: World,
    centre: Array,
    places: Array,
    across: NDArray[np.int64],
    view: tuple[float, float, float] | None,
    label: str,
    moving: bool = False,
) -> Variant:
    child = observed(world, centre=tuple(float(c) for c in centre), view=view)
    away = (places - centre)[:, across]
    reach = float(np.sqrt(np.nanmax(np.nansum(away**2, axis=1))))
    unknowns = [
        _value(
            child,
            "observer.distortion",
            "distortion",
            ORDINARY / reach**2,
            lower=LEAST / reach**2,
            upper=MOST / reach**2,
        )
    ]
    if moving:
        unknowns += [
            _value(
                child,
                f"observer.centre.{'xyz'[a]}",
                f"centre_{'xyz'[a]}",
                0.2 * reach,
                lower=float(centre[a] - 2.0 * reach),
                upper=float(centre[a] + 2.0 * reach),
            )
            for a in across
        ]
    return _one(child, unknowns, "distortion", label=label)


def _keystone(world: World, recording: Recording) -> tuple[Variant, ...]:
    axes = sorted(_measured(recording))
    view = _sight(world, axes)
    if view is None and len(axes) == 3:
        return ()  # what tells depth too has not one plane of motion
    across = [a for a in axes if view is None or abs(view[a]) < 1.0 - 1e-9]
    places = np.concatenate([run.positions.reshape(-1, 3) for run in recording.runs])[:, across]
    lower, upper = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    reach = 0.5 * float(np.max(upper - lower, initial=0.0))
    if not reach > 0.0:
        return ()
    # Whoever tells the scale from lengths in the picture has it right about the middle.
    centre = np.zeros(3)
    centre[across] = 0.5 * (lower + upper)
    if world.observer is not None:
        centre = np.array(world.observer.centre)
    child = observed(world, centre=tuple(float(c) for c in centre))
    most = SLANTED / reach
    unknowns = [
        _value(
            child, f"observer.keystone.{'xyz'[a]}", f"keystone_{'xyz'[a]}", ORDINARY / reach, lower=-most, upper=most
        )
        for a in across
    ]
    return (_one(child, unknowns, unknowns[0].name if len(unknowns) == 1 else None),)


def _sight(world: World, axes: list[int]) -> tuple[float, float, float] | None:
    """Direction of sight: the camera's, or the one axis of which nothing was measured; None where neither is known."""
    if world.observer is not None and world.observer.view is not None:
        return world.observer.view
    if world.camera is not None:
        x, y, z = (float(v) for v in np.asarray(world.camera.rotation)[2])
        return x, y, z
    if len(axes) == 2:
        x, y, z = (float(v) for v in np.eye(3)[({0, 1, 2} - set(axes)).pop()])
        return x, y, z
    return None


def _dropped(world: World, recording: Recording) -> tuple[Variant, ...]:
    if world.observer is not None and world.observer.shift != 0.0:
        return ()
    made = []
    for run in recording.runs:
        if len(run.times) < 3:
            continue
        interval = _interval(run)
        first, last = run.lead, run.lead + float(run.times[-1] - run.times[0])
        child = observed(world, shift_run=run.name, shift_time=0.5 * (first + last))
        most = MARGIN * interval
        unknowns = (
            _value(child, "observer.shift", "shift", interval, lower=-most, upper=most),
            _value(child, "observer.shift_time", "shift_time", 10.0 * interval, lower=first, upper=last),
        )
        label = "" if len(recording.runs) == 1 else f"in run {run.name}"
        made.append(_one(child, unknowns, "shift", label=label))
    return tuple(made)


_SCALES: Mapping[str, str] = {
    "gravity_error": "a length known in the scene, or gravity measured elsewhere",
    "observer_clock": "a speed or a period that does not come from gravity, such as forcing by a motor",
    "buoyancy": "another body of another density",
}

CANDIDATES = (
    Candidate(
        name="observer_scale",
        group="observer",
        law="x_seen = centre + s (x - centre)",
        representations=ALL,
        signature="all lengths, and so gravity and speeds, are wrong by one factor; bounces keep their times",
        reference="Hartley & Zisserman, Multiple View Geometry (2004), ch. 2",
        variants=_scale,
        confused_with=_SCALES,
    ),
    Candidate(
        name="observer_clock",
        group="observer",
        law="t_seen = c t",
        representations=ALL,
        signature="all times are wrong by one factor: speeds by it, accelerations by its square, drag not at all",
        reference="any mechanics text, change of the unit of time",
        variants=_clock,
        confused_with={
            "gravity_error": _SCALES["gravity_error"],
            "observer_scale": "a length known in the scene, such as the height of a wall or the size of a body",
            "buoyancy": _SCALES["buoyancy"],
        },
    ),
    Candidate(
        name="observer_time_offset",
        group="observer",
        law="t_seen = t - t0",
        representations=ALL,
        signature="residuals along the velocity, the same delay everywhere and from the start on",
        reference="any mechanics text, change of the origin of time",
        variants=_time_offset,
        confused_with={
            "dropped_frames": "the delay is there from the first sample",
            "actuator_delay": "motion that no actuator drives is late too",
        },
    ),
    Candidate(
        name="observer_tilt",
        group="observer",
        law="x_seen = centre + R(tilt)^T (x - centre)",
        representations=ALL,
        signature="gravity, floors and walls are all turned alike in what was seen",
        reference="Hartley & Zisserman, Multiple View Geometry (2004), ch. 6",
        variants=_tilt,
        confused_with={
            "tilt": "a floor or a wall that is met: the observer's tilt turns it with gravity, a force does not",
            "wind": "bodies of different mass or size, or at rest",
            "coriolis": "another heading or a slower launch: turned axes do not depend on speed",
        },
    ),
    Candidate(
        name="observer_distortion",
        group="observer",
        law="x_seen = centre + (x - centre) (1 + k r^2)",
        representations=ALL,
        signature="residuals depend on place alone and grow with the cube of the distance from a centre",
        reference="Brown, Photogrammetric Engineering 37 (1971) 855; Zhang, IEEE PAMI 22 (2000) 1330",
        variants=_distortion,
        confused_with={
            "spring": "a static grid, or one place passed at different speeds: distortion does not depend on speed",
            "central_force": "a static grid, or one place passed at different speeds",
            "observer_scale": "motion near the centre and far from it",
        },
    ),
    Candidate(
        name="observer_keystone",
        group="observer",
        law="x_seen = centre + (x - centre) / (1 + p . (x - centre))",
        representations=ALL,
        signature="residuals depend on place alone: lengths are too short at one end and too long at the other",
        reference="Hartley & Zisserman, Multiple View Geometry (2004), ch. 2",
        variants=_keystone,
        confused_with={
            "gravity_error": "motion on both sides of the middle: accelerations are wrong by opposite shares",
            "quadratic_drag": "bodies of other mass or size in the same place, or one place passed at another speed",
            "observer_distortion": "motion on both sides of the middle: distortion is the same on both",
        },
    ),
    Candidate(
        name="dropped_frames",
        group="observer",
        law="t_seen = t - shift after shift_time",
        representations=ALL,
        signature="from one instant on all bodies are ahead (frames dropped) or behind (repeated) by one time",
        reference="any video text; a change of the origin of time at an instant",
        variants=_dropped,
        confused_with={
            "hidden_wall": "bodies elsewhere jump at the same instant, and speeds stay as they were",
            "fan": "the jump is a displacement along the velocity, with no change of velocity",
            "observer_clock": "the delay does not grow",
        },
        leads=dropped_frame_leads,
    ),
)
