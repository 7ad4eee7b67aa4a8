"""The observer's own faults: what a camera and its clock report of a motion that is itself untouched.

Time. A recorded stamp s [s, by the observer's clock, from the run's start] shows the world at the physical time

    (s + lag(s)) / clock + time_offset,

where lag goes from 0 to `shift` about `shift_time`: frames that were dropped there unnoticed make every later stamp too
early by a positive shift, frames that were repeated too late by a negative one; while frames repeat, time stands still.

Space. A position x is reported as

    centre + scale * distorted(slanted(R(tilt)^T (x - centre))),

R(tilt) being the rotation of the observed axes against those of the world. `slanted` divides by 1 + keystone . y: what
a camera that looks at a plane of motion at an angle sees of it, its scale being right at the centre (the projective
part of a homography, Hartley & Zisserman, Multiple View Geometry, 2004, ch. 2); what lies beyond the line where that is
zero is not seen (NaN). `distorted` multiplies by 1 + distortion * r^2 (the first radial term of Brown, Photogrammetric
Engineering 37, 1971): with a `view`, the components across it, r their length in metres; without, all three components.
Orientations are turned by the tilt alone: the other faults leave them.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial.transform import Rotation

from polyworld.world.description import ORIGIN, Description, Positive, Vec3
from polyworld.world.resampling import resample, resample_spins

Array = NDArray[np.float64]

_VECTORS = ("centre", "tilt", "keystone")
_SCALARS = ("scale", "clock", "time_offset", "distortion", "shift", "shift_time")


class Observer(Description):
    """Whoever measured the motion: all its faults, none by default. Rollouts do not depend on it."""

    scale: Positive = Field(default=1.0, description="observed length per true length [1]")
    centre: Vec3 = Field(default=ORIGIN, description="point that faults in space leave where it is [m]")
    clock: Positive = Field(default=1.0, description="seconds that the observer's clock counts per second [1]")
    time_offset: float = Field(default=0.0, description="physical time at which the observer's clock showed 0 [s]")
    tilt: Vec3 = Field(default=ORIGIN, description="rotation vector of the observed axes against the world's [rad]")
    keystone: Vec3 = Field(
        default=ORIGIN, description="relative fall of the image's scale per length along each observed axis [1/m]"
    )
    distortion: float = Field(default=0.0, description="radial distortion k in x (1 + k r^2) [1/m^2]")
    view: Vec3 | None = Field(
        default=None, description="direction of sight, across which distortion acts, in observed axes; default: all"
    )
    shift: float = Field(
        default=0.0, description="by how much stamps after shift_time are too early [s]; negative: late"
    )
    shift_time: float = Field(default=0.0, description="stamp about which frames were dropped or repeated [s]")
    shift_run: str | None = Field(default=None, description="the one run in which they were; default: in every run")

    @property
    def values(self) -> dict[str, float]:
        """Every number by parameter path, for example `observer.tilt.x`."""
        numbers = {f"observer.{name}": float(getattr(self, name)) for name in _SCALARS}
        vectors = {
            f"observer.{name}.{axis}": float(value)
            for name in _VECTORS
            for axis, value in zip("xyz", getattr(self, name), strict=True)
        }
        return {**numbers, **vectors}


NEUTRAL = Observer()

MARGIN = 10  # intervals between frames by which what is simulated goes beyond the stamps where they may be wrong


def clock_ratio(observer: Observer | None, parameters: Mapping[str, Array]) -> Array:
    """Return the factor (W,) or (1,) on `time.seconds_per_frame` that puts the simulator's samples at the physical
    times of the observer's stamps: 1 / clock."""
    ratio: Array = 1.0 / _Values(parameters, observer)["clock"]
    return ratio


def lag(stamps: Array, shift: Array, shift_time: Array) -> Array:
    """By how much each stamp is too early (W, T) [s], for stamps (T,) and shifts (W,) that come on at shift_time (W,).

    The last right stamp is half an interval between frames (the median of the stamps' intervals) before shift_time.
    From there a positive shift comes on linearly within one interval, and a negative one as time stands still. So
    with shift_time midway between two frames the first has no lag, and the second all of it where frames were dropped;
    and a fit can move the onset, since the lag changes continuously with it.
    """
    if len(stamps) < 2:
        return np.zeros((len(np.atleast_1d(shift)), len(stamps)))
    interval = float(np.median(np.diff(stamps)))
    size = np.reshape(shift, (-1, 1))
    since = np.maximum(stamps[None] - np.reshape(shift_time, (-1, 1)) + 0.5 * interval, 0.0)
    delay: Array = np.where(size >= 0.0, size * np.minimum(since / interval, 1.0), np.maximum(-since, size))
    return delay


def physical_times(
    stamps: Array, parameters: Mapping[str, Array], observer: Observer | None = None, run: str | None = None
) -> Array:
    """Physical times (W, T) [s] that recorded stamps (T,) show; arguments as for `observe`."""
    value = _Values(parameters, observer)
    delayed = np.asarray(stamps, dtype=float)[None] + lag(stamps, value.shift(run), value["shift_time"])
    times: Array = delayed / value["clock"][:, None] + value["time_offset"][:, None]
    return times


def observe(
    positions: Array,
    orientations: Array,
    velocities: Array,
    angular_velocities: Array,
    times: Array,
    wanted_times: Array,
    parameters: Mapping[str, Array],
    observer: Observer | None = None,
    run: str | None = None,
) -> tuple[Array, Array]:
    """Apply the observer's faults to W motions: positions (W, T', n, 3) and orientations (W, T', n, 4) at its stamps.

    positions, velocities, angular_velocities (W, T, n, 3) and orientations (W, T, n, 4) w, x, y, z: the motion in
    world axes at the physical times (W, T) [s]. wanted_times (T',): the stamps, from the run's start. parameters:
    paths `observer.*` -> values (W,); what is not named is the `observer`'s own (default: no fault). run: name of
    the run, for shifts that belong to one. Samples are taken as they are where they fall on the instants asked for,
    else interpolated; see `polyworld.world.resampling` for the error. Nothing given is changed.
    """
    value = _Values(parameters, observer)
    wanted = physical_times(wanted_times, parameters, observer, run)
    wanted = np.broadcast_to(wanted, (len(positions), wanted.shape[1]))
    seen, turned = resample(positions, orientations, velocities, angular_velocities, times, wanted)
    tilt, centre = value.vector("tilt"), value.vector("centre")
    scale, bend, slant = value["scale"], value["distortion"], value.vector("keystone")
    if np.any(tilt):
        back = Rotation.from_rotvec(tilt).inv()
        matrix = back.as_matrix()[:, None, None]
        seen = (matrix @ (seen - centre[:, None, None])[..., None])[..., 0] + centre[:, None, None]
        turned = _turn(back.as_quat(scalar_first=True)[:, None, None], turned)
    if np.any(bend) or np.any(slant) or np.any(scale != 1.0):
        about = seen - centre[:, None, None]
        depth = 1.0 + (about * slant[:, None, None]).sum(axis=-1, keepdims=True)
        about = about / np.where(depth > 0.0, depth, np.nan)
        view = (observer or NEUTRAL).view
        sight = np.zeros(3) if view is None else np.asarray(view) / np.linalg.norm(view)
        across = about - (about @ sight)[..., None] * sight
        radial = bend[:, None, None, None] * (across**2).sum(axis=-1, keepdims=True)
        seen = centre[:, None, None] + scale[:, None, None, None] * (about + radial * across)
    return seen, turned


def observed_spins(
    spins: Array,
    times: Array,
    wanted_times: Array,
    parameters: Mapping[str, Array],
    observer: Observer | None = None,
    run: str | None = None,
) -> Array:
    """Return the angular velocities (W, T', n, 3) [rad/s] that the observer reports of spins (W, T, n, 3).

    They are turned by the tilt and counted by the observer's clock; arguments as for `observe`.
    """
    value = _Values(parameters, observer)
    wanted = physical_times(wanted_times, parameters, observer, run)
    seen = resample_spins(spins, times, np.broadcast_to(wanted, (len(spins), wanted.shape[1])))
    if np.any(tilt := value.vector("tilt")):
        seen = (Rotation.from_rotvec(tilt).inv().as_matrix()[:, None, None] @ seen[..., None])[..., 0]
    reported: Array = seen / value["clock"][:, None, None, None]
    return reported


class _Values:
    """Numbers of the observers of a batch, each (W,) or (1,)."""

    def __init__(self, parameters: Mapping[str, Array], observer: Observer | None) -> None:
        own = (observer or NEUTRAL).values
        unknown = sorted(p for p in parameters if p not in own)
        if unknown:
            raise ValueError(f"not parameters of an observer: {unknown}; choices: {sorted(own)}")
        self._observer = observer or NEUTRAL
        given = {path: np.atleast_1d(np.asarray(parameters.get(path, own[path]), dtype=float)) for path in own}
        count = max(len(v) for v in given.values())
        self._given = {path: np.broadcast_to(v, (count,)) for path, v in given.items()}

    def __getitem__(self, name: str) -> Array:
        return self._given[f"observer.{name}"]

    def vector(self, name: str) -> Array:
        """(W, 3)."""
        return np.stack([self._given[f"observer.{name}.{axis}"] for axis in "xyz"], axis=-1)

    def shift(self, run: str | None) -> Array:
        """(W,): no shift in the runs that it does not belong to."""
        mine = self._observer.shift_run is None or run is None or run == self._observer.shift_run
        return self["shift"] if mine else np.zeros_like(self["shift"])


def _turn(by: Array, orientations: Array) -> Array:
    """Orientations (..., 4) turned by quaternions (..., 4) from the left."""
    w, v = by[..., :1], by[..., 1:]
    w2, v2 = orientations[..., :1], orientations[..., 1:]
    scalar = w * w2 - (v * v2).sum(axis=-1, keepdims=True)
    return np.concatenate([scalar, w * v2 + w2 * v + np.cross(v, v2)], axis=-1)
