"""How time and memory grow with bodies, particles, worlds and the horizon.

Exponents are slopes of log time over log size, by least squares on the upper half of the sizes: 1 is linear.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from polyworld.solver.rollout import simulator
from polyworld.world import World
from polyworld.world.representations.fluid import Fluid, FluidGrid, FluidVolume
from polyworld.world.shapes import Box
from tests.benchmarks.peers import progress
from tests.benchmarks.peers.memory import peak_megabytes
from tests.benchmarks.peers.polyworld_engine import world_of
from tests.benchmarks.peers.scenes import BALL, Body, Scene, pile, six
from tests.benchmarks.peers.table import Table

FLUID_STEP = 0.004  # seconds of fluid that are simulated


@dataclass(frozen=True)
class Point:
    """Seconds to prepare and to run something of a size, and the memory that both took [MB]."""

    size: int
    prepare: float
    run: float
    megabytes: float


@dataclass(frozen=True)
class Series:
    """What grows, in what, and its points."""

    name: str
    unit: str
    points: tuple[Point, ...]


def exponent(sizes: Sequence[float], values: Sequence[float]) -> float:
    """Return the slope of log value over log size, by least squares on the upper half of the sizes."""
    upper = max(2, math.ceil(len(sizes) / 2))
    if len(sizes) < 2 or min(values[-upper:]) <= 0:
        return float("nan")
    slope, _ = np.polyfit(np.log(sizes[-upper:]), np.log(values[-upper:]), 1)
    return float(slope)


def _measured(size: int, prepare: Callable[[], Callable[[], object]]) -> Point:
    """Prepare and run twice: the second times count, since the first may compile kernels."""
    progress.show(f"growth: size {size}")
    prepare()()
    taken = [0.0, 0.0]

    def both() -> None:
        began = time.process_time()
        run = prepare()
        ready = time.process_time()
        run()
        taken[:] = ready - began, time.process_time() - ready

    megabytes = peak_megabytes(both)
    return Point(size, taken[0], taken[1], megabytes)


def _run_of(world: World, duration: float, worlds: int = 1) -> Callable[[], object]:
    times = np.linspace(0.0, duration, 6)
    return simulator(world, times, n_worlds=worlds, threads=1).run


def spread(count: int) -> Scene:
    """Balls that roll on a floor too far apart to meet."""
    wide = math.ceil(math.sqrt(count))
    bodies = tuple(
        Body("sphere", (BALL,), (float(k % wide), float(k // wide), BALL), (0.5, 0.0, 0.0)) for k in range(count)
    )
    return Scene(bodies, 0.2)


def bodies(sizes: Sequence[int]) -> Iterator[Series]:
    """Yield what bodies cost: apart, and in piles, in the plane and in space."""
    for planar in (True, False):
        where = "plane" if planar else "space"
        points = tuple(_measured(n, lambda n=n, p=planar: _run_of(world_of(spread(n), planar=p), 0.2)) for n in sizes)  # type: ignore[misc]
        yield Series(f"bodies apart, {where}", "bodies", points)
    piles = [n for n in sizes if n <= 128]
    for planar in (True, False):
        where = "plane" if planar else "space"

        def piled(n: int, planar: bool = planar) -> Callable[[], object]:
            return _run_of(world_of(pile(n, 0.0, upright=planar, duration=0.4), planar=planar), 0.4)

        points = tuple(_measured(n, lambda n=n, f=piled: f(n)) for n in piles)  # type: ignore[misc]
        yield Series(f"bodies in a pile, {where}", "bodies", points)


def column(count: int) -> World:
    """Return a cube of about so many particles, half a metre wide, in a box 1 x 0.5 x 1 m."""
    cell = 0.5 / round((count / 8) ** (1 / 3))
    volume = FluidVolume(shape=Box(half_extents=(0.25, 0.25, 0.25)), position=(0.25, 0.25, 0.25))
    grid = FluidGrid(lower=(0, 0, 0), upper=(round(1.0 / cell) * cell, 0.5, round(1.0 / cell) * cell), cell=cell)
    return World(deformables=(Fluid(name="water", volumes=(volume,)),), fluid_grid=grid)


def particles(sizes: Sequence[int]) -> Iterator[Series]:
    """Yield what particles of a fluid cost."""
    points = tuple(_measured(n, lambda n=n: _run_of(column(n), FLUID_STEP)) for n in sizes)  # type: ignore[misc]
    yield Series("fluid, two frames of 2 ms", "particles", points)


def worlds(sizes: Sequence[int]) -> Iterator[Series]:
    """Yield what worlds of six bodies cost."""
    for planar in (True, False):
        world = world_of(six(0.1), planar=planar)
        points = tuple(_measured(n, lambda n=n, w=world: _run_of(w, 0.1, n)) for n in sizes)  # type: ignore[misc]
        yield Series(f"worlds of six bodies, {'plane' if planar else 'space'}", "worlds", points)


def horizons(sizes: Sequence[int]) -> Iterator[Series]:
    """Yield what seconds of six bodies cost."""
    for planar in (True, False):
        world = world_of(six(1.0), planar=planar)
        points = tuple(_measured(n, lambda n=n, w=world: _run_of(w, float(n))) for n in sizes)  # type: ignore[misc]
        yield Series(f"horizon of six bodies, {'plane' if planar else 'space'}", "seconds", points)


def tables(quick: bool) -> list[Table]:
    """Return the tables of this section."""
    doubled = (2, 8, 32, 64) if quick else (2, 4, 8, 16, 32, 64, 128, 256, 512)
    found: list[Series] = [
        *bodies(doubled),
        *particles((1_000, 4_000) if quick else (1_000, 3_000, 10_000, 30_000, 100_000)),
        *worlds((1, 16, 64) if quick else (1, 4, 16, 64, 256, 1024, 4096)),
        *horizons((1, 4) if quick else (1, 4, 16, 64)),
    ]
    summary = Table(
        "Growth",
        "Processor seconds with one thread; 1 is linear. memory: what preparing and running took at the largest size.",
        ("what", "sizes", "prepare: exponent", "run: exponent", "memory: exponent", "run at the largest [s]", "[MB]"),
        tuple(_summary(series) for series in found),
    )
    return [summary, *(_points(series) for series in found)]


def _summary(series: Series) -> tuple[str, ...]:
    sizes = [float(point.size) for point in series.points]
    prepare, run, memory = (
        exponent(sizes, [getattr(point, name) for point in series.points]) for name in ("prepare", "run", "megabytes")
    )
    last = series.points[-1]
    reach = f"{series.points[0].size} to {last.size} {series.unit}"
    return (
        series.name,
        reach,
        f"{prepare:.2f}",
        f"{run:.2f}",
        "-" if math.isnan(memory) else f"{memory:.2f}",
        f"{last.run:.3g}",
        f"{last.megabytes:.0f}",
    )


def _points(series: Series) -> Table:
    rows = tuple((str(p.size), f"{p.prepare:.3g}", f"{p.run:.3g}", f"{p.megabytes:.1f}") for p in series.points)
    return Table(series.name.capitalize(), "", (series.unit, "prepare [s]", "run [s]", "memory [MB]"), rows)


def plot(tables: Sequence[Table], folder: Path) -> None:
    """Draw time over size of every series to growth.png in a folder."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, side = pyplot.subplots(figsize=(6, 5))
    for table in tables[1:]:
        sizes = [float(row[0].replace(",", "")) for row in table.rows]
        side.loglog(sizes, [float(row[2]) for row in table.rows], "o-", markersize=3, label=table.title)
    side.set_xlabel("size")
    side.set_ylabel("run [s]")
    side.legend(fontsize=7)
    side.grid(visible=True, alpha=0.3)
    figure.tight_layout()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "growth.png", dpi=70)
