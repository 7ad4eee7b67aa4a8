"""Wrong units, axes and time stamps of whoever measured, lenses that distort, and cameras that look on aslant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.estimation.unknown import Unknown
from polyworld.expressions.effect import law_of
from polyworld.gap.candidate import Candidate, Variant, of_path, one_start, with_parts
from polyworld.screening.statics import plane_normal
from polyworld.world import World, geometry
from polyworld.world.observer import MARGIN, Observer

Array = NDArray[np.float64]

WRONG_UNIT = 0.3  # share by which a unit is wrong: film of 24 frames a second shown at 30, a yard taken for a metre
FRAMES = 10.0  # that are ordinarily missed, or by which a recording ordinarily begins late
# Effects whose course depends on the time since the start.
_TIMED = frozenset({"periodic_forcing", "expression"})


def observed(world: World, **faults: Any) -> World:
    """Return a child world whose observer has some fields replaced; one without faults where there was none."""
    return with_parts(world, observer=(world.observer or Observer()).model_copy(update=faults))


def of_observer(world: World, field: str, name: str, typical: float, **limits: float) -> Unknown:
    """Return a field of a world's observer as an unknown from its value on. limits: as `of_path` takes them."""
    assert world.observer is not None
    path = f"observer.{field}"
    return of_path(world, (path,), name, world.observer.values[path], typical, **limits)


def measured_axes(recording: Recording) -> list[int]:
    """Return axes of which positions were measured."""
    return [a for a in range(3) if any(np.isfinite(run.positions[..., a]).any() for run in recording.runs)]


def region(recording: Recording) -> tuple[list[int], Array, float]:
    """Return axes of which positions were measured, the middle (3,) of what was seen, and its largest extent [m]."""
    axes, middle = measured_axes(recording), np.zeros(3)
    places = np.concatenate([run.positions.reshape(-1, 3) for run in recording.runs])[:, axes]
    lower, upper = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    middle[axes] = 0.5 * (lower + upper)
    return axes, middle, float(np.max(upper - lower, initial=0.0))


def centred(child: World, centre: Array, axes: Sequence[int], reach: float) -> list[Unknown]:
    """Return the point that an observer's fault is about as unknowns, up to twice a reach [m] away."""
    found = []
    for a in axes:
        limits = {"lower": float(centre[a] - 2.0 * reach), "upper": float(centre[a] + 2.0 * reach)}
        name = f"centre_{'xyz'[a]}"
        found.append(of_observer(child, f"centre.{'xyz'[a]}", name, 0.2 * reach, **limits, plausible=reach))
    return found


def is_bare(world: World) -> bool:
    """Return whether nothing in the world has a place or a size that data could be held against."""
    return not (world.statics or world.joints or world.deformables or world.effects)


def _unit(world: World, field: str, alike: tuple[str, ...]) -> tuple[Variant, ...]:
    child = observed(world)
    factor = of_observer(child, field, field, 0.03, lower=0.5, upper=2.0, plausible=WRONG_UNIT)
    # Free flight from free initial states: lengths and times have only gravity to be compared with.
    return (one_start(child, (factor,), same_as=alike if is_bare(world) else ()),)


def of_angles(recording: Recording) -> bool:
    """Return whether all places stand for angles, which have neither scale nor lens."""
    return all(np.isfinite(run.arms).all() for run in recording.runs)


def _scale(world: World, recording: Recording) -> tuple[Variant, ...]:
    if of_angles(recording):
        return ()
    about_origin = _unit(world, "scale", ("gravity_error", "observer_clock", "buoyancy"))
    if is_bare(world):
        return about_origin  # free initial states take up where the centre is
    return (*about_origin, _scale_about_own_point(world, recording))


def _scale_about_own_point(world: World, recording: Recording) -> Variant:
    """Return a scale about a point that is fitted, too: statics have a place, and what stays there shows."""
    axes, middle, reach = region(recording)
    child = observed(world, centre=tuple(float(c) for c in middle))
    scale = of_observer(child, "scale", "scale", 0.03, lower=0.5, upper=2.0, plausible=WRONG_UNIT)
    return one_start(child, [scale, *centred(child, middle, axes, reach)], "about a point of its own")


def _clock(world: World, recording: Recording) -> tuple[Variant, ...]:
    del recording
    return _unit(world, "clock", ("gravity_error", "observer_scale", "buoyancy"))


def _interval(run: Run) -> float:
    return float(np.median(np.diff(run.times)))


def _limits(interval: float) -> dict[str, float]:
    """Return bounds of a shift of time, whose ordinary size is an interval between frames."""
    return {"lower": -MARGIN * interval, "upper": MARGIN * interval, "plausible": FRAMES * interval}


def _time_offset(world: World, recording: Recording) -> tuple[Variant, ...]:
    # Free initial states take up any offset, unless something shows when the world began.
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
    offset = of_observer(child, "time_offset", "time_offset", interval, **_limits(interval))
    return (one_start(child, (offset,)),)


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
        unknowns = (
            of_observer(child, "shift", "shift", interval, **_limits(interval)),
            of_observer(child, "shift_time", "shift_time", 10.0 * interval, lower=first, upper=last),
        )
        label = "" if len(recording.runs) == 1 else f"in run {run.name}"
        made.append(one_start(child, unknowns, label))
    return tuple(made)


MOST = 0.5  # [rad]
ORDINARY = 0.2  # of a camera held by hand [rad]


def _tilt(world: World, recording: Recording) -> tuple[Variant, ...]:
    axes = [a for a in range(3) if _tilt_shows(world, recording, a)]
    if not axes:
        return ()
    child = observed(world)
    limits = {"lower": -MOST, "upper": MOST, "plausible": ORDINARY}
    unknowns = [of_observer(child, f"tilt.{'xyz'[a]}", f"tilt_{'xyz'[a]}", 0.02, **limits) for a in axes]
    return (one_start(child, unknowns, same_as=("tilt",) if is_bare(world) else ()),)


def _tilt_shows(world: World, recording: Recording, axis: int) -> bool:
    """Return whether axes turned about this one change what is seen, to first order, beyond what initial states take
    up."""
    others = {0, 1, 2} - {axis}
    if not others <= set(measured_axes(recording)):
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
    normals = [plane_normal(s) for s in world.statics]
    level = all(n is not None and abs(n @ about) > 1.0 - 1e-9 for n in normals)
    free = not (world.joints or world.deformables)
    return not (level and free and all(law_of(e).isotropic for e in world.effects if e.enabled))


# Bounds of k r^2 where r is the largest distance seen, which distortion itself has changed: below, points would change
# order (k r^2 = -1/3 of the true distance); above, what was seen is one and a half times as far as it was.
LEAST_BEND, MOST_BEND = -0.3, 1.0
TYPICAL_BEND, ORDINARY_BEND = (
    0.02,
    0.3,
)  # of k r^2, or of keystone times that extent: any lens; a fisheye, a camera held aslant
SLANTED = 0.7  # most that keystone times half the extent of what was seen may be


def _distortion(world: World, recording: Recording) -> tuple[Variant, ...]:
    axes, middle, extent = region(recording)
    view = _sight(world, axes)
    across = [a for a in axes if view is None or abs(view[a]) < 1.0 - 1e-9]
    if not across or of_angles(recording):
        return ()
    origin = np.zeros(3) if world.observer is None else np.asarray(world.observer.centre)
    centres = [("about the origin", origin)]
    if not np.allclose(middle[across], origin[across], atol=0.05 * extent):
        centres.append(("about a point of its own", middle))
    places, made = np.concatenate([run.positions.reshape(-1, 3) for run in recording.runs]), []
    for label, centre in centres:
        child = observed(world, centre=tuple(float(c) for c in centre), view=view)
        square = float(np.nanmax(np.nansum((places - centre)[:, across] ** 2, axis=1)))
        bounds = {"lower": LEAST_BEND / square, "upper": MOST_BEND / square, "plausible": ORDINARY_BEND / square}
        bent = of_observer(child, "distortion", "distortion", TYPICAL_BEND / square, **bounds)
        own = centred(child, centre, across, float(np.sqrt(square))) if centre is middle else []
        made.append(one_start(child, [bent, *own], label))
    return tuple(made)


def _keystone(world: World, recording: Recording) -> tuple[Variant, ...]:
    axes, middle, extent = region(recording)
    view = _sight(world, axes)
    if (view is None and len(axes) == 3) or not extent > 0.0 or of_angles(recording):
        return ()  # what measures depth too has not one plane of motion
    across, reach = [a for a in axes if view is None or abs(view[a]) < 1.0 - 1e-9], 0.5 * extent
    # Whoever takes the scale from lengths in the picture has it right about the middle.
    centre = np.where(np.isin(np.arange(3), across), middle, 0.0)
    if world.observer is not None:
        centre = np.array(world.observer.centre)
    child = observed(world, centre=tuple(float(c) for c in centre))
    limits = {"lower": -SLANTED / reach, "upper": SLANTED / reach, "plausible": ORDINARY_BEND / reach}
    unknowns = [
        of_observer(child, f"keystone.{'xyz'[a]}", f"keystone_{'xyz'[a]}", TYPICAL_BEND / reach, **limits)
        for a in across
    ]
    return (one_start(child, unknowns),)


def _sight(world: World, axes: list[int]) -> tuple[float, float, float] | None:
    """Direction of sight: the camera's, or the one axis of which nothing was measured; None where neither is known."""
    if world.observer is not None and world.observer.view is not None:
        return world.observer.view
    if world.camera is None and len(axes) != 2:
        return None
    unmeasured = sum({0, 1, 2} - set(axes))
    x, y, z = np.eye(3)[unmeasured] if world.camera is None else np.asarray(world.camera.rotation)[2]
    return float(x), float(y), float(z)


CANDIDATES = (
    Candidate("observer_scale", "observer", "x_seen = centre + s (x - centre)", _scale),
    Candidate("observer_clock", "observer", "t_seen = c t", _clock),
    Candidate("observer_time_offset", "observer", "t_seen = t - t0", _time_offset),
    Candidate("dropped_frames", "observer", "t_seen = t - shift after shift_time", _dropped, local=True),
    Candidate("observer_tilt", "observer", "x_seen = centre + R(tilt)^T (x - centre)", _tilt),
    Candidate("observer_distortion", "observer", "x_seen = centre + (x - centre) (1 + k r^2)", _distortion),
    Candidate("observer_keystone", "observer", "x_seen = centre + (x - centre) / (1 + p . (x - centre))", _keystone),
)
