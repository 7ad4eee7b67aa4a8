"""Conditions between two stretches of a body's motion: equations in the unknowns of both.

The time of a contact is unknown within the interval between two frames, which makes the place uncertain along the
change of velocity, and along nothing else. From a floor a body rebounds with a part of its normal velocity, and loses
a part of its tangential velocity, of which a ball that grips without spin keeps 5/7.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.flight.evidence import Motion
from atw_mcp.perception.flight.settings import FlightSettings
from atw_mcp.perception.flight.surfaces import Surface

Floats = NDArray[np.float64]
HALF_LOG = 0.5 * float(np.log(2.0 * np.pi))


@dataclass(frozen=True)
class Side:
    """A motion on one side of a contact.

    place, speed (3, 6): derivatives of its place and velocity by its unknowns; rest, pull (3,): both where these are
    zero; velocity (3,): as it is solved for.
    """

    place: Floats
    speed: Floats
    rest: Floats
    pull: Floats
    velocity: Floats

    @classmethod
    def of(cls, motion: Motion, unknowns: Floats, time: float) -> Side:
        """Return a motion with unknowns (6,) at a time."""
        at = np.array([time])
        still = motion.velocities(at, np.zeros((1, 6)))[0]
        return cls(
            motion.basis(at)[0],
            motion.velocity_basis(at)[0],
            motion.known(at)[0],
            still,
            motion.velocities(at, unknowns[None])[0],
        )


@dataclass(frozen=True)
class Equations:
    """Equations in the unknowns a, b (6,) of two motions: before @ a + after @ b = wanted, with a covariance (d, d).

    price: of what has to happen for these to hold, in nats, and of what was expected of the motions without them.
    """

    before: Floats
    after: Floats
    wanted: Floats
    covariance: Floats
    price: float

    def cost(self, a: Floats | None, b: Floats | None) -> float:
        """Minus the log density of the equations; where the unknowns are not solved for, as if they were fulfilled."""
        cost = len(self.wanted) * HALF_LOG + 0.5 * float(np.linalg.slogdet(self.covariance)[1]) + self.price
        if a is None or b is None:
            return cost
        apart = self.before @ a + self.after @ b - self.wanted
        return cost + 0.5 * float(apart @ np.linalg.solve(self.covariance, apart))

    def normal(self) -> tuple[Floats, Floats]:
        """Return the matrix (12, 12) and right side (12,) of their normal equations."""
        rows = np.hstack([self.before, self.after])
        weighted = np.linalg.solve(self.covariance, np.column_stack([rows, self.wanted]))
        return rows.T @ weighted[:, :12], rows.T @ weighted[:, 12]


def joined(one: Side, two: Side, interval: float, price: float, settings: FlightSettings) -> Equations:
    """Both motions meet in one place, at a time within an interval [s]."""
    turn = _turn(one, two, settings)
    covariance = settings.joint**2 * np.eye(3) + interval**2 / 12.0 * np.outer(turn, turn)
    return Equations(one.place, -two.place, two.rest - one.rest, covariance, price)


def landed(
    one: Side, two: Side, interval: float, surface: Surface, usual: float, settings: FlightSettings
) -> Equations:
    """Return equations of a flight that ends on a surface, where the body keeps most of its tangential velocity.

    usual [m/s]: standard deviation of velocities where nothing is known of them.
    """
    along = surface.axes
    meeting = joined(one, two, interval, 0.0, settings)
    covariance = np.zeros((5, 5))
    covariance[:3, :3], covariance[3:, 3:] = meeting.covariance, _slip(one, surface.normal, settings) * np.eye(2)
    return Equations(
        np.vstack([meeting.before, settings.kept * along @ one.speed]),
        np.vstack([meeting.after, -along @ two.speed]),
        np.concatenate([meeting.wanted, along @ (two.pull - settings.kept * one.pull)]),
        covariance,
        -2.0 * (HALF_LOG + float(np.log(usual))),
    )


def rebound(
    one: Side,
    two: Side,
    interval: float,
    floor: Surface,
    heights: tuple[float, float],
    usual: float,
    settings: FlightSettings,
) -> Equations:
    """Both are flights that meet on the floor, from which the body rebounds.

    heights: least and largest of the body's centre above the floor it touches. usual [m/s]: standard deviation of
    velocities where nothing is known of them.
    """
    normal = floor.normal
    turn, mean = _turn(one, two, settings), 0.5 * (one.velocity + two.velocity)
    low, high = heights
    size = float(np.hypot(0.5 * (high - low), settings.touch * low))
    meeting = np.append(turn, normal @ mean)  # how fast all that is compared changes with the time of contact
    covariance = np.zeros((7, 7))
    covariance[:4, :4] = interval**2 / 12.0 * np.outer(meeting, meeting)
    covariance[:4, :4] += np.diag([settings.joint**2] * 3 + [settings.joint**2 + size**2])
    into = float(normal @ one.velocity)
    upward = np.outer(normal, normal)
    bounce = (settings.restitution_spread * into) ** 2 + settings.gain**2
    covariance[4:, 4:] = _slip(one, normal, settings) * (np.eye(3) - upward) + bounce * upward
    kept = settings.kept * (np.eye(3) - upward) - settings.restitution * upward  # velocity after = kept @ before
    touching = 0.5 * (low + high) + normal @ (floor.point - 0.5 * (one.rest + two.rest))
    return Equations(
        np.vstack([one.place, 0.5 * normal @ one.place, kept @ one.speed]),
        np.vstack([-two.place, 0.5 * normal @ two.place, -two.speed]),
        np.concatenate([two.rest - one.rest, [touching], two.pull - kept @ one.pull]),
        covariance,
        -3.0 * (HALF_LOG + float(np.log(usual))),
    )


def _slip(one: Side, normal: Floats, settings: FlightSettings) -> float:
    """Variance of the tangential velocity after a contact [m^2/s^2]."""
    into = float(normal @ one.velocity)
    along = float(np.linalg.norm(one.velocity - into * normal))
    return (settings.kept_spread * along) ** 2 + (settings.rubbing * into) ** 2 + settings.gain**2


def _turn(one: Side, two: Side, settings: FlightSettings) -> Floats:
    """Change of velocity (3,) [m/s], as long as an error of velocity at least."""
    turn = one.velocity - two.velocity
    length = float(np.linalg.norm(turn))
    if length >= settings.gain:
        return turn
    return settings.gain * (turn / length if length > 0.0 else np.array([0.0, 0.0, 1.0]))
