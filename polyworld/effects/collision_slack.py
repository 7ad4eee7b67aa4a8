"""An impulse that a collision exchanged beyond what its impact law says, as one short pulse."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.effects.law import Course, EffectLaw, EffectParameter, Motion, Parameters, Vec8, size, wrench

_LINEAR = EffectParameter("N s", -1e6, 1e6, (-1.0, 1.0), 0.0, "impulse along this world axis")
_ANGULAR = EffectParameter("N m s", -1e6, 1e6, (-0.1, 0.1), 0.0, "angular impulse about this world axis")


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    phase = (b.t - p[6]) / p[7]
    size = wp.float64(0.0)
    if phase > wp.float64(0.0) and phase < wp.float64(1.0):
        # Over even steps that divide the duration, two or more, a raised cosine sums to the same whatever their phase.
        size = (wp.float64(1.0) - wp.cos(wp.float64(2.0 * wp.pi) * phase)) / p[7]
    return wrench(size * wp.vec3d(p[0], p[1], p[2]), size * wp.vec3d(p[3], p[4], p[5]))


def work(p: Parameters, course: Course) -> NDArray[np.float64]:
    """Return that of the impulses at the highest speeds."""
    most = size(p, "impulse_") * course.speed + size(p, "turn_") * course.spin
    return np.full(len(course.path), most)


LAW = EffectLaw(
    kind="collision_slack",
    summary="F = J (1 - cos(2 pi (t - time) / duration)) / duration, from time to time + duration; torque likewise",
    parameters={
        **{f"impulse_{axis}": _LINEAR for axis in "xyz"},
        **{f"turn_{axis}": _ANGULAR for axis in "xyz"},
        "time": EffectParameter("s", -1e6, 1e6, (0.0, 10.0), 0.0, "when the pulse begins"),
        "duration": EffectParameter("s", 1e-6, 1e4, (0.01, 0.1), 0.02, "how long it lasts"),
    },
    force=force,
    reference="Stronge, Impact Mechanics (2018), ch. 1: rigid impact laws leave out what the contact's course decides",
    work=work,
)
