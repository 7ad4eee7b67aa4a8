"""Roll hundreds of random worlds of all materials out: none may crash, go wrong in silence, or take the others along.

    python -m tests.benchmarks.fuzz.worlds [--count 300] [--seed 0] [--only SEED] [--kind NAME] [--processes 2]

Prints outcomes by kind, and every failure with its seed; `--only SEED` runs one again. Ends with status 1 after a
failure. A world diverges where that is stated, is refused where the reason names what to do, and fails where it
crashes, has numbers that are not finite, more energy than was available, a variant in a batch that differs from the
same world alone, or where it outlasts SECONDS.
"""

from __future__ import annotations

import argparse
import faulthandler
import threading
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from polyworld.core.interruption import Interrupted, Interruption
from polyworld.edits.interventions import Intervention, branch
from polyworld.executors import Failure, LocalExecutor
from polyworld.solver.rollout import rollout, sampled_times, simulator
from polyworld.trajectory import Trajectory
from polyworld.world import World
from polyworld.world.parameters import parameter_paths, read_parameter, with_parameters
from tests.benchmarks.fuzz.checks import energy_excess, not_finite
from tests.benchmarks.fuzz.scenes import KINDS, Draw, Fuzz, fuzz

SECONDS = 30.0  # after which a world is stopped
GRACE = 10.0  # [s] more, after which its process is ended
STARTING = 90.0  # [s] for the first world of a process, which may compile kernels
VARIANTS = 3
WARM: set[str] = set()  # kinds whose kernels this process has
SPECIFIC = 30  # characters of a reason that says something
EDITS: TypeAdapter[Intervention] = TypeAdapter(Intervention)
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Outcome:
    """What became of one world: completed, another stated status, refused, or FAILED."""

    seed: int
    kind: str
    outcome: str
    detail: str = ""
    seconds: float = 0.0


class WrongError(Exception):
    """Something that must not be."""


def main() -> None:
    """Run the worlds and print what became of them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--count", type=int, default=320, help="how many worlds")
    parser.add_argument("--seed", type=int, default=0, help="first seed; each world is the function of its seed alone")
    parser.add_argument("--only", type=int, help="this seed alone, in this process")
    parser.add_argument("--kind", choices=list(KINDS), help="worlds of one kind alone")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    if options.only is not None:
        found = [run(options.only, SECONDS)]
    else:
        seeds = range(options.seed, options.seed + options.count)
        wanted = [s for s in seeds if options.kind is None or fuzz_kind(s) == options.kind]
        found = _in_processes(wanted, options.processes)
    print(table(found))
    if any(o.outcome == "FAILED" for o in found):
        raise SystemExit(1)


def fuzz_kind(seed: int) -> str:
    """Return the kind of world of a seed."""
    return list(KINDS)[seed % len(KINDS)]


def run(seed: int, limit: float) -> Outcome:
    """Make the world of a seed, roll it out and check it; stop it after `limit` [s]."""
    began = time.perf_counter()
    kind = fuzz_kind(seed)
    try:
        with stopped_after(limit):
            _, made = fuzz(seed)
            outcome, detail = examine(made, Draw(seed + 1_000_003))
    except Interrupted:
        outcome, detail = "FAILED", f"not done after {limit:g} s"
    except WrongError as error:
        outcome, detail = "FAILED", str(error)
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{place.filename.rsplit('/', 2)[-1]}:{place.lineno}"
        outcome, detail = "FAILED", f"{type(error).__name__} at {where}: {error}"
    return Outcome(seed, kind, outcome, detail, time.perf_counter() - began)


def examine(made: Fuzz, draw: Draw) -> tuple[str, str]:
    """Return the outcome of a world, and a word on it; raises WrongError."""
    try:
        world = World.model_validate(made.parts)
        world = branch(world, [EDITS.validate_python(edit) for edit in made.edits])
    except ValidationError as error:
        return _refused("; ".join(str(e["msg"]) for e in error.errors()))
    except ValueError as error:
        return _refused(str(error))
    if not world.moving_names:
        return "refused", "nothing is left in it"
    if made.overrides:
        return _batch(world, made, draw)
    try:
        result = rollout(world, made.horizon, sample_interval=made.horizon / 20.0)
    except ValueError as error:
        return _refused(str(error))
    if result.status == "completed":
        check(world, result.trajectory, made)
    return result.status, f"{result.diverged_object} at {result.diverged_time}" if result.diverged_time else ""


def check(world: World, trajectory: Trajectory, made: Fuzz) -> None:
    """Raise WrongError where a completed trajectory cannot be true."""
    wrong = not_finite(world, trajectory)
    if wrong is not None:
        raise WrongError(f"completed, but {wrong} are not finite")
    excess = energy_excess(world, trajectory, overlaps=made.overlaps)
    if not excess <= 1.0:
        fastest = float(np.nanmax(np.linalg.norm(trajectory.velocities, axis=-1)))
        raise WrongError(f"completed with {excess:.3g} times the energy there can be; up to {fastest:.3g} m/s")


def _refused(reason: str) -> tuple[str, str]:
    if len(reason) < SPECIFIC:
        raise WrongError(f"refused without a reason: {reason!r}")
    return "refused", reason


def _batch(world: World, made: Fuzz, draw: Draw) -> tuple[str, str]:
    """Run variants together and one by one: equal to the bit, whatever becomes of one of them."""
    values = _overrides(world, draw)
    members = []
    try:
        members = [with_parameters(world, {path: float(v[i]) for path, v in values.items()}) for i in range(VARIANTS)]
    except ValueError as error:
        return _refused(str(error))
    times = sampled_times(world, made.horizon, made.horizon / 20.0)
    alone, errors = [], []
    for member in members:
        try:
            alone.append(simulator(member, times, record_events=True, threads=1).run())
        except (ValueError, RuntimeError) as error:
            alone.append(None)
            errors.append(error)
    try:
        batch = simulator(world, times, n_worlds=VARIANTS, record_events=True, threads=1).run(values)
    except (ValueError, RuntimeError) as error:
        if len(errors) == VARIANTS and isinstance(error, ValueError):
            return _refused(str(error))
        raise WrongError(f"a batch was lost, {VARIANTS - len(errors)} of {VARIANTS} run alone: {error}") from error
    outcomes = Counter[str]()
    for i, single in enumerate(alone):
        if single is None:
            raise WrongError(f"variant {i} runs in the batch and not alone: {errors[0]}")
        for name in ("positions", "orientations", "velocities", "angular_velocities", "diverged"):
            if not np.array_equal(getattr(batch, name)[i], getattr(single, name)[0], equal_nan=True):
                raise WrongError(f"{name} of variant {i} of {list(values)} differ from those of the world alone")
        if batch.events[i] != single.events[0]:
            raise WrongError(f"events of variant {i} of {list(values)} differ from those of the world alone")
        if batch.diverged[i]:
            outcomes["diverged"] += 1
            continue
        check(members[i], batch.world(i), made)
    return ("diverged" if outcomes["diverged"] == VARIANTS else "completed"), f"{outcomes['diverged']} diverged"


def _overrides(world: World, draw: Draw) -> dict[str, Array]:
    """Values (VARIANTS,) of some parameters; in a fifth of the worlds the last variant is thrown very hard."""
    fixed = ("position", "rotation", "shift", "anchor", "motion_plane", "time.", "other_anchor", "statics.")
    paths = [p for p in parameter_paths(world) if not any(word in p for word in fixed)]
    chosen = sorted({str(draw.one_of(*paths)) for _ in range(4)})
    values = {}
    for path in chosen:
        spec, value = parameter_paths(world)[path], read_parameter(world, path)
        if value is None:
            continue
        factors = draw.rng.uniform(0.8, 1.25, VARIANTS)
        values[path] = np.clip(value * factors, spec.lower, spec.upper)
    if draw.chance(0.2):
        path = f"objects.{world.moving_names[0]}.velocity.x"
        if path in parameter_paths(world):
            values[path] = np.array([0.0, 0.1, draw.scale(100.0, 1e4)])
    return values


@contextmanager
def stopped_after(seconds: float) -> Iterator[None]:
    """Interrupt what the context computes after some time."""
    interruption = Interruption()
    timer = threading.Timer(seconds, interruption.request)
    timer.daemon = True
    timer.start()
    try:
        with interruption.active():
            yield
    finally:
        timer.cancel()


def run_alone(seed: int) -> Outcome:
    """As `run`, in a worker: the first worlds of one compile kernels, and a world that hangs ends its process."""
    limit = STARTING - GRACE
    faulthandler.dump_traceback_later(limit + GRACE, exit=True)
    try:
        outcome = run(seed, limit if fuzz_kind(seed) not in WARM else SECONDS)
    finally:
        faulthandler.cancel_dump_traceback_later()
    WARM.add(outcome.kind)
    return outcome


def _in_processes(seeds: list[int], processes: int) -> list[Outcome]:
    """Run seeds in processes of their own, so that one that dies or hangs loses one world only."""
    found = []
    with LocalExecutor(processes) as executor:
        for key, result in executor.run(run_alone, {str(seed): seed for seed in seeds}):
            if isinstance(result, Failure):
                result = Outcome(int(key), fuzz_kind(int(key)), "FAILED", result.error)
            found.append(result)
            if result.outcome == "FAILED":
                print(f"seed {result.seed} ({result.kind}): {result.detail}", flush=True)
    return found


def table(found: list[Outcome]) -> str:
    """Outcomes by kind, and every failure."""
    names = sorted({o.outcome for o in found})
    lines = [f"{'kind':<16}{'worlds':>8}" + "".join(f"{n:>12}" for n in names) + f"{'median s':>10}{'most s':>8}"]
    for kind in [*KINDS, "all"]:
        own = [o for o in found if kind in (o.kind, "all")]
        if own:
            counts = "".join(f"{sum(o.outcome == n for o in own):>12}" for n in names)
            seconds = [o.seconds for o in own]
            lines.append(f"{kind:<16}{len(own):>8}{counts}{np.median(seconds):>10.2f}{max(seconds):>8.1f}")
    for outcome in sorted(found, key=lambda o: (o.outcome, o.seed)):
        if outcome.outcome != "completed":
            lines.append(f"{outcome.outcome:<10} {outcome.seed:>6} {outcome.kind:<14} {outcome.detail[:160]}")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
