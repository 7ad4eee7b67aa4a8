"""Forces that may be missing and have a place or a rhythm: spring, tether, central force, fan, periodic forcing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.candidate import Candidate, Variant
from polyworld.estimation.trial import FitContext, FittedHypothesis
from polyworld.estimation.unknown import Unknown
from polyworld.gap.catalogue.adding import BODIES, RIGID, effect, neutral, of_effect, with_effects
from polyworld.gap.conditions import SHARE, Conditions, conditions, tracks
from polyworld.gap.places import box_grid, visited_places
from polyworld.gap.rhythm import rhythms
from polyworld.recording import Recording
from polyworld.world import Effect, World

Array = NDArray[np.float64]

FAR = 2.0  # sizes of the region visited by which a place may lie off its middle: from afar, all forces look uniform
LENGTHS = (0.3, 0.5, 0.75)  # quantiles of the distance to the anchor that a tether's length begins with
EXPONENTS = (-2.0, -1.0)
FALLING = -0.2  # largest exponent: forces that do not fall with the distance are springs, or uniform
FAN_PLACES = 16
FAN_WIDTHS = (0.35, 0.9)  # of the spread of places
WIDEST = 2.0  # spreads: what is wider is no local jet
SLOWEST, FASTEST = 1.0, 5.0  # forcing: cycles per run, fewer being any slow change, and Hz
MOST_FREQUENCIES = 16
SEEN_FREQUENCIES = 6  # that residuals tell, beside them
PHASES = (0.0, np.pi / 2)


def _place(added: Effect, prefix: str, found: Conditions, far: float = FAR) -> list[Unknown]:
    return [
        of_effect(
            added,
            f"{prefix}_{'xyz'[a]}",
            0.3 * found.spread,
            lower=float(found.middle[a]) - far * found.size,
            upper=float(found.middle[a]) + far * found.size,
        )
        for a in found.axes
    ]


def _there(prefix: str, place: Array, found: Conditions) -> dict[str, float]:
    return {f"{prefix}_{'xyz'[a]}": float(place[a]) for a in found.axes}


def _at_rest(prefix: str, found: Conditions) -> dict[str, float]:
    """Coordinates of a place that are not unknown: those of the plane of motion, or of axes nobody measured."""
    return {f"{prefix}_{'xyz'[a]}": float(found.middle[a]) for a in range(3)}


def _counts(found: Conditions, each: int) -> list[int]:
    """Grid points along the axes of motion: three along height would cost much and tell little."""
    return [each] * min(len(found.axes), 2) + [2] * max(0, len(found.axes) - 2)


def _spring(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not world.objects or not found.axes:
        return ()
    added = effect(world, "spring", _at_rest("anchor", found))
    stiffness = of_effect(added, "stiffness", found.force / found.spread)
    unknowns = (stiffness, *_place(added, "anchor", found))
    # The pull of a spring without rest length is linear in stiffness and anchor: few places suffice.
    grid = [*box_grid(found, [2] * len(found.axes)), found.middle, *box_grid(found, [2] * len(found.axes), margin=1.0)]
    starts = tuple(neutral(unknowns, **_there("anchor", place, found)) for place in grid)
    return (Variant(with_effects(world, added), unknowns, starts, strength="stiffness", idle=_names(unknowns[1:])),)


def _names(unknowns: Sequence[Unknown]) -> tuple[str, ...]:
    return tuple(u.name for u in unknowns)


def _distances(world: World, recording: Recording, place: Array, middle: Array) -> Array:
    parts = [
        np.linalg.norm(np.where(np.isfinite(t.places), t.places, middle) - place, axis=1)
        for t in tracks(world, recording)
    ]
    return np.concatenate(parts)


def _tether(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not world.objects or not found.axes:
        return ()
    added = effect(world, "tether", _at_rest("anchor", found))
    stiffness = of_effect(added, "stiffness", 2.0 * found.force / found.spread)
    length = of_effect(added, "rest_length", 0.3 * found.spread, upper=2.0 * FAR * found.size)
    unknowns = (stiffness, length, *_place(added, "anchor", found))
    starts = []
    for place in box_grid(found, _counts(found, 3), margin=-0.25):
        for length_here in np.quantile(_distances(world, recording, place, found.middle), LENGTHS):
            starts.append(neutral(unknowns, rest_length=float(length_here), **_there("anchor", place, found)))
    return (
        Variant(with_effects(world, added), unknowns, tuple(starts), strength="stiffness", idle=_names(unknowns[1:])),
    )


def _central(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not world.objects or not found.axes:
        return ()
    apart = 2.0 * found.spread
    softening = 0.02 * found.spread
    added = effect(world, "central_force", _at_rest("centre", found) | {"softening": softening})
    strength = of_effect(added, "strength", found.force * max(apart, apart**2))
    exponent = of_effect(added, "exponent", 0.5, upper=FALLING)
    unknowns = (strength, exponent, *_place(added, "centre", found))
    starts = []
    for place in box_grid(found, _counts(found, 4), margin=0.1):
        near = _distances(world, recording, place, found.middle).min()
        if near < 5.0 * softening:
            continue  # a pole on a path
        starts += [neutral(unknowns, exponent=n, **_there("centre", place, found)) for n in EXPONENTS]
    if not starts:
        return ()
    return (
        Variant(with_effects(world, added), unknowns, tuple(starts), strength="strength", idle=_names(unknowns[1:])),
    )


def _fan(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not world.objects or not found.axes:
        return ()
    added = effect(world, "fan", _at_rest("centre", found) | {"width": FAN_WIDTHS[0] * found.spread})
    forces = [of_effect(added, f"force_{'xyz'[a]}", 2.0 * found.force) for a in found.axes]
    width = of_effect(added, "width", 0.3 * found.spread, lower=0.05 * found.spread, upper=WIDEST * found.spread)
    unknowns = (*forces, *_place(added, "centre", found, 0.75), width)
    starts = tuple(
        neutral(unknowns, width=share * found.spread, **_there("centre", place, found))
        for place in visited_places(world, recording, FAN_PLACES)
        for share in FAN_WIDTHS
    )
    if not starts:
        return ()
    return (Variant(with_effects(world, added), unknowns, starts, idle=_names(unknowns[len(forces) :])),)


def _frame(recording: Recording) -> float:
    """Shortest time between frames of any run [s]."""
    return min(float(np.median(np.diff(run.times))) for run in recording.runs)


def _frequencies(found: Conditions, recording: Recording) -> Sequence[float]:
    """Evenly spaced, half a cycle per whole run apart as long as they are not too many, below half the frame rate."""
    low = SLOWEST / found.span
    high = min(FASTEST, 0.25 / _frame(recording))
    if high <= low:
        return (low,)
    count = int(np.clip(np.ceil((high - low) * found.span * 2.0), 2, MOST_FREQUENCIES))
    return tuple(np.linspace(low, high, count))


def _periodic(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not found.axes or found.span <= 0.0:
        return ()
    frequencies = _frequencies(found, recording)
    added = effect(world, "periodic_forcing", {"frequency": frequencies[0]})
    sizes = [of_effect(added, f"amplitude_{'xyz'[a]}", 2.0 * SHARE * found.acceleration) for a in found.axes]
    highest = max(2.0 * max(frequencies), 0.25 / _frame(recording))
    frequency = of_effect(added, "frequency", 0.25 / found.span, lower=SLOWEST / found.span, upper=highest)
    phase = of_effect(added, "phase", 0.5)
    unknowns = (*sizes, frequency, phase)
    starts = tuple(neutral(unknowns, frequency=f, phase=p) for f in frequencies for p in PHASES)
    return (Variant(with_effects(world, added), unknowns, starts, idle=("frequency", "phase")),)


def _seen_rhythms(bench: FitContext, trial: FittedHypothesis, variant: Variant) -> tuple[Mapping[str, float], ...]:
    """Starts at the frequencies at which residuals swing most, where those of the grid are too far apart, or end."""
    tried = sorted({start["frequency"] for start in variant.starts})
    if len(tried) < MOST_FREQUENCIES:
        return ()
    highest = next(u.upper for u in variant.unknowns if u.name == "frequency")
    found = rhythms(bench, trial, tried[0], highest, SEEN_FREQUENCIES)
    return tuple({"frequency": f, "phase": p} for f in found for p in PHASES)


CANDIDATES = (
    Candidate(
        name="spring",
        group="force",
        law="F = -k (x - a)",
        representations=RIGID,
        signature="residual towards one point, in proportion to the distance from it",
        reference="Hooke (1678), De potentia restitutiva",
        variants=_spring,
        confused_with={
            "tilt": "an anchor far away: motion over a larger region",
            "tether": "motion near the anchor, where a tether is slack",
            "observer_distortion": "a grid at rest: lenses distort it, springs do not",
        },
    ),
    Candidate(
        name="tether",
        group="force",
        law="F = -k (r - L) towards the anchor where r > L, else none",
        representations=RIGID,
        signature="residual that sets in at a distance from a point, towards it",
        reference="Hooke (1678), De potentia restitutiva; a cord bears no compression",
        variants=_tether,
        confused_with={
            "spring": "motion near the anchor",
            "hidden_wall": "the place where it turns back: a wall is straight and acts at once",
        },
    ),
    Candidate(
        name="central_force",
        group="force",
        law="F = -s r^n towards a point",
        representations=RIGID,
        signature="residual towards, or away from, one point, stronger the nearer it is",
        reference="Newton, Principia I, prop. 10 and 11",
        variants=_central,
        confused_with={
            "spring": "passes at several distances: a spring pulls more from afar",
            "fan": "passes on opposite sides: a fan pushes to one side",
        },
    ),
    Candidate(
        name="fan",
        group="force",
        law="F = f exp(-|x - c|^2 / (2 w^2))",
        representations=RIGID,
        signature="a push in one direction on what passes one place",
        reference="Pope, Turbulent Flows, 5.1",
        variants=_fan,
        confused_with={
            "friction_patch": "crossings at several speeds and headings: friction is against the motion",
            "central_force": "passes on opposite sides",
            "hidden_body": "a crossing a little aside: a jet fades, a body is missed",
        },
    ),
    Candidate(
        name="periodic_forcing",
        group="force",
        law="a = A sin(2 pi f t + phi)",
        representations=BODIES,
        signature="residual acceleration that swings with time, alike wherever the body is",
        reference="Landau & Lifshitz, Mechanics, 22 and 39",
        variants=_periodic,
        further=_seen_rhythms,
        confused_with={
            "tilt": "a later start, or a longer run: forcing changes its sign",
            "spring": "the same motion begun at another time",
        },
    ),
)
