"""A ball that flies, bounces, slides and rolls under hidden laws: SciPy's DOP853 from event to event.

Shares no code with the engine. A flight ends where the ball's surface meets a plane (root of the dense output), an
impact is instantaneous (Newton's restitution; Coulomb's friction with its impulse limited by sticking), and on the
floor the ball slides by Coulomb's law until the point that touches stands still, then rolls. SI units, z up.
"""

# ruff: noqa: ARG001, ARG005  (every law has the same arguments and uses some)

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
Force = Callable[[float, Array, Array, Array], Array]

UP = np.array([0.0, 0.0, 1.0])
RESTING = 2e-3  # rebounds slower than this stay on the floor: hops of 0.2 micrometres [m/s]
STILL = 1e-5  # slip slower than this counts as none [m/s]
ROLLING_MARGIN = 1e-9


class UnusableCase(Exception):
    """What was drawn leaves the range of the model (the ball is lifted off the floor); another draw is needed."""


@dataclass(frozen=True)
class Plane:
    """A half space of solid: points p with normal . p < offset."""

    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    offset: float = 0.0


@dataclass(frozen=True)
class Patch:
    """A disc of the floor with a friction of its own."""

    x: float
    y: float
    radius: float
    friction: float


@dataclass(frozen=True)
class Ball:
    """A homogeneous ball and all laws that move it. Planes: the floor first, then hidden walls.

    forces: (t, x, v, omega) -> force [N], gravity left out. torques: the same, torque [N m]. wrench: (state: x, v,
    quaternion, omega) -> force and torque. added_mass: moves with the ball between impacts [kg]; weight_lost: mass
    whose weight a fluid carries [kg]. restitution: of an impact as a function of approach speed. tangential:
    restitution of the touching point's tangential velocity (Garwin 1969, Am. J. Phys. 37, 88), None for Coulomb
    friction. tangential_loss: share of the tangential velocity of the centre that every impact takes besides. rolling:
    lever arm of rolling resistance [m]. contact_drag: force per speed while it touches the floor [kg/s].
    """

    mass: float = 0.5
    radius: float = 0.1
    friction: float = 0.3
    restitution: Callable[[float], float] = lambda speed: 0.8
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    forces: tuple[Force, ...] = ()
    torques: tuple[Force, ...] = ()
    wrench: Callable[[Array], Array] | None = None
    added_mass: float = 0.0
    weight_lost: float = 0.0
    tangential: float | None = None
    tangential_loss: float = 0.0
    patches: tuple[Patch, ...] = ()
    rolling: float = 0.0
    contact_drag: float = 0.0
    planes: tuple[Plane, ...] = field(default=(Plane(),))
    longest_step: float = 0.1

    @property
    def inertia(self) -> float:
        """Moment of inertia about any axis through the centre [kg m^2]."""
        return 0.4 * self.mass * self.radius**2

    @property
    def moved_mass(self) -> float:
        """Mass that a force accelerates [kg]."""
        return self.mass + self.added_mass


@dataclass(frozen=True)
class Launch:
    """How a run begins: position, velocity, angular velocity (world axes)."""

    position: tuple[float, float, float]
    velocity: tuple[float, float, float]
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Path:
    """Positions (T, 3), velocities (T, 3), orientations (T, 4; w, x, y, z), spins (T, 3); times of impacts."""

    positions: Array
    velocities: Array
    orientations: Array
    spins: Array
    impacts: tuple[float, ...]


def fly(ball: Ball, launch: Launch, times: Array, *, tolerance: float = 1e-9) -> Path:
    """The motion at `times` (increasing, the first one is the launch)."""
    y = np.concatenate([launch.position, launch.velocity, [1.0, 0.0, 0.0, 0.0], launch.spin]).astype(np.float64)
    t, end = float(times[0]), float(times[-1])
    rows = np.empty((len(times), 13))
    impacts: list[float] = []
    filled = 0
    on_floor = abs(y[2] - ball.radius) < 1e-12 and abs(y[5]) < 1e-12
    while filled < len(times):
        if on_floor:
            t, y, samples, on_floor = _on_floor(ball, t, y, times[filled:], tolerance)
        else:
            t, y, samples, plane = _flight(ball, t, y, times[filled:], tolerance)
            if plane is not None:
                impacts.append(t)
                y = _impact(ball, y, plane)
                on_floor = plane is ball.planes[0] and y[5] < RESTING and _pressed(ball, t, y)
                if on_floor:
                    y[2], y[5] = ball.radius, 0.0
        rows[filled : filled + len(samples)] = samples
        filled += len(samples)
        if t >= end:
            break
    if filled < len(times):
        rows[filled:] = y
    q = rows[:, 6:10]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return Path(rows[:, :3], rows[:, 3:6], q, rows[:, 10:], tuple(impacts))


def _loads(ball: Ball, t: float, s: Array) -> tuple[Array, Array]:
    """Force and torque of all but contacts."""
    x, v, w = s[:3], s[3:6], s[10:]
    force = (ball.mass - ball.weight_lost) * np.asarray(ball.gravity)
    torque = np.zeros(3)
    for law in ball.forces:
        force = force + law(t, x, v, w)
    for law in ball.torques:
        torque = torque + law(t, x, v, w)
    if ball.wrench is not None:
        both = ball.wrench(s)
        force, torque = force + both[:3], torque + both[3:]
    return force, torque


def _turning(q: Array, w: Array) -> Array:
    """Rate of a quaternion that turns with the angular velocity w (world axes)."""
    a, b, c, d = q
    x, y, z = w
    return 0.5 * np.array([-x * b - y * c - z * d, x * a + y * d - z * c, y * a + z * b - x * d, z * a + x * c - y * b])


def _flight(ball: Ball, t: float, y: Array, times: Array, tolerance: float) -> tuple[float, Array, Array, Plane | None]:
    """Free flight until a plane is met or the time is over: time, state, samples on the way, the plane met."""

    def rate(time: float, s: Array) -> Array:
        force, torque = _loads(ball, time, s)
        return np.concatenate([s[3:6], force / ball.moved_mass, _turning(s[6:10], s[10:]), torque / ball.inertia])

    def gap_to(plane: Plane) -> Callable[[float, Array], float]:
        normal = np.asarray(plane.normal)

        def gap(time: float, s: Array) -> float:
            return float(normal @ s[:3]) - plane.offset - ball.radius

        gap.terminal = True  # type: ignore[attr-defined]
        gap.direction = -1.0  # type: ignore[attr-defined]
        return gap

    end = float(times[-1])
    # After a rebound the first step must end before the ball is back, or the root at the start would be found again.
    leaving = [float(np.dot(p.normal, y[3:6])) for p in ball.planes if gap_to(p)(t, y) < 1e-9]
    first = min([0.02, *(0.3 * v / 20.0 for v in leaving if v > 0.0)])
    for plane in ball.planes:
        lack = gap_to(plane)(t, y)
        if lack < 0.0:
            y = y.copy()
            y[:3] -= lack * np.asarray(plane.normal)
    if end - t < 1e-12:
        return end, y, y[None, :].repeat(len(times), axis=0), None
    found = solve_ivp(
        rate,
        (t, end),
        y,
        method="DOP853",
        rtol=tolerance,
        atol=tolerance,
        events=[gap_to(p) for p in ball.planes],
        dense_output=True,
        first_step=min(first, end - t),
        max_step=ball.longest_step,
    )
    if found.status == 1:
        which = next(i for i, e in enumerate(found.t_events) if len(e))
        stop, state = float(found.t_events[which][0]), np.array(found.y_events[which][0])
        return stop, state, _samples(found.sol, times[times < stop]), ball.planes[which]
    return end, found.y[:, -1].copy(), _samples(found.sol, times), None


def _samples(solution: Callable[[Array], Array], times: Array) -> Array:
    """States (T, 13); SciPy's dense output takes no empty list of times."""
    return solution(times).T if len(times) else np.empty((0, 13))


def _impact(ball: Ball, y: Array, plane: Plane) -> Array:
    """The state after an instantaneous impact with a plane; a fluid that moves along takes no part in it."""
    y = y.copy()
    normal = np.asarray(plane.normal)
    v, w = y[3:6], y[10:]
    approach = -float(normal @ v)
    if approach <= 0.0:
        return y
    arm = -ball.radius * normal
    push = (1.0 + ball.restitution(approach)) * ball.mass * approach
    slip = v + np.cross(w, arm)
    slip = slip - (slip @ normal) * normal
    speed = float(np.linalg.norm(slip))
    sticking = 1.0 / (1.0 / ball.mass + ball.radius**2 / ball.inertia)
    if ball.tangential is not None:
        across = -(1.0 + ball.tangential) * sticking * slip
    elif speed > 0.0:
        across = -min(sticking * speed, _friction(ball, y[:3]) * push) * slip / speed
    else:
        across = np.zeros(3)
    v = v + (push * normal + across) / ball.mass
    flat = v - (v @ normal) * normal
    y[3:6] = v - ball.tangential_loss * flat
    y[10:] = w + np.cross(arm, across) / ball.inertia
    return y


def _friction(ball: Ball, x: Array) -> float:
    for patch in ball.patches:
        if (x[0] - patch.x) ** 2 + (x[1] - patch.y) ** 2 < patch.radius**2:
            return patch.friction
    return ball.friction


def _pressed(ball: Ball, t: float, y: Array) -> bool:
    return bool(_loads(ball, t, y)[0][2] < 0.0)


def _slip(ball: Ball, s: Array) -> Array:
    """Velocity of the point that touches the floor (2,)."""
    return np.array([s[3] - ball.radius * s[11], s[4] + ball.radius * s[10]])


def _contact_loads(ball: Ball, t: float, s: Array) -> tuple[Array, float, Array]:
    """Force along the floor (2,), normal force, torque of all but friction (3,)."""
    w = s[10:]
    force, torque = _loads(ball, t, s)
    force = force - ball.contact_drag * s[3:6]
    normal = -float(force[2])
    if normal <= 0.0:
        raise UnusableCase("the ball is lifted off the floor")
    turning = float(np.hypot(w[0], w[1]))
    if ball.rolling > 0.0 and turning > 0.0:
        torque = torque - ball.rolling * normal * np.array([w[0], w[1], 0.0]) / turning
    return force[:2], normal, torque


def _holding(ball: Ball, t: float, s: Array) -> tuple[Array, float]:
    """Friction that keeps the ball rolling (2,), and the normal force."""
    force, normal, torque = _contact_loads(ball, t, s)
    lever = ball.moved_mass * ball.radius / ball.inertia
    turned = np.array([torque[1], -torque[0]])  # torque x up
    return (lever * turned - force) / (1.0 + lever * ball.radius), normal


def _on_floor(ball: Ball, t: float, y: Array, times: Array, tolerance: float) -> tuple[float, Array, Array, bool]:
    """One stretch of sliding or rolling; the last answer is whether the ball still touches the floor."""
    end = float(times[-1])
    slip = _slip(ball, y)
    rolls = float(np.linalg.norm(slip)) <= 2.0 * STILL
    if rolls:
        y = y.copy()
        y[10], y[11] = -y[4] / ball.radius, y[3] / ball.radius
        hold, normal = _holding(ball, t, y)
        needed, limit = float(np.linalg.norm(hold)), _friction(ball, y[:3]) * normal
        if needed > limit * (1.0 + ROLLING_MARGIN):  # it starts to slip against the friction that would be needed
            kick = -1e-3 * hold / needed
            y[10], y[11] = y[10] + kick[1] / ball.radius, y[11] - kick[0] / ball.radius
            rolls = False
        elif ball.rolling > 0.0 and float(np.hypot(y[3], y[4])) < STILL:
            force, normal, _ = _contact_loads(ball, t, np.concatenate([y[:3], np.zeros(3), y[6:10], [0, 0, y[12]]]))
            if float(np.linalg.norm(force)) * ball.radius <= ball.rolling * normal:
                y[3:6], y[10:12] = 0.0, 0.0
                rows = _on_its_spot(ball, t, y, times, tolerance)
                return end, rows[-1], rows, True

    def rate(time: float, s: Array) -> Array:
        if rolls:
            friction, _ = _holding(ball, time, s)
            force, _, torque = _contact_loads(ball, time, s)
        else:
            force, normal, torque = _contact_loads(ball, time, s)
            slip = _slip(ball, s)
            friction = -_friction(ball, s[:3]) * normal * slip / max(float(np.linalg.norm(slip)), 1e-12)
        a = (force + friction) / ball.moved_mass
        turn = (torque + np.array([ball.radius * friction[1], -ball.radius * friction[0], 0.0])) / ball.inertia
        return np.concatenate([s[3:5], [0.0], a, [0.0], _turning(s[6:10], s[10:]), turn])

    found = solve_ivp(
        rate,
        (t, end),
        y,
        method="DOP853",
        rtol=tolerance,
        atol=tolerance,
        events=_floor_events(ball, y, rolls),
        dense_output=True,
        first_step=min(1e-4, end - t) if end - t > 1e-12 else None,
        max_step=min(ball.longest_step, 0.05),
    )
    if found.status != 1:
        return end, found.y[:, -1].copy(), _samples(found.sol, times), True
    which = next(i for i, e in enumerate(found.t_events) if len(e))
    stop, state = float(found.t_events[which][0]), np.array(found.y_events[which][0])
    samples = _samples(found.sol, times[times < stop])
    walls = ball.planes[1:]
    if which < len(walls):
        state = _impact(ball, state, walls[which])
        if state[5] > RESTING:
            return stop, state, samples, False
        state[2], state[5] = ball.radius, 0.0
    elif len(walls) <= which < len(walls) + len(ball.patches):  # step over the edge, on the side it is heading for
        state[:2] += 1e-9 * state[3:5] / max(float(np.hypot(state[3], state[4])), 1e-9)
    return stop, state, samples, True


def _on_its_spot(ball: Ball, t: float, y: Array, times: Array, tolerance: float) -> Array:
    """States (T, 13) of a ball that has stopped rolling: nothing on the floor brakes its spin about the vertical."""

    def rate(time: float, s: Array) -> Array:
        _, _, torque = _contact_loads(ball, time, np.concatenate([y[:6], s[:4], [0.0, 0.0, s[4]]]))
        return np.concatenate([_turning(s[:4], np.array([0.0, 0.0, s[4]])), [torque[2] / ball.inertia]])

    begin = np.concatenate([y[6:10], [y[12]]])
    found = solve_ivp(
        rate, (t, float(times[-1])), begin, method="DOP853", rtol=tolerance, atol=tolerance, dense_output=True
    )
    rows = np.repeat(y[None], len(times), axis=0)
    turned = found.sol(times).T
    rows[:, 6:10] = turned[:, :4] / np.linalg.norm(turned[:, :4], axis=1, keepdims=True)
    rows[:, 12] = turned[:, 4]
    return rows


def _floor_events(ball: Ball, start: Array, rolls: bool) -> Sequence[Callable[[float, Array], float]]:
    """What ends a stretch on the floor: walls, edges of patches, then the end of slipping or of rolling."""
    events: list[tuple[Callable[[float, Array], float], float]] = []
    for plane in ball.planes[1:]:
        normal = np.asarray(plane.normal)
        events.append((lambda t, s, n=normal, d=plane.offset: float(n @ s[:3]) - d - ball.radius, -1.0))
    for patch in ball.patches:
        outside = (start[0] - patch.x) ** 2 + (start[1] - patch.y) ** 2 >= patch.radius**2
        events.append(
            (
                lambda t, s, p=patch: (s[0] - p.x) ** 2 + (s[1] - p.y) ** 2 - p.radius**2,
                -1.0 if outside else 1.0,
            )
        )
    if rolls:

        def reserve(t: float, s: Array) -> float:
            hold, normal = _holding(ball, t, s)
            return _friction(ball, s[:3]) * normal * (1.0 + ROLLING_MARGIN) - float(np.linalg.norm(hold))

        events.append((reserve, -1.0))
        if ball.rolling > 0.0:
            heading = start[3:5] / max(float(np.hypot(start[3], start[4])), 1e-12)
            events.append((lambda t, s: float(heading @ s[3:5]), -1.0))
    else:
        events.append((lambda t, s: float(np.linalg.norm(_slip(ball, s))) - STILL, -1.0))
    for event, direction in events:
        event.terminal = True  # type: ignore[attr-defined]
        event.direction = direction  # type: ignore[attr-defined]
    return [event for event, _ in events]
