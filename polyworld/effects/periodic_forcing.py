"""An acceleration that swings with time, the same everywhere: a shaken frame."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.effects.absence import MOST_FREQUENCIES, Absence, FreeParameter, Way, along
from polyworld.effects.conditions import SHARE, Conditions
from polyworld.effects.law import Course, EffectLaw, EffectParameter, Motion, Parameters, Vec8, size, wrench

_AXIS = EffectParameter("m/s^2", -1e4, 1e4, (-2.0, 2.0), 0.0, "amplitude of the acceleration along this world axis")


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    wave = wp.sin(wp.float64(2.0 * wp.pi) * p[3] * b.t + p[4])
    return wrench(b.mass * wave * wp.vec3d(p[0], p[1], p[2]), wp.vec3d())


def work(p: Parameters, course: Course) -> NDArray[np.float64]:
    """Return that of the amplitude."""
    return course.mass * size(p, "amplitude_") * course.path


LAW = EffectLaw(
    kind="periodic_forcing",
    summary="F = m A sin(2 pi f t + phi)",
    parameters={
        "amplitude_x": _AXIS,
        "amplitude_y": _AXIS,
        "amplitude_z": _AXIS,
        "frequency": EffectParameter("Hz", 0.0, 1e3, (0.2, 10.0), 1.0, "oscillations per second"),
        "phase": EffectParameter("rad", -7.0, 7.0, (-3.15, 3.15), 0.0, "phase at time 0"),
    },
    force=force,
    per_mass=True,
    reference="Landau & Lifshitz, Mechanics, 22 and 39",
    work=work,
)


SLOWEST, FASTEST = 1.0, 5.0  # cycles per run, fewer being any slow change, and Hz
PHASES = (0.0, np.pi / 2)


def ways(found: Conditions) -> list[Way]:
    if not found.axes or found.duration <= 0.0:
        return []
    frequencies = _frequencies(found)
    size = FreeParameter(2.0 * SHARE * found.acceleration, plausible=found.weight / found.mass)
    highest = max(2.0 * max(frequencies), 0.25 / found.frame)
    free = along(found.axes, "amplitude_", size) | {
        "frequency": FreeParameter(0.25 / found.duration, SLOWEST / found.duration, highest, idle=True),
        "phase": FreeParameter(0.5, idle=True),
    }
    starts = [{"frequency": f, "phase": p} for f in frequencies for p in PHASES]
    return [Way(free, {"frequency": frequencies[0]}, starts)]


def _frequencies(found: Conditions) -> list[float]:
    """Evenly spaced, half a cycle per whole run apart as long as they are not too many, below half the frame rate."""
    low = SLOWEST / found.duration
    high = min(FASTEST, 0.25 / found.frame)
    if high <= low:
        return [low]
    count = int(np.clip(np.ceil((high - low) * found.duration * 2.0), 2, MOST_FREQUENCIES))
    return [float(f) for f in np.linspace(low, high, count)]


ABSENCE = Absence(
    ways,
    signature="residual acceleration that swings with time, the same wherever the body is",
)
