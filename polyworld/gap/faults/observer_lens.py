"""Lenses that distort, and cameras that look at the plane of motion aslant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.gap.candidate import Candidate, Variant, one_start
from polyworld.gap.faults.observer_frame import measured_axes, observed, of_observer
from polyworld.world import World

Array = NDArray[np.float64]

# Bounds of k r^2 where r is the largest distance seen, which distortion itself has changed: below, points would change
# order (k r^2 = -1/3 of the true distance); above, what was seen is one and a half times as far as it was.
LEAST, MOST = -0.3, 1.0
TYPICAL, ORDINARY = 0.02, 0.3  # of k r^2, or of keystone times that extent: any lens; a fisheye, a camera held aslant
SLANTED = 0.7  # most that keystone times half the extent of what was seen may be


def _distortion(world: World, recording: Recording) -> tuple[Variant, ...]:
    places = np.concatenate([run.positions.reshape(-1, 3) for run in recording.runs])
    axes = measured_axes(recording)
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
    bounds = {"lower": LEAST / reach**2, "upper": MOST / reach**2, "plausible": ORDINARY / reach**2}
    unknowns = [of_observer(child, "distortion", "distortion", TYPICAL / reach**2, **bounds)]
    for a in across if moving else ():
        low, high = float(centre[a] - 2.0 * reach), float(centre[a] + 2.0 * reach)
        limits = {"lower": low, "upper": high, "plausible": reach}
        unknowns.append(of_observer(child, f"centre.{'xyz'[a]}", f"centre_{'xyz'[a]}", 0.2 * reach, **limits))
    return one_start(child, unknowns, label)


def _keystone(world: World, recording: Recording) -> tuple[Variant, ...]:
    axes = measured_axes(recording)
    view = _sight(world, axes)
    if view is None and len(axes) == 3:
        return ()  # what measures depth too has not one plane of motion
    across = [a for a in axes if view is None or abs(view[a]) < 1.0 - 1e-9]
    places = np.concatenate([run.positions.reshape(-1, 3) for run in recording.runs])[:, across]
    lower, upper = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    reach = 0.5 * float(np.max(upper - lower, initial=0.0))
    if not reach > 0.0:
        return ()
    # Whoever takes the scale from lengths in the picture has it right about the middle.
    centre = np.zeros(3)
    centre[across] = 0.5 * (lower + upper)
    if world.observer is not None:
        centre = np.array(world.observer.centre)
    child = observed(world, centre=tuple(float(c) for c in centre))
    limits = {"lower": -SLANTED / reach, "upper": SLANTED / reach, "plausible": ORDINARY / reach}
    unknowns = [
        of_observer(child, f"keystone.{'xyz'[a]}", f"keystone_{'xyz'[a]}", TYPICAL / reach, **limits) for a in across
    ]
    return (one_start(child, unknowns),)


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


CANDIDATES = (
    Candidate(
        name="observer_distortion",
        group="observer",
        law="x_seen = centre + (x - centre) (1 + k r^2)",
        variants=_distortion,
    ),
    Candidate(
        name="observer_keystone",
        group="observer",
        law="x_seen = centre + (x - centre) / (1 + p . (x - centre))",
        variants=_keystone,
    ),
)
