"""Say where the gap is: squared residuals over those of noise, by run, object, time, phase, place, speed and axis.

A fit of the initial state spreads what is wrong late in a run over all of it. Recursive residuals (Brown, Durbin and
Evans 1975, J. R. Stat. Soc. B 37, 149) are the errors of forecasting each instant from those before it alone: white,
with unit variance, for as long as the model holds; they show when a run begins to differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.readout import CHANNELS, owner
from polyworld.gap.fitting import Fitted
from polyworld.solver.rollout import simulator
from polyworld.trajectory import Event
from polyworld.trajectory.events import REST_SPEED, REST_SPIN
from polyworld.world import World
from polyworld.world.shapes import Sphere

Array = NDArray[np.float64]
Texts = NDArray[np.str_]

AFTER = 0.1  # [s] that count as just after a collision
LASTING = 0.05  # [s] from which on a contact is more than a collision
GRIP = 0.05  # slip over speed, below which a ball rolls


@dataclass(frozen=True)
class Motion:
    """One recorded name in one run: positions (T, 3), speeds (T,) and phases (T,), as the fitted world has them."""

    positions: Array
    speeds: Array
    phases: Texts


def motions(fitted: Fitted, index: int) -> dict[str, Motion]:
    """Return how the fitted world moves in one run, by recorded name."""
    run, block = fitted.ground.recording.runs[index], fitted.problem.runs[index][0]
    values = block.overrides(fitted.values[None], fitted.of_states()[index][None])
    times = run.times - run.times[0] + run.lead
    rolled = simulator(block.world, times, n_worlds=1, record_events=True, threads=1)
    batch = rolled.run({p: v for p, v in values.items() if not p.startswith("observer.")} or None)
    trajectory = batch.world(0)
    rows = np.minimum(np.arange(len(times)), len(trajectory.times) - 1)  # beyond a divergence the last state stays
    found = {}
    for name in run.names:
        i = trajectory.index(owner(name))
        velocity, spin = trajectory.velocities[rows, i], trajectory.angular_velocities[rows, i]
        phases = _phases(block.world, owner(name), times, velocity, spin, batch.events[0])
        found[name] = Motion(trajectory.positions[rows, i], np.linalg.norm(velocity, axis=1), phases)
    return found


def _phases(world: World, name: str, times: Array, velocity: Array, spin: Array, events: Sequence[Event]) -> Texts:
    speed = np.linalg.norm(velocity, axis=1)
    slow = (speed < REST_SPEED) & (np.linalg.norm(spin, axis=1) < REST_SPIN)
    contacts = _contacts(name, events, float(times[-1]))
    touching = np.zeros(len(times), dtype=bool)
    for begin, end in contacts:
        if end - begin >= LASTING:
            touching |= (times >= begin) & (times <= end)
    if world.planar:  # it slides over the plane of motion
        phases = np.full(len(times), "sliding", dtype="U24")
    else:
        phases = np.where(touching, _in_contact(world, name, velocity, spin, speed), "free").astype("U24")
    for begin, _ in contacts:
        phases[(times > begin) & (times <= begin + AFTER) & ~touching] = "just after a collision"
    phases[slow & (touching | world.planar)] = "at rest"
    return phases


def _in_contact(world: World, name: str, velocity: Array, spin: Array, speed: Array) -> Texts:
    """Return whether a ball slides or rolls; any other body touches."""
    shape = getattr(world.item(name), "shape", None)
    if not isinstance(shape, Sphere):
        return np.full(len(speed), "touching", dtype="U24")
    up = -np.asarray(world.environment.gravity)
    up = up / max(float(np.linalg.norm(up)), 1e-12)
    slip = velocity - np.cross(spin, shape.radius * up)
    slip = slip - (slip @ up)[:, None] * up
    rolls = np.linalg.norm(slip, axis=1) < GRIP * np.maximum(speed, REST_SPEED)
    return np.where(rolls, "rolling", "sliding").astype("U24")


def _contacts(name: str, events: Sequence[Event], last: float) -> list[tuple[float, float]]:
    """Return begin and end [s] of every contact of an object."""
    found: list[tuple[float, float]] = []
    open_since: dict[tuple[str, ...], float] = {}
    for e in events:
        if name not in e.participants:
            continue
        if e.kind == "contact_begin":
            open_since[e.participants] = e.time
        elif e.kind == "contact_end" and e.participants in open_since:
            found.append((open_since.pop(e.participants), e.time))
    return found + [(begin, last) for begin in open_since.values()]


PRIOR = 1e3  # ordinary changes of an initial state: next to nothing is known of it before the first sample
ALARM = 5.0  # standard deviations by which the mean of a window is off once in a million windows of noise
WINDOWS = (1 / 48, 1 / 24, 1 / 12, 1 / 6)  # their lengths, as shares of a series
SHORTEST = 3  # samples of a window


@dataclass(frozen=True)
class Onset:
    """From when on [s, since the run's start] an object's motion differs, in which run, and by how many standard
    deviations the first window that shows it is off."""

    run: str
    name: str
    time: float
    strength: float

    def to_json(self) -> dict[str, object]:
        """Return the onset as plain data."""
        return {"run": self.run, "object": self.name, "time": self.time, "strength": self.strength}


def onsets(fitted: Fitted) -> tuple[Onset, ...]:
    """Return the onset of every object that shows one in a run, earliest first; shared unknowns stay as fitted."""
    found: dict[tuple[str, str], Onset] = {}
    for r, (run, readout) in enumerate(zip(fitted.ground.recording.runs, fitted.ground.readouts, strict=True)):
        one, rows, columns = fitted.slopes[r], readout.rows(), readout.columns()
        errors = recursive_residuals(one.residuals, one.states, rows, fitted.problem.runs[r][0].states.typical)
        times = run.times - run.times[0] + run.lead
        for column in np.unique(columns).tolist():
            own = columns == column
            first = _first_alarm(times[rows[own]], errors[own])
            name = run.names[column // CHANNELS]
            known = found.get((run.name, name))
            if first is not None and (known is None or first[0] < known.time):
                found[run.name, name] = Onset(run.name, name, *first)
    return tuple(sorted(found.values(), key=lambda o: (o.time, o.run, o.name)))


def recursive_residuals(residuals: Array, slopes: Array, rows: NDArray[np.int64], typical: Array) -> Array:
    """Return forecast errors (m,) of residuals (m,) in units of noise, each instant from all before it.

    slopes (m, N): by the initial state, whose ordinary changes are typical (N,). rows (m,): the instant of each.
    """
    found, n = residuals.copy(), slopes.shape[1]
    covariance, state = np.diag((PRIOR * typical) ** 2), np.zeros(n)
    for entries in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows)) + 1):
        h = slopes[entries]
        gain = covariance @ h.T
        spread = h @ gain + np.eye(len(entries))
        error = residuals[entries] - h @ state
        found[entries] = np.linalg.solve(np.linalg.cholesky(spread), error)
        k = np.linalg.solve(spread, gain.T).T
        state = state + k @ error
        shrink = np.eye(n) - k @ h
        covariance = shrink @ covariance @ shrink.T + k @ k.T  # Joseph's form stays positive
    return found


def _first_alarm(times: Array, errors: Array) -> tuple[float, float] | None:
    """Return where the earliest window begins whose mean is too far off, and how far."""
    total = np.concatenate([[0.0], np.cumsum(errors)])
    found: list[tuple[int, int, float]] = []  # end, begin, standard deviations
    for share in WINDOWS:
        length = max(round(share * len(errors)), SHORTEST)
        mean = np.abs(total[length:] - total[:-length]) / np.sqrt(length)
        over = np.flatnonzero(mean > ALARM)
        if len(over):
            found.append((int(over[0]) + length, int(over[0]), float(mean[over[0]])))
    if not found:
        return None
    _, begin, strength = min(found, key=lambda f: f[0])
    return float(times[begin]), strength


FACTORS = ("run", "object", "time", "phase", "region", "speed", "axis")
PARTS = 6  # of every run's time
CELLS = 3  # of the region along each of its two longest sides
CLEAR = 3.0  # standard errors that count as a difference
AXES = [f"{kind} {axis}" for kind in ("position", "rotation", "spin") for axis in "xyz"]


@dataclass(frozen=True)
class Level:
    """One level of a factor. ratio: mean squared residual there over that of noise, 1 where nothing is missing; error:
    its standard error in noise; share: of the whole excess over noise, 0 where there is none; samples: how many
    measured components."""

    level: str
    ratio: float
    error: float
    share: float
    samples: int


@dataclass(frozen=True)
class Localisation:
    """Where the gap is.

    ratio: mean squared residual over that of noise. noisy: up to which it counts as noise. factors: name -> levels,
    largest ratio first. onsets: earliest first.
    """

    ratio: float
    noisy: float
    factors: dict[str, tuple[Level, ...]]
    onsets: tuple[Onset, ...]

    def summary(self) -> str:
        """Describe in words where the gap is."""
        if self.ratio < self.noisy:
            return f"On the whole, residuals are those of noise (their squares {self.ratio:.2g} times noise)."
        text = f"Squared residuals are {self.ratio:.3g} times those of noise"
        contrasts = []
        for name, levels in self.factors.items():
            if len(levels) < 2:
                continue
            most, least = levels[0], levels[-1]
            if most.ratio - least.ratio > max(CLEAR * np.hypot(most.error, least.error), least.ratio):
                contrasts.append(
                    f"by {name} most at {most.level} ({most.ratio:.3g}), least at {least.level} ({least.ratio:.3g})"
                )
        text += "; " + "; ".join(contrasts) if contrasts else ", alike in all runs, objects, phases, regions and speeds"
        if self.onsets:
            first, count = self.onsets[0], len({o.run for o in self.onsets})
            text += (
                f". {count} {'run shows' if count == 1 else 'runs show'} when it begins, the earliest {first.name} "
                f"in run {first.run} at {first.time:.3g} s"
            )
        return text + "."

    def to_json(self) -> dict[str, object]:
        """Return the localisation as plain data."""
        return {
            "ratio": self.ratio,
            "factors": {name: [asdict(level) for level in levels] for name, levels in self.factors.items()},
            "onsets": [o.to_json() for o in self.onsets],
            "summary": self.summary(),
        }


def localise(fitted: Fitted) -> Localisation:
    """Share the residuals of a fit out over the factors."""
    ground = fitted.ground
    moved = [motions(fitted, r) for r in range(len(ground.recording.runs))]
    box = _box(fitted)
    speeds = np.concatenate([m.speeds for motion in moved for m in motion.values()])
    thirds = np.quantile(speeds[np.isfinite(speeds)], np.linspace(0.0, 1.0, 4))
    labels: dict[str, list[Texts]] = {name: [] for name in FACTORS}
    squares, freedom = [], []
    for r, (run, readout, motion) in enumerate(zip(ground.recording.runs, ground.readouts, moved, strict=True)):
        residuals, rows, columns = fitted.slopes[r].residuals, readout.rows(), readout.columns()
        times = run.times - run.times[0] + run.lead
        parts = np.linspace(times[0], times[-1], PARTS + 1)
        squares.append(residuals**2)
        freedom.append(np.full(len(residuals), max(1.0 - len(fitted.of_states()[r]) / len(residuals), 0.1)))
        whom = columns // CHANNELS
        pieces = [motion[name] for name in run.names]
        place = np.stack([m.positions for m in pieces], axis=1)[rows, whom]
        sides = [_binned(place[:, a], e, f"{'xyz'[a]} ", "m") for a, e in box.items()]
        labels["run"].append(np.full(len(rows), run.name))
        labels["object"].append(np.array([owner(n) for n in run.names])[whom])
        labels["time"].append(_binned(times[rows], parts, "", "s"))
        labels["phase"].append(np.stack([m.phases for m in pieces], axis=1)[rows, whom])
        labels["region"].append(np.char.add(np.char.add(sides[0], ", "), sides[1]))
        labels["speed"].append(_binned(np.stack([m.speeds for m in pieces], axis=1)[rows, whom], thirds, "", "m/s"))
        labels["axis"].append(np.array(AXES)[columns % CHANNELS])
    square, expected = np.concatenate(squares), np.concatenate(freedom)
    excess = max(float(square.sum() - expected.sum()), 0.0)
    factors = {name: _levels(np.concatenate(texts), square, expected, excess) for name, texts in labels.items()}
    ratio = float(square.sum() / expected.sum())
    return Localisation(ratio, ground.settings.near_noise**2, factors, onsets(fitted))


def _levels(texts: Texts, square: Array, expected: Array, excess: float) -> tuple[Level, ...]:
    found = []
    for text in np.unique(texts):
        here = texts == text
        s, x = float(square[here].sum()), float(expected[here].sum())
        error = max(s / x, 1.0) * float(np.sqrt(2.0 / max(x, 1.0)))
        share = max(s - x, 0.0) / excess if excess > 0.0 else 0.0
        found.append(Level(str(text), s / x, error, share, int(here.sum())))
    return tuple(sorted(found, key=lambda level: -level.ratio))


def _binned(values: Array, edges: Array, prefix: str, unit: str) -> Texts:
    """Return the interval between edges that each value (m,) lies in, in words."""
    words = np.array([f"{prefix}{low:.3g} to {high:.3g} {unit}" for low, high in pairwise(edges)])
    texts: Texts = words[np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(words) - 1)]
    return texts


def _box(fitted: Fitted) -> dict[int, Array]:
    """Return edges of cells along the two longest sides of the region that was measured, by axis."""
    places = np.concatenate([r.positions.reshape(-1, 3) for r in fitted.ground.recording.runs])
    seen = [v[np.isfinite(v)] for v in places.T]
    spans = [(float(v.min()), float(v.max())) if len(v) else (0.0, 0.0) for v in seen]
    longest = sorted(range(3), key=lambda axis: spans[axis][0] - spans[axis][1])[:2]
    return {axis: np.linspace(*spans[axis], CELLS + 1) for axis in sorted(longest)}
