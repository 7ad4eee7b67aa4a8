"""Measured motion, fitted and held out, by this engine and by the simplest textbook model of each experiment.

    python -m tests.benchmarks.peers.real_motion [--quick] [NAME ...]

Laws' coefficients are fitted on some runs; on the held-out ones they stay, and only initial states are fitted, by
either model. Of a toss the state is fitted to the flight before the first touch, and what follows is predicted; of a
dam break the start of the clock is fitted on the first half.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares, minimize_scalar

from polyworld.data.recording import Recording, Run
from polyworld.estimation.least_squares import Point
from polyworld.estimation.noise import run_noise
from polyworld.estimation.readout import CHANNELS
from polyworld.estimation.unknown import Unknown
from polyworld.gap import GapSettings
from polyworld.gap.fitting import Fitted, fit
from polyworld.gap.ground import Ground, ground_of
from polyworld.gap.hypothesis import Hypothesis
from polyworld.world import Effect, World
from polyworld.world.parameters import with_parameters
from tests import real_data
from tests.benchmarks.peers.markdown import markdown
from tests.benchmarks.peers.table import Table
from tests.polyworld.solver.fluid.scenes import Run as FluidRun
from tests.polyworld.solver.fluid.scenes import plane_world, pool

Array = NDArray[np.float64]

GRAVITY = real_data.GRAVITY
COLUMN = 0.05715  # [m] width of Martin & Moyce's column, 2.25 in
KINDS = ("cube", "cylinder", "sphere")
SCENES = ("00000", "02000", "03000", "04000", "05000", "06000")


@dataclass(frozen=True)
class Score:
    """RMS errors on the data fitted and held out, in `unit`; noise: of the data, NaN where it is not known."""

    name: str
    fitted: float
    held_out: float
    noise: float
    unit: str
    seconds: float


Case = Callable[[], list[Score]]


def tables(quick: bool) -> list[Table]:
    """Return one table: a row for each model of each set."""
    return [_table(list(CASES)[:3] if quick else list(CASES))]


def _table(names: Sequence[str]) -> Table:
    rows: list[tuple[str, ...]] = []
    for name in names:
        folder, case = CASES[name]
        if not (real_data.FOLDER / folder).exists():
            rows.append((name, f"skipped: ../shared/data/{folder} is absent", "", "", "", "", "", ""))
            continue
        rows += [_row(name, score) for score in case()]
    note = (
        "RMSE of all measured components of positions; of the dam break, of the front. Noise: of the data alone, by "
        "third differences. Seconds: CPU, to fit and judge."
    )
    columns = ("data", "model", "fitted", "held out", "unit", "fitted / noise", "held out / noise", "s")
    return Table("Measured motion against the simplest textbook models", note, columns, tuple(rows))


def _row(name: str, score: Score) -> tuple[str, ...]:
    known = np.isfinite(score.noise)
    units = [f"{x / score.noise:.1f}" if known else "" for x in (score.fitted, score.held_out)]
    return (
        name,
        score.name,
        f"{score.fitted:.3g}",
        f"{score.held_out:.3g}",
        score.unit,
        *units,
        f"{score.seconds:.1f}",
    )


# --- this engine -------------------------------------------------------------------------------


def engine(name: str, world: World, unknowns: Sequence[Unknown], fitted: Recording, held_out: Recording) -> Score:
    """Fit shared unknowns and the initial state of each run; on held-out runs initial states alone."""
    began = time.process_time()
    values, inside, noise = _fit(world, tuple(unknowns), fitted)
    found = with_parameters(world, {path: v for u, v in zip(unknowns, values, strict=True) for path in u.paths})
    _, outside, _ = _fit(found, (), held_out)
    return Score(name, inside, outside, noise, "m", time.process_time() - began)


def _fit(world: World, unknowns: tuple[Unknown, ...], recording: Recording) -> tuple[Array, float, float]:
    """Return values, RMSE [m] of positions, and the noise [m]."""
    found = _settled(world, recording, unknowns)
    return found.values, *_in_metres(found)


def _settled(world: World, recording: Recording, unknowns: tuple[Unknown, ...] = ()) -> Fitted:
    """Fit initial states, and shared unknowns if any."""
    return fit(ground_of(world, recording, GapSettings()), Hypothesis(world, unknowns), growing=True)


def _in_metres(found: Fitted, split: Sequence[float] | None = None, late: bool = False) -> tuple[float, float]:
    """Return RMSE and noise [m] of positions; split: instants up to which, or with `late` after which, they count."""
    squares, levels = [], []
    ground = found.ground
    runs = zip(ground.recording.runs, ground.readouts, found.slopes, strict=True)
    for r, (run, readout, one) in enumerate(runs):
        columns = readout.columns()
        kept = columns % CHANNELS < 3
        if split is not None:
            kept &= (run.times[readout.rows()] > split[r] + 1e-9) == late
        sigma = readout.sigma[columns[kept]]
        squares.append((one.residuals[kept] * sigma) ** 2)
        levels.append(sigma**2)
    return _root(squares), _root(levels)


def _root(parts: Sequence[Array]) -> float:
    return float(np.sqrt(np.mean(np.concatenate([np.ravel(p) for p in parts]))))


# --- textbook models ---------------------------------------------------------------------------


def textbook(
    name: str, model: Callable[[Array, Array, Run], Array], shared: Array, own: Callable[[Run], Array],
    fitted: Recording, held_out: Recording, noise: float,
) -> Score:  # fmt: skip
    """Fit a closed form: model(shared, own, run) gives positions (T, 3) of a run's only object."""
    began = time.process_time()

    def residuals(runs: Sequence[Run], common: Array, flat: Array) -> Array:
        states = np.split(flat, len(runs))
        parts = [(model(common, s, r) - r.positions[:, 0]).ravel() for s, r in zip(states, runs, strict=True)]
        every = np.concatenate(parts)
        return every[np.isfinite(every)]

    def starts(runs: Sequence[Run]) -> Array:
        return np.concatenate([own(r) for r in runs])

    runs, count = fitted.runs, len(shared)
    best = least_squares(lambda x: residuals(runs, x[:count], x[count:]), np.concatenate([shared, starts(runs)]))
    common = best.x[:count]
    other = least_squares(lambda x: residuals(held_out.runs, common, x), starts(held_out.runs))
    inside, outside = _root([best.fun**2]), _root([other.fun**2])
    return Score(name, inside, outside, noise, "m", time.process_time() - began)


def _state(run: Run) -> Array:
    """First measured place and velocity of a run, zero where nothing was measured."""
    places = np.nan_to_num(run.positions[:, 0])
    last = min(4, len(places) - 1)
    return np.concatenate([places[0], (places[last] - places[0]) / (run.times[last] - run.times[0])])


def _free_fall(_shared: Array, own: Array, run: Run) -> Array:
    t = (run.times - run.times[0])[:, None]
    return own[:3] + own[3:] * t - np.array([0.0, 0.0, 0.5 * GRAVITY]) * t**2


def _slide(shared: Array, own: Array, run: Run) -> Array:
    """Constant deceleration on a straight line, one for each kind of object."""
    t = (run.times - run.times[0])[:, None]
    speed = max(float(np.hypot(own[3], own[4])), 1e-12)
    slowing = max(float(shared[KINDS.index(run.names[0])]), 0.0)
    passed = np.minimum(t, speed / max(slowing, 1e-12))
    place = own[:3] + own[3:] / speed * (speed * passed - 0.5 * slowing * passed**2)
    place[:, 2] = own[2]
    return place


def _pendulum(shared: Array, own: Array, run: Run) -> Array:
    """theta'' = -(g / L) sin theta - 2 b theta': shared L [m] and b [1/s], own angle and rate."""
    length, damping = shared
    solution = solve_ivp(
        lambda _, y: [y[1], -GRAVITY / length * np.sin(y[0]) - 2.0 * damping * y[1]],
        (run.times[0], run.times[-1]),
        own,
        t_eval=run.times,
        rtol=1e-8,
        atol=1e-9,
    )
    angle = solution.y[0]
    arm = float(np.nanmedian(np.hypot(run.positions[:, 0, 0], run.positions[:, 0, 2])))
    return -arm * np.stack([np.sin(angle), np.full(len(angle), np.nan), np.cos(angle)], axis=-1)


def _swing(run: Run) -> Array:
    angle = np.unwrap(np.arctan2(-run.positions[:, 0, 0], -run.positions[:, 0, 2]))
    return np.array([angle[0], (angle[4] - angle[0]) / (run.times[4] - run.times[0])])


# --- cases -------------------------------------------------------------------------------------


def drops(ball: str) -> list[Score]:
    """First drop fitted, second held out."""
    world, recording = real_data.ball_drop((ball,))
    fitted, held_out = recording.select((f"{ball}-1",)), recording.select((f"{ball}-2",))
    air = Effect(name="air", kind="quadratic_drag", parameters={"coefficient": 0.0})
    drag = Unknown("drag", ("effects.air.coefficient",), "kg/m", 1e-3, 0.0, 0.1, 1e-3)
    own = engine("quadratic drag, fitted", world.model_copy(update={"effects": (air,)}), [drag], fitted, held_out)
    plain = textbook("free fall", _free_fall, np.zeros(0), _state, fitted, held_out, own.noise)
    return [own, plain]


def swings() -> list[Score]:
    """Stretches of 1.2 s of large, middle and small swings; the held-out ones lie between them and after."""
    world, fitted = real_data.pendulum_swings((1.0, 10.0, 24.0), 1.2, every=2)
    _, held_out = real_data.pendulum_swings((5.0, 17.0, 35.0), 1.2, every=2)
    air = Effect(name="air", kind="quadratic_drag", parameters={"coefficient": 0.0})
    unknowns = [
        Unknown("drag", ("effects.air.coefficient",), "kg/m", 0.01, 0.0, 1.0, 0.01),
        Unknown("friction", ("joints.hinge.friction",), "N m", 0.003, 0.0, 0.1, 0.003),
    ]
    own = engine("dry hinge and drag", world.model_copy(update={"effects": (air,)}), unknowns, fitted, held_out)
    arm = -float(world.joints[0].anchor[2]) + float(np.linalg.norm(world.objects[0].position))
    damped = textbook("exponential damping", _pendulum, np.array([arm, 0.05]), _swing, fitted, held_out, own.noise)
    undamped = textbook(
        "undamped", lambda s, o, r: _pendulum(np.array([s[0], 0.0]), o, r), np.array([arm]), _swing, fitted, held_out,
        own.noise,
    )  # fmt: skip
    return [own, damped, undamped]


def slides() -> list[Score]:
    """Every third stretch between collisions of CLEVRER's objects is fitted, every third other one held out."""
    world, recording = real_data.clevrer_slides(SCENES)
    names = [run.name for run in recording.runs]
    fitted, held_out = recording.select(tuple(names[::3])), recording.select(tuple(names[1::3]))
    air = Effect(name="air", kind="quadratic_damping", parameters={"rate": 0.0})
    sliding = tuple(f"objects.{o.name}.friction" for o in world.objects if o.name != "sphere")
    damping = tuple(f"objects.{o.name}.linear_damping" for o in world.objects)
    unknowns = [
        Unknown("friction", sliding, "1", 0.03, 0.0, 0.5, 0.01),
        Unknown("damping", damping, "1/s", 0.02, 0.0, 1.0, 0.02),
        Unknown("air", ("effects.air.rate",), "1/m", 0.02, 0.0, 1.0, 0.02),
    ]
    own = engine("friction, damping, drag", world.model_copy(update={"effects": (air,)}), unknowns, fitted, held_out)
    plain = textbook("constant deceleration", _slide, np.full(len(KINDS), 0.3), _state, fitted, held_out, own.noise)
    return [own, plain]


def tosses() -> list[Score]:
    """State fitted to the flight of a cube, the rest of the toss, bounces and rest, predicted."""
    numbers = tuple(range(0, 60, 5))
    free, flights = real_data.cube_flight(numbers)
    world, whole = real_data.cube_toss(numbers)
    began = time.process_time()
    flown = _settled(free, flights)
    ground = Ground(world, whole, GapSettings(), run_noise(whole.runs))
    problem = ground.problem(Hypothesis(world))
    at = Point(np.zeros(0), flown.point.states)
    thrown = Fitted(Hypothesis(world), ground, problem, at, at, problem.normal(at, 1.0), 1.0, 0.0)
    ends = [flight.times[-1] for flight in flights.runs]
    (inside, noise), (outside, _) = (_in_metres(thrown, ends, late) for late in (False, True))
    own = Score("cube, published coefficients", inside, outside, noise, "m", time.process_time() - began)
    return [own, _bouncing(world, whole, flights, own.noise)]


def _bouncing(world: World, whole: Recording, flights: Recording, noise: float) -> Score:
    """Ballistic flight of a point that bounces with the published restitution half an edge above the table."""
    began = time.process_time()
    restitution = world.objects[0].restitution
    floor = world.statics[0].position[2] + real_data.CUBE_UNIT
    inside, outside = [], []
    for run, flight in zip(whole.runs, flights.runs, strict=True):
        t = flight.times - flight.times[0]
        line = np.vander(t, 2, increasing=True)
        level = np.linalg.lstsq(line, flight.positions[:, 0, :2])[0]
        height, speed = np.linalg.lstsq(line, flight.positions[:, 0, 2] + 0.5 * GRAVITY * t**2)[0]
        times = run.times - run.times[0]
        places = np.column_stack([np.vander(times, 2, increasing=True) @ level, np.zeros(len(times))])
        places[:, 2] = [_bounced(height, speed, floor, restitution, float(x)) for x in times]
        squares = (places - run.positions[:, 0]) ** 2
        inside.append(squares[: len(t)])
        outside.append(squares[len(t) :])
    seconds = time.process_time() - began
    return Score("ballistic point, restitution", _root(inside), _root(outside), noise, "m", seconds)


def _bounced(height: float, speed: float, floor: float, restitution: float, left: float) -> float:
    """Height after `left` [s] of a point that starts above a floor and bounces on it until it rests."""
    while True:
        until = (speed + np.sqrt(max(speed**2 + 2.0 * GRAVITY * (height - floor), 0.0))) / GRAVITY
        if left <= until:
            return height + speed * left - 0.5 * GRAVITY * left**2
        left, height, speed = left - until, floor, restitution * (GRAVITY * until - speed)
        if speed < 0.01:  # m/s
            return floor


def dam_break() -> list[Score]:
    """Front of a column twice as high as wide; the clock's start is fitted on the first half of the points."""
    path = real_data.FOLDER / "dam_break" / "martin_moyce_1952_a2.25in.csv"
    measured_time, measured = np.loadtxt(path, delimiter=",", skiprows=2).T
    scale = np.sqrt(2.0 * GRAVITY / COLUMN)
    began = time.process_time()
    cell = COLUMN / 8
    water = pool("water", (0, 0), (COLUMN, 2 * COLUMN), slip=False)
    run = FluidRun(plane_world(water, size=(16 * COLUMN, 2.5 * COLUMN), cell=cell))
    times, fronts = [0.0], [1.0]
    for moment in run.advance(0.53):
        times.append(moment * scale)
        fronts.append((run.present()[0][:, 0].max() + cell / 4) / COLUMN)
    computed = partial(np.interp, xp=times, fp=fronts)
    own = _front("particles and grid", computed, measured_time, measured, time.process_time() - began)
    # Ritter 1892: the tip of a column of height h runs at 2 sqrt(g h) on a dry bed.
    plain = _front("shallow water (Ritter)", lambda t: 1.0 + 2.0 * np.maximum(t, 0.0), measured_time, measured, 0.0)
    return [own, plain]


def _front(name: str, front: Callable[[Array], Array], at: Array, measured: Array, seconds: float) -> Score:
    half = len(at) // 2

    def rmse(offset: float, part: slice) -> float:
        return _root([(front(at[part] - offset) - measured[part]) ** 2])

    offset = minimize_scalar(rmse, args=(slice(0, half),), bounds=(-1.0, 1.0), method="bounded").x
    inside, outside = rmse(offset, slice(0, half)), rmse(offset, slice(half, None))
    return Score(name, inside, outside, float("nan"), "widths", seconds)


CASES: dict[str, tuple[str, Case]] = {
    **{ball: ("ball_drop", partial(drops, ball)) for ball in real_data.BALLS},
    "pendulum": ("pendulum", swings),
    "clevrer": ("clevrer", slides),
    "cube_toss": ("cube_toss", tosses),
    "dam_break": ("dam_break", dam_break),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="three sets only")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(CASES)}; default: all")
    options = parser.parse_args()
    wrong = sorted(set(options.names) - set(CASES))
    if wrong:
        parser.error(f"unknown sets {wrong}; choices: {list(CASES)}")
    found = [_table(options.names)] if options.names else tables(options.quick)
    print("\n\n".join(markdown(table) for table in found))


if __name__ == "__main__":
    main()
