"""Discs that slide on a level plane and collide, under hidden laws: SciPy's DOP853 from event to event.

Shares no code with the engine. A sliding disc is braked by Coulomb friction of a patch of radius r: force and moment
oppose (v, r omega) together (Howe & Cutkosky 1996, IJRR 15, 557). Impacts are instantaneous: Newton's restitution, and
Coulomb friction limited by sticking. SI units; the plane is z = 0.
"""

# ruff: noqa: ARG005  (every law has the same arguments and uses some)

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tests.scenes.ball import Patch, UnusableCase

Array = NDArray[np.float64]
Law = Callable[[float, Array, Array, Array], Array]

STILL = 1e-4  # slower than this a disc that friction can hold is at rest [m/s]
MOST_EVENTS = 400
LOOK = 1e-3  # how often it is looked whether discs have passed through each other [s]
NEAR = 0.1  # further apart than this, at times so close, they have not [m]
GRAZE = 1e-10  # an overlap that is rounding [m]


@dataclass(frozen=True)
class Discs:
    """n discs and their laws. masses, radii (n,); frictions (n,) on the plane and, averaged, of contacts.

    forces: (t, x (n, 2), v (n, 2), omega (n,)) -> forces (n, 2) [N]. patches: of the plane. walls: (normal x, normal y,
    offset), solid where normal . p < offset. share: radius of the friction patch over that of the disc.
    """

    masses: Array
    radii: Array
    frictions: Array
    restitution: float
    gravity: float = 9.81
    forces: tuple[Law, ...] = ()
    patches: tuple[Patch, ...] = ()
    walls: tuple[tuple[float, float, float], ...] = ()
    share: float = 2.0 / 3.0

    @property
    def inertias(self) -> Array:
        """Moments of inertia about the axes (n,)."""
        return 0.5 * self.masses * self.radii**2


@dataclass(frozen=True)
class Started:
    """How a run begins: positions (n, 2), velocities (n, 2), spins (n,)."""

    positions: Array
    velocities: Array
    spins: Array


def slide(discs: Discs, start: Started, times: Array, *, tolerance: float = 1e-9) -> Array:
    """States (T, n, 6) at `times`: x, y, angle, vx, vy, spin; angles begin at 0."""
    n = len(discs.masses)
    state = np.zeros((n, 6))
    state[:, :2], state[:, 3:5], state[:, 5] = start.positions, start.velocities, start.spins
    t, end = float(times[0]), float(times[-1])
    rows = np.empty((len(times), n, 6))
    filled = 0
    for _ in range(MOST_EVENTS):
        held = _held(discs, t, state)
        state[held, 3:] = 0.0
        t, state, samples, pair = _until_event(discs, t, state, held, times[filled:], tolerance)
        rows[filled : filled + len(samples)] = samples
        filled += len(samples)
        if filled == len(times) or t >= end:
            return rows
        if pair is not None:
            state = _meet(discs, state, *pair)
    raise UnusableCase("the discs never come apart")


def _forces(discs: Discs, t: float, s: Array) -> Array:
    total = np.zeros((len(s), 2))
    for law in discs.forces:
        total = total + law(t, s[:, :2], s[:, 3:5], s[:, 5])
    return total


def _plane_friction(discs: Discs, s: Array) -> Array:
    """Limits (n,) of the friction of the plane [N]."""
    mu = discs.frictions.copy()
    for p in discs.patches:
        mu = np.where((s[:, 0] - p.x) ** 2 + (s[:, 1] - p.y) ** 2 < p.radius**2, p.friction, mu)
    return mu * discs.masses * discs.gravity


def _speed(discs: Discs, s: Array) -> Array:
    """What friction of the patch opposes (n,): sqrt(v^2 + (r omega)^2)."""
    return np.sqrt(s[:, 3] ** 2 + s[:, 4] ** 2 + (discs.share * discs.radii * s[:, 5]) ** 2)


def _held(discs: Discs, t: float, s: Array) -> NDArray[np.bool_]:
    pulled = np.linalg.norm(_forces(discs, t, np.column_stack([s[:, :3], np.zeros((len(s), 3))])), axis=1)
    return (_speed(discs, s) <= 1.01 * STILL) & (pulled <= _plane_friction(discs, s))


def _until_event(
    discs: Discs, t: float, state: Array, held: NDArray[np.bool_], times: Array, tolerance: float
) -> tuple[float, Array, Array, tuple[int, int] | None]:
    """Motion until discs meet, one stops or starts, or an edge of a patch is crossed; the pair that meets."""
    n = len(state)
    moves = ~held
    lever = (discs.share * discs.radii) ** 2

    def rate(time: float, y: Array) -> Array:
        s = y.reshape(n, 6)
        braking = _plane_friction(discs, s) / np.maximum(_speed(discs, s), 0.1 * STILL)
        out = np.zeros((n, 6))
        out[:, :3] = s[:, 3:]
        out[:, 3:5] = (_forces(discs, time, s) - braking[:, None] * s[:, 3:5]) / discs.masses[:, None]
        out[:, 5] = -braking * lever * s[:, 5] / discs.inertias
        out[held] = 0.0
        return out.ravel()

    events: list[Callable[[float, Array], float]] = []
    pairs: list[tuple[int, int] | None] = []

    def add(event: Callable[[float, Array], float], direction: float, pair: tuple[int, int] | None) -> None:
        event.terminal, event.direction = True, direction  # type: ignore[attr-defined]
        events.append(event)
        pairs.append(pair)

    for a, b in combinations(range(n), 2):
        if moves[a] or moves[b]:
            reach = discs.radii[a] + discs.radii[b]
            add(
                lambda time, y, a=a, b=b, reach=reach: float(
                    np.hypot(y[6 * a] - y[6 * b], y[6 * a + 1] - y[6 * b + 1]) - reach
                ),
                -1.0,
                (a, b),
            )
    for a in np.flatnonzero(moves):
        for k, (nx, ny, offset) in enumerate(discs.walls):
            add(
                lambda time, y, a=a, nx=nx, ny=ny, d=offset: float(
                    nx * y[6 * a] + ny * y[6 * a + 1] - d - discs.radii[a]
                ),
                -1.0,
                (int(a), -1 - k),
            )
        add(lambda time, y, a=a: float(_speed(discs, y.reshape(n, 6))[a]) - STILL, -1.0, None)
        for p in discs.patches:
            inside = (state[a, 0] - p.x) ** 2 + (state[a, 1] - p.y) ** 2 < p.radius**2
            add(
                lambda time, y, a=a, p=p: float((y[6 * a] - p.x) ** 2 + (y[6 * a + 1] - p.y) ** 2 - p.radius**2),
                1.0 if inside else -1.0,
                None,
            )
    end = float(times[-1])
    if not moves.any():
        return end, state, np.repeat(state[None], len(times), axis=0), None
    until = end
    while True:
        found = solve_ivp(
            rate,
            (t, until),
            state.ravel(),
            method="DOP853",
            rtol=tolerance,
            atol=tolerance,
            events=events,
            dense_output=True,
            first_step=min(1e-5, until - t) if until > t else None,
            max_step=0.03,
        )
        overlap = _first_overlap(discs, found.sol, t, float(found.t[-1]))
        if overlap is None:
            break
        until = overlap  # a step ended behind it: one that ends there sees that they have met
    met = [i for i, e in enumerate(found.t_events) if len(e)] if found.status == 1 else []
    if not met and until < end:
        raise UnusableCase("the discs graze by less than the integration tells")
    if not met:
        return end, found.y[:, -1].reshape(n, 6), found.sol(times).T.reshape(-1, n, 6), None
    which = met[0]
    stop = float(found.t_events[which][0])
    after = np.array(found.y_events[which][0]).reshape(n, 6)
    inside_times = times[times < stop]
    samples = found.sol(inside_times).T.reshape(-1, n, 6) if len(inside_times) else np.empty((0, n, 6))
    if pairs[which] is None:  # step over an edge on the side that the disc is heading for
        after[:, :2] += 1e-10 * np.sign(after[:, 3:5])
    return stop, after, samples, pairs[which]


def _first_overlap(discs: Discs, path: Callable[[Array], Array], begin: float, end: float) -> float | None:
    """When first, before the end, the centres of two discs are nearest to each other while the discs overlap.

    A graze shorter than a step of the integration leaves its events as they were, and is seen by nothing else.
    """
    times = np.linspace(begin, end, max(int(np.ceil((end - begin) / LOOK)), 1) + 1)
    states = path(times).T.reshape(len(times), -1, 6)
    first: float | None = None
    for a, b in combinations(range(states.shape[1]), 2):
        reach = discs.radii[a] + discs.radii[b]

        def parting(time: float, a: int = a, b: int = b) -> float:
            s = path(np.array([time])).reshape(-1, 6)
            return float((s[b, :2] - s[a, :2]) @ (s[b, 3:5] - s[a, 3:5]))

        between = states[:, b, :2] - states[:, a, :2]
        rates = np.sum(between * (states[:, b, 3:5] - states[:, a, 3:5]), axis=1)
        near = np.minimum(*np.linalg.norm([between[:-1], between[1:]], axis=-1)) < reach + NEAR
        for k in np.flatnonzero((rates[:-1] < 0.0) & (rates[1:] > 0.0) & near):
            if first is not None and times[k] >= first:
                break
            nearest = float(brentq(parting, times[k], times[k + 1], xtol=1e-12))
            s = path(np.array([nearest])).reshape(-1, 6)
            if np.linalg.norm(s[b, :2] - s[a, :2]) < reach - GRAZE and nearest < end:
                first = nearest
                break
    return first


def _meet(discs: Discs, state: Array, a: int, b: int) -> Array:
    """The state after an impact of two discs, or of disc a and wall -1 - b."""
    s = state.copy()
    if b >= 0:
        normal = (s[b, :2] - s[a, :2]) / np.linalg.norm(s[b, :2] - s[a, :2])
        others, mu = 1.0 / discs.masses[b], 0.5 * (discs.frictions[a] + discs.frictions[b])
        turned = discs.radii[b] ** 2 / discs.inertias[b]
        rim, speed = discs.radii[b] * s[b, 5], s[b, 3:5]
    else:
        normal = -np.array(discs.walls[-1 - b][:2])
        others, mu, turned, rim, speed = 0.0, discs.frictions[a], 0.0, 0.0, np.zeros(2)
    across = np.array([-normal[1], normal[0]])
    apart = float((speed - s[a, 3:5]) @ normal)
    if apart >= 0.0:
        return s
    # Surface speeds along `across`: a's point at +R normal moves with omega R, b's at -R normal with -omega R.
    slip = float((speed - s[a, 3:5]) @ across) - rim - discs.radii[a] * s[a, 5]
    push = -(1.0 + discs.restitution) * apart / (1.0 / discs.masses[a] + others)
    sticking = 1.0 / (1.0 / discs.masses[a] + others + discs.radii[a] ** 2 / discs.inertias[a] + turned)
    drag = float(np.clip(-sticking * slip, -mu * push, mu * push))
    impulse = push * normal + drag * across  # on b
    s[a, 3:5] -= impulse / discs.masses[a]
    s[a, 5] -= discs.radii[a] * drag / discs.inertias[a]
    if b >= 0:
        s[b, 3:5] += impulse / discs.masses[b]
        s[b, 5] -= discs.radii[b] * drag / discs.inertias[b]
    return s
