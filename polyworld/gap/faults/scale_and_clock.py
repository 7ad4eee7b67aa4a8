"""Wrong units of whoever measured: of length, of time."""

from __future__ import annotations

from polyworld.estimation.candidate import Candidate, Variant
from polyworld.gap.adding import one_start
from polyworld.gap.faults.observing import is_bare, observed, of_observer
from polyworld.recording import Recording
from polyworld.world import World

ORDINARY = 0.3  # share by which a unit is wrong: film of 24 frames a second shown at 30, a yard taken for a metre


def _unit(world: World, field: str, alike: tuple[str, ...]) -> tuple[Variant, ...]:
    child = observed(world)
    factor = of_observer(child, field, field, 0.03, lower=0.5, upper=2.0, plausible=ORDINARY)
    # Free flight from free initial states: lengths and times have only gravity to be compared with.
    return (one_start(child, (factor,), same_as=alike if is_bare(world) else ()),)


def _scale(world: World, recording: Recording) -> tuple[Variant, ...]:
    del recording
    return _unit(world, "scale", ("gravity_error", "observer_clock", "buoyancy"))


def _clock(world: World, recording: Recording) -> tuple[Variant, ...]:
    del recording
    return _unit(world, "clock", ("gravity_error", "observer_scale", "buoyancy"))


_SCALES = {
    "gravity_error": "a length known in the scene, or gravity measured elsewhere",
    "observer_clock": "a speed or a period that does not come from gravity, such as forcing by a motor",
    "buoyancy": "another body of another density",
}

CANDIDATES = (
    Candidate(
        name="observer_scale",
        group="observer",
        law="x_seen = centre + s (x - centre)",
        signature="all lengths, and so gravity and speeds, are wrong by one factor; bounces keep their times",
        reference="Hartley & Zisserman, Multiple View Geometry (2004), ch. 2",
        variants=_scale,
        confused_with=_SCALES,
    ),
    Candidate(
        name="observer_clock",
        group="observer",
        law="t_seen = c t",
        signature="all times are wrong by one factor: speeds by it, accelerations by its square, drag not at all",
        reference="any mechanics text, change of the unit of time",
        variants=_clock,
        confused_with={
            "gravity_error": _SCALES["gravity_error"],
            "observer_scale": "a length known in the scene, such as the height of a wall or the size of a body",
            "buoyancy": _SCALES["buoyancy"],
        },
    ),
)
