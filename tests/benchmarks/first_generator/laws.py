"""Hidden effects on one ball: the laws, written down from the literature, and how a case draws one of them.

Nothing here is shared with the engine. Each function draws what an effect has besides its strength (direction, place,
frequency) and says how a strength puts it into the ball's laws, or into what the observer reports. Strengths are set by
`strength`, so that every effect moves the launches by a like amount.
"""

# ruff: noqa: ARG001, ARG005  (every law has the same arguments and uses some)

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.first_generator.observer import Fault
from tests.scenes.ball import Ball, Patch, Plane, UnusableCase

Array = NDArray[np.float64]
Numbers = dict[str, float]


@dataclass(frozen=True)
class Scenery:
    """Input of a draw: the base ball, and the base world's paths (runs, T, 3) over times (T,).

    Places are chosen by the first `fitted` paths: those that will be given.
    """

    ball: Ball
    restitution: float
    paths: Array
    times: Array
    fitted: int


@dataclass(frozen=True)
class Drawn:
    """One effect without its strength.

    apply: (ball, strength) -> ball. fault: strength -> what the observer does. true_values: strength -> those under
    names the scorer knows. guess, most: a first strength and the largest. place: centre and extent for the scorer.
    fixed: there is no strength to set. least: share of the path scale below which the draw is not used.
    """

    name: str
    true_values: Callable[[float], Numbers]
    guess: float = 1.0
    most: float = np.inf
    apply: Callable[[Ball, float], Ball] = lambda ball, s: ball
    fault: Callable[[float], Fault] | None = None
    place: Numbers | None = None
    fixed: bool = False
    least: float = 0.005


def unit(rng: np.random.Generator, *, flat: bool = False) -> Array:
    """Return a random direction, along the floor where `flat`."""
    v = rng.normal(size=3)
    if flat:
        v[2] = 0.0
    return v / np.linalg.norm(v)


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def with_force(ball: Ball, law: Callable[[float, Array, Array, Array], Array], step: float = 0.1) -> Ball:
    """Return the ball with one more force."""
    return replace(ball, forces=(*ball.forces, law), longest_step=min(ball.longest_step, step))


def gravity_error(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    sign = _sign(rng)

    def apply(ball: Ball, s: float) -> Ball:
        return replace(ball, gravity=(0.0, 0.0, ball.gravity[2] * (1.0 + sign * s)))

    return Drawn("gravity_error", lambda s: {"gravity_z": -9.81 * (1.0 + sign * s)}, guess=0.03, most=0.3, apply=apply)


def tilt(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    d = unit(rng, flat=True)
    return Drawn(
        "tilt",
        lambda s: {"x": s * d[0], "y": s * d[1]},
        guess=0.3,
        apply=lambda b, s: with_force(b, lambda t, x, v, w: b.mass * s * d),
    )


def linear_drag(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    return Drawn(
        "linear_drag",
        lambda s: {"coefficient": s},
        guess=0.05,
        apply=lambda b, s: with_force(b, lambda t, x, v, w: -s * v),
    )


def quadratic_drag(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    return Drawn(
        "quadratic_drag",
        lambda s: {"coefficient": s},
        guess=0.01,
        apply=lambda b, s: with_force(b, lambda t, x, v, w: -s * np.linalg.norm(v) * v),
    )


def wind(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    air = rng.uniform(2.0, 6.0) * unit(rng, flat=True)
    return Drawn(
        "wind",
        lambda s: {"coefficient": s, "velocity_x": air[0], "velocity_y": air[1]},
        guess=0.01,
        apply=lambda b, s: with_force(b, lambda t, x, v, w: -s * np.linalg.norm(v - air) * (v - air)),
    )


def magnus_lift(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    sign = _sign(rng)
    return Drawn(
        "magnus_lift",
        lambda s: {"coefficient": sign * s},
        guess=0.01,
        apply=lambda b, s: with_force(b, lambda t, x, v, w: sign * s * np.cross(w, v)),
    )


def coriolis(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    turn = unit(rng)
    return Drawn(
        "coriolis",
        lambda s: {"rotation_x": s * turn[0], "rotation_y": s * turn[1], "rotation_z": s * turn[2]},
        guess=0.05,
        apply=lambda b, s: with_force(b, lambda t, x, v, w: -2.0 * b.mass * s * np.cross(turn, v)),
    )


def buoyancy(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    """A fluid with the share s of the ball's density: it carries that weight, and half of that mass moves along."""

    def apply(ball: Ball, s: float) -> Ball:
        return replace(ball, weight_lost=s * ball.mass, added_mass=0.5 * s * ball.mass)

    return Drawn("buoyancy", lambda s: {"density_ratio": s}, guess=0.02, most=0.3, apply=apply)


def spin_damping(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    """The spin decays at 0.05 to 0.5 per second: it shows in the turns, hardly in the places."""
    coefficient = scenery.ball.inertia * float(np.exp(rng.uniform(np.log(0.05), np.log(0.5))))

    def apply(ball: Ball, s: float) -> Ball:
        return replace(ball, torques=(*ball.torques, lambda t, x, v, w: -coefficient * w))

    return Drawn("spin_damping", lambda s: {"coefficient": coefficient}, apply=apply, fixed=True, least=0.0)


def spring(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    anchor = np.array([*rng.uniform(-1.0, 1.0, 2), rng.uniform(0.2, 2.0)])
    return Drawn(
        "spring",
        lambda s: {"stiffness": s, **_xyz("anchor", anchor)},
        guess=0.2,
        apply=lambda b, s: with_force(b, lambda t, x, v, w: -s * (x - anchor)),
    )


def tether(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    anchor = np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(1.5, 3.0)])
    reach = np.linalg.norm(scenery.paths - anchor, axis=-1)
    length = float(np.quantile(reach, rng.uniform(0.4, 0.6)))

    def law(b: Ball, s: float) -> Ball:
        def force(t: float, x: Array, v: Array, w: Array) -> Array:
            arm = x - anchor
            r = float(np.linalg.norm(arm))
            return -s * max(r - length, 0.0) * arm / max(r, 1e-9)

        return with_force(b, force, 0.02)

    return Drawn(
        "tether",
        lambda s: {"stiffness": s, "rest_length": length, **_xyz("anchor", anchor)},
        guess=0.5,
        apply=law,
    )


def central_force(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    """F = -s r^-n towards a point that no path comes close to."""
    power = float(rng.choice([1.0, 2.0]))
    sign = _sign(rng)
    for _ in range(200):
        centre = np.array([*rng.uniform(-2.0, 2.0, 2), rng.uniform(0.5, 3.0)])
        if np.linalg.norm(scenery.paths - centre, axis=-1).min() > 0.6:
            break

    def law(b: Ball, s: float) -> Ball:
        def force(t: float, x: Array, v: Array, w: Array) -> Array:
            arm = x - centre
            r = max(float(np.linalg.norm(arm)), 0.1)
            return -sign * s * r ** (-power - 1.0) * arm

        return with_force(b, force, 0.03)

    return Drawn(
        "central_force",
        lambda s: {"strength": sign * s, "exponent": -power, **_xyz("centre", centre)},
        guess=0.3,
        apply=law,
    )


def periodic_forcing(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    d, frequency, phase = unit(rng), float(rng.uniform(0.8, 2.5)), float(rng.uniform(-np.pi, np.pi))
    turn = 2.0 * np.pi * frequency
    return Drawn(
        "periodic_forcing",
        lambda s: {"frequency": frequency},
        guess=1.0,
        apply=lambda b, s: with_force(b, lambda t, x, v, w: s * np.sin(turn * t + phase) * d, 0.03),
    )


def fan(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    """Return a jet that is Gaussian in space: F = s d exp(-|x - c|^2 / (2 width^2)); its centre lies near two paths."""
    d, width = unit(rng), float(rng.uniform(0.4, 0.8))
    for _ in range(300):
        run = scenery.paths[rng.integers(scenery.fitted)]
        centre = run[rng.integers(len(run) // 5, 4 * len(run) // 5)] + rng.normal(0.0, 0.1, 3)
        near = np.linalg.norm(scenery.paths - centre, axis=-1).min(axis=1) < width
        if near[: scenery.fitted].sum() >= min(3, scenery.fitted):
            break
    return Drawn(
        "fan",
        lambda s: {**_xyz("force", s * d), **_xyz("centre", centre), "width": width},
        guess=1.0,
        apply=lambda b, s: with_force(
            b, lambda t, x, v, w: s * d * np.exp(-((x - centre) @ (x - centre)) / (2.0 * width**2)), 0.02
        ),
        place={"x": centre[0], "y": centre[1], "z": centre[2], "extent": width},
    )


def restitution_error(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    sign, e = _sign(rng), scenery.restitution
    return Drawn(
        "restitution_error",
        lambda s: {"restitution": e + sign * s},
        guess=0.05,
        most=0.18,
        apply=lambda b, s: replace(b, restitution=lambda speed: b.restitution(speed) + sign * s),
    )


def restitution_speed(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    return Drawn(
        "restitution_speed",
        lambda s: {"rate": s},
        guess=0.02,
        most=0.3,
        apply=lambda b, s: replace(b, restitution=lambda speed: b.restitution(speed) / (1.0 + s * speed)),
    )


def bounce_friction(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    return Drawn(
        "bounce_friction",
        lambda s: {"share": s},
        guess=0.05,
        most=0.5,
        apply=lambda b, s: replace(b, tangential_loss=s),
    )


def spin_coupling(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    """Tangential restitution; -1 leaves the tangential velocity alone, and Coulomb's limit no longer holds."""
    value = float(rng.uniform(-0.5, 0.7))
    return Drawn(
        "spin_coupling",
        lambda s: {"restitution": value},
        apply=lambda b, s: replace(b, tangential=value),
        fixed=True,
    )


def friction_error(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    sign = _sign(rng)

    def value(s: float) -> float:
        return scenery.ball.friction * float(np.exp(sign * s))

    return Drawn(
        "friction_error",
        lambda s: {"friction": value(s)},
        guess=0.2,
        most=1.2,
        apply=lambda b, s: replace(b, friction=value(s)),
    )


def rolling_resistance(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    return Drawn(
        "rolling_resistance",
        lambda s: {"rolling_resistance": s},
        guess=0.001,
        most=0.006,  # half of friction times radius: beyond it, the ball would slide rather than roll
        apply=lambda b, s: replace(b, rolling=s),
    )


def viscous_friction(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    return Drawn(
        "viscous_friction",
        lambda s: {"coefficient": s},
        guess=0.05,
        apply=lambda b, s: replace(b, contact_drag=s),
    )


def friction_patch(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    """Return a disc of the floor, crossed by at least three launches, that is rougher or smoother than the rest."""
    sign = _sign(rng)
    given = scenery.paths[: scenery.fitted]
    for _ in range(300):
        x, y = rng.uniform(-0.6, 0.6, 2)
        radius = float(rng.uniform(0.35, 0.8))
        inside = np.hypot(given[..., 0] - x, given[..., 1] - y) < radius
        if (inside.sum(axis=1) > 5).sum() >= min(3, scenery.fitted):
            break

    def value(s: float) -> float:
        return scenery.ball.friction * float(np.exp(sign * s))

    return Drawn(
        "friction_patch",
        lambda s: {"x": x, "y": y, "radius": radius, "friction": value(s) - scenery.ball.friction},
        guess=0.5,
        most=2.2,
        apply=lambda b, s: replace(b, patches=(Patch(x, y, radius, value(s)),)),
        place={"x": x, "y": y, "extent": radius},
    )


def hidden_wall(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    """Return an upright plane that some launches run into, two at least of those given; all start on its free side."""
    radius = scenery.ball.radius
    for _ in range(500):
        angle = float(rng.uniform(-np.pi, np.pi))
        normal = np.array([np.cos(angle), np.sin(angle), 0.0])
        along = scenery.paths @ normal - radius  # free is where this exceeds the offset
        offset = float(rng.uniform(along.min(), along[:, 0].min()))
        met = (along[: scenery.fitted] < offset).sum(axis=1)
        if offset < along[:, 0].min() - 0.05 and (met > len(scenery.times) // 6).sum() >= min(2, scenery.fitted):
            break
    else:
        raise UnusableCase("no place for a wall among these launches")
    plane = Plane((float(normal[0]), float(normal[1]), 0.0), offset)
    return Drawn(
        "hidden_wall",
        lambda s: {},
        apply=lambda b, s: replace(b, planes=(*b.planes, plane)),
        place={"normal_x": plane.normal[0], "normal_y": plane.normal[1], "offset": offset},
        fixed=True,
    )


def observer_scale(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    sign = _sign(rng)
    return Drawn(
        "observer_scale",
        lambda s: {"scale": 1.0 + sign * s},
        guess=0.03,
        most=0.3,
        fault=lambda s: Fault(scale=1.0 + sign * s),
    )


def observer_clock(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    sign = _sign(rng)
    return Drawn(
        "observer_clock",
        lambda s: {"clock": 1.0 + sign * s},
        guess=0.03,
        most=0.3,
        fault=lambda s: Fault(clock=1.0 + sign * s),
    )


def observer_tilt(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    d = unit(rng, flat=True)
    return Drawn(
        "observer_tilt",
        lambda s: {"tilt_x": s * d[0], "tilt_y": s * d[1]},
        guess=0.03,
        most=0.5,
        fault=lambda s: Fault(tilt=(s * d[0], s * d[1], 0.0)),
    )


def observer_distortion(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    sign = _sign(rng)
    furthest = float(np.linalg.norm(scenery.paths, axis=-1).max())
    return Drawn(
        "observer_distortion",
        lambda s: {"distortion": sign * s},
        guess=0.003,
        most=0.25 / furthest**2,
        fault=lambda s: Fault(distortion=sign * s),
    )


def dropped_frames(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    """In one run some frames were lost, or recorded twice, at one moment; the stamps do not show it."""
    speeds = np.linalg.norm(np.diff(scenery.paths, axis=1), axis=-1).mean(axis=1)[: scenery.fitted]
    run = int(rng.choice(np.flatnonzero(speeds >= np.median(speeds))))  # a ball at rest would not show it
    lost = int(rng.integers(1, 7)) * int(_sign(rng))
    interval = float(scenery.times[1] - scenery.times[0])
    frame = int(rng.uniform(0.25, 0.75) * len(scenery.times))
    return Drawn(
        "dropped_frames",
        lambda s: {"shift": lost * interval, "shift_time": (frame - 0.5) * interval},
        fault=lambda s: Fault(lost=lost, lost_after=frame, lost_run=run),
        place={"run": float(run), "onset": (frame - 0.5) * interval, "extent": 2.0 * interval},
        fixed=True,
        least=0.0,
    )


def _xyz(name: str, vector: Array) -> Numbers:
    return {f"{name}_{axis}": float(value) for axis, value in zip("xyz", vector, strict=True)}


Draw = Callable[[np.random.Generator, Scenery], Drawn]

# Designs that let an effect act, where it is not that of bounces.
DESIGNS_OF: dict[str, tuple[str, ...]] = {
    "friction_error": ("bouncing", "sliding"),
    "hidden_wall": ("outward",),
    "friction_patch": ("sliding",),
    "viscous_friction": ("sliding",),
    "rolling_resistance": ("floor",),
}
EFFECTS: dict[str, tuple[Draw, tuple[str, ...]]] = {
    f.__name__: (f, DESIGNS_OF.get(f.__name__, ("bouncing",)))
    for f in (
        gravity_error, tilt, linear_drag, quadratic_drag, wind, magnus_lift, coriolis, buoyancy, spin_damping,
        spring, tether, central_force, periodic_forcing, fan, restitution_error, restitution_speed, bounce_friction,
        spin_coupling, friction_error, hidden_wall, observer_scale, observer_clock, observer_tilt,
        observer_distortion, dropped_frames, friction_patch, viscous_friction, rolling_resistance
    )
}  # fmt: skip
