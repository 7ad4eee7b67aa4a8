"""Cases with known answers, the same for every engine: slide, creep, bounce, momentum and energy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from tests.benchmarks.peers.engine import Engine, UnsupportedError
from tests.benchmarks.peers.measures import energy, energy_gain, momentum_drift
from tests.benchmarks.peers.scenes import BALL, GRAVITY, Body, Motion, Scene, Vector
from tests.benchmarks.peers.table import Table

CUBE = (BALL, BALL, BALL)
# Three balls and three cubes in free space that run into each other [m, m/s].
CLOUD: tuple[tuple[Vector, Vector], ...] = (
    ((-1.0, 0.02, 0.1), (1.0, 0.0, 0.0)),
    ((1.0, 0.1, 0.1), (-1.0, 0.0, 0.0)),
    ((0.0, -1.0, 0.1), (0.0, 1.0, 0.0)),
    ((0.05, 1.0, 0.1), (0.0, -0.9, 0.0)),
    ((-0.8, -0.7, 0.1), (0.8, 0.8, 0.0)),
    ((0.8, 0.9, 0.1), (-0.7, -0.8, 0.0)),
)


def _run(engine: Engine, scene: Scene, interval: float = 0.02) -> Motion:
    run = engine.prepare(scene, 1, interval, 1)
    run.run()
    return run.motion()


def slide_length(engine: Engine) -> float:
    """Return how far a cube slides with 2 m/s and mu = 0.2 [m]; exact v^2 / 2 mu g."""
    scene = Scene((Body("box", CUBE, (0, 0, BALL), (2, 0, 0)),), 2.0, friction=0.2)
    return float(_run(engine, scene).positions[-1, 0, 0])


def creep(engine: Engine) -> float:
    """Return how far a cube at 0.9 of the critical slope, mu = 0.5, moves in 2 s [m]; exact 0."""
    angle = math.atan(0.45)
    down = (GRAVITY * math.sin(angle), 0.0, -GRAVITY * math.cos(angle))
    x = _run(engine, Scene((Body("box", CUBE, (0, 0, BALL)),), 2.0, friction=0.5, gravity=down)).positions
    return float(np.linalg.norm(x[-1, 0] - x[0, 0]))


def apex(engine: Engine, substep: float) -> float:
    """Return the height of the first rebound from 1 m with e = 0.8 [m]; exact 0.64."""
    ball = Body("sphere", (BALL,), (0, 0, 1.0 + BALL))
    scene = Scene((ball,), 1.1, restitution=0.8, upright=True, substep=substep)
    motion = _run(engine, scene, 2 * substep)
    return float((motion.positions[motion.times > 0.55, 0, 2] - BALL).max())


def _cloud(engine: Engine) -> tuple[float, float]:
    bodies = tuple(
        Body("sphere" if k % 2 else "box", (BALL,) if k % 2 else CUBE, x, v) for k, (x, v) in enumerate(CLOUD)
    )
    scene = Scene(bodies, 3.0, restitution=0.5, gravity=(0, 0, 0), floor=False)
    motion = _run(engine, scene)
    return momentum_drift(motion), energy_gain(scene, motion)


def tumbling(engine: Engine) -> float:
    """Return the largest change of energy of a free box that spins about its middle axis for 10 s [1]; exact 0."""
    box = Body("box", (0.05, 0.1, 0.15), (0, 0, 0), spin=(0.01, 5.0, 0.01))
    scene = Scene((box,), 10.0, gravity=(0, 0, 0), floor=False)
    values = energy(scene, _run(engine, scene))
    return float(np.abs(values / values[0] - 1).max())


COLUMNS = (
    "engine",
    "slide [m]",
    "creep [mm]",
    "apex, 2 ms [m]",
    "apex, 5 ms [m]",
    "momentum drift",
    "energy gain",
    "energy of a tumbling box",
)


def row(engine: Engine) -> tuple[str, ...]:
    """Return an engine's answers as text, a failure by its kind."""

    def tried(name: str) -> str:
        try:
            return measures[name]()
        except UnsupportedError as error:
            return str(error)
        except Exception as error:  # a peer that fails is a finding, not the end of the comparison
            return f"failed: {type(error).__name__}"

    planar = bool(getattr(engine, "planar", False))
    cloud: list[tuple[float, float]] = []

    def momentum() -> str:
        cloud.append(_cloud(engine))
        return f"{cloud[0][0]:.1e}"

    measures: dict[str, Callable[[], str]] = {
        "slide": lambda: f"{slide_length(engine):.4f}",
        "creep": lambda: f"{1e3 * creep(engine):.3g}",
        "apex2": lambda: f"{apex(engine, 0.002):.4f}",
        "apex5": lambda: f"{apex(engine, 0.005):.4f}",
        "momentum": momentum,
        "gain": lambda: f"{cloud[0][1]:.1e}" if cloud else "-",
        "tumbling": lambda: "-" if planar else f"{tumbling(engine):.1e}",
    }
    return (engine.name, *(tried(name) for name in measures))


def table(engines: Sequence[Engine]) -> Table:
    """Return the answers of all engines under the exact ones."""
    exact = ("exact", f"{4 / (2 * 0.2 * GRAVITY):.4f}", "0", "0.6400", "0.6400", "0", "0", "0")
    return Table(
        "Accuracy on cases with known answers, 2 ms",
        "slide: cube at 2 m/s, mu 0.2; creep: cube for 2 s at 0.9 of the critical slope; apex: ball from 1 m, e 0.8; "
        "momentum drift and energy gain (largest rise above the least so far): six colliding bodies in free space; "
        "last: a box about its middle axis, 10 s.",
        COLUMNS,
        (exact, *(row(engine) for engine in engines)),
    )
