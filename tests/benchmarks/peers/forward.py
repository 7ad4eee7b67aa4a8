"""The forward model beside MuJoCo and Newton: six bodies, piles, terrain and chains; speed beside accuracy.

Every figure is measured in the run that prints it, the engines in turn on the same cores. MuJoCo and PolyWorld compute
in double precision with all cores, Newton in single precision and, as Warp does on a processor, with one.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from tests.benchmarks.peers import accuracy, measures, progress, scenes
from tests.benchmarks.peers.engine import Engine
from tests.benchmarks.peers.machine import THREADS
from tests.benchmarks.peers.mujoco_engine import MuJoCo
from tests.benchmarks.peers.polyworld_engine import PolyWorld
from tests.benchmarks.peers.scenes import Motion, Scene
from tests.benchmarks.peers.table import Table
from tests.benchmarks.peers.timing import Times, advantage, interleaved, milliseconds, prepared

PLANAR, SPATIAL = PolyWorld(planar=True), PolyWorld(planar=False)
INTERVAL = 0.04  # between samples [s]
PILES = (2, 6, 8, 16, 32, 64, 128, 256)
CHAINS = (2, 5, 10, 20, 30)
SLOW = 10_000.0  # an engine that takes longer for a pile gets no larger one [ms]
ANGLE = 0.5  # of a chain at the start [rad]


@dataclass(frozen=True)
class Sizes:
    """What a whole or a quick run measures. Durations [s]."""

    repeats: int
    six: tuple[tuple[int, float], ...]  # worlds, duration
    piles: tuple[int, ...]
    pile: float
    bodies_on_terrain: tuple[int, ...]
    chains: tuple[int, ...]


WHOLE = Sizes(5, ((1, 5.0), (64, 5.0), (1024, 1.0)), PILES, 1.0, (4, 16), CHAINS)
QUICK = Sizes(1, ((1, 5.0), (64, 1.0)), (2, 8, 32), 0.4, (4,), (2, 10))


def newton() -> tuple[Engine, ...]:
    """Return Newton's engines, none where it is not installed."""
    if importlib.util.find_spec("newton") is None:
        return ()
    from tests.benchmarks.peers.newton_engine import Newton

    return Newton("XPBD"), Newton("SemiImplicit")


def tables(quick: bool) -> list[Table]:
    """Return the tables of this section."""
    sizes = QUICK if quick else WHOLE
    others = newton()
    spatial_peers = (MuJoCo("rollout"), MuJoCo("batch"), *others)
    planar_peers = (MuJoCo("rollout", planar=True), MuJoCo("batch", planar=True), *others)
    found = [accuracy.table((PLANAR, SPATIAL, MuJoCo("rollout"), *others)), _six(sizes, spatial_peers)]
    for restitution in (0.0, 0.9):
        found.append(_pile(sizes, restitution, False, (SPATIAL,), spatial_peers))
        found.append(_pile(sizes, restitution, True, (PLANAR, SPATIAL), planar_peers))
    found += [_terrain(sizes, (SPATIAL,), spatial_peers), _chain(sizes, (PLANAR, SPATIAL), spatial_peers)]
    return found


Measure = Callable[[Scene, Motion], tuple[str, ...]]


def _rows(
    label: str,
    scene: Scene,
    worlds: int,
    engines: tuple[Engine, ...],
    peers: tuple[Engine, ...],
    repeats: int,
    measure: Measure,
    blank: int,
) -> list[tuple[str, ...]]:
    """Rows of one scene: label, engine, wall and CPU times, times as fast as the fastest peer, and measures."""
    progress.show(f"{label}: {len(scene.bodies)} bodies, {scene.duration:g} s")
    ready, refused = prepared((*engines, *peers), scene, worlds, INTERVAL)
    times, failed = interleaved({name: run.run for name, run in ready.items()}, repeats)
    names = [peer.name for peer in peers]
    rows = []
    for engine in (*engines, *peers):
        if engine.name in times:
            measured = measure(scene, ready[engine.name].motion())
            rows.append((label, engine.name, *_speed(times, engine.name, names, worlds * scene.steps), *measured))
        else:
            reason = {**refused, **failed}[engine.name]
            rows.append((label, engine.name, reason, *([""] * (2 + blank))))
    return rows


def _speed(times: Mapping[str, Times], name: str, peers: Sequence[str], world_steps: int) -> tuple[str, str, str]:
    each = 1e6 * times[name].cpu / world_steps
    return milliseconds(times[name].wall), f"{each:.3g}", advantage(times, name, peers)


SPEED = ("engine", "wall [ms]", "CPU us per world-step", "times as fast as the fastest other peer")


def _six(sizes: Sizes, peers: tuple[Engine, ...]) -> Table:
    def measure(scene: Scene, motion: Motion) -> tuple[str, ...]:
        values = measures.energy(scene, motion)
        return (f"{measures.energy_gain(scene, motion):.1e}", f"{values[-1] - 9.81 * 0.2 * 6:.3f}")

    rows = []
    for worlds, duration in sizes.six:
        label = f"{worlds} x {duration:g} s"
        rows += _rows(label, scenes.six(duration), worlds, (PLANAR, SPATIAL), peers, sizes.repeats, measure, 2)
    return Table(
        "Six bodies on a floor",
        f"Two cylinders, two balls, two cubes, 2 ms; worlds x seconds simulated; {THREADS} threads. MuJoCo's contacts "
        "are oscillators that return e = 0.5. energy gain: the largest rise; kinetic energy left at the end [J].",
        ("worlds", *SPEED, "energy gain", "energy left [J]"),
        tuple(rows),
    )


def _pile(
    sizes: Sizes, restitution: float, upright: bool, engines: tuple[Engine, ...], peers: tuple[Engine, ...]
) -> Table:
    def measure(scene: Scene, motion: Motion) -> tuple[str, ...]:
        left = float((motion.velocities[-1] ** 2).sum(axis=-1).mean() ** 0.5)
        deepest, gain = measures.penetration(scene, motion), measures.energy_gain(scene, motion)
        return (f"{100 * deepest:.2g}", f"{gain:.1e}", f"{left:.2g}")

    rows: list[tuple[str, ...]] = []
    for count in sizes.piles:
        scene = scenes.pile(count, restitution, upright=upright, duration=sizes.pile)
        slow = {row[1]: row[0] for row in rows if row[2].isdecimal() and float(row[2]) > SLOW}
        taken = [tuple(engine for engine in some if engine.name not in slow) for some in (engines, peers)]
        rows += _rows(str(count), scene, 1, taken[0], taken[1], sizes.repeats, measure, 3)
        rows += [
            (str(count), name, f"left out: {at} balls took over {SLOW / 1e3:g} s", *[""] * 5)
            for name, at in slow.items()
        ]
    kind = "in a plane" if upright else "in space"
    how = "MuJoCo's bodies have two slides and a hinge each, Newton's six freedoms. " if upright else ""
    return Table(
        f"Piles of balls in a box, {kind}, e = {restitution:g}",
        f"One world, {sizes.pile:g} s at 2 ms. {how}penetration: deepest overlap, of the radius; energy gain: the "
        "largest rise, with what soft contacts give back; speed: root mean square at the end.",
        ("balls", *SPEED, "penetration [%]", "energy gain", "speed left [m/s]"),
        tuple(rows),
    )


def _terrain(sizes: Sizes, engines: tuple[Engine, ...], peers: tuple[Engine, ...]) -> Table:
    def measure(scene: Scene, motion: Motion) -> tuple[str, ...]:
        left = float((motion.velocities[-1] ** 2).sum(axis=-1).mean() ** 0.5)
        return (f"{100 * measures.sunk(scene, motion):.2g}", f"{left:.2g}")

    rows = []
    for count in sizes.bodies_on_terrain:
        rows += _rows(str(count), scenes.terrain(count, 1.0), 1, engines, peers, sizes.repeats, measure, 2)
    return Table(
        "Balls and cubes on hills of 1,152 triangles",
        "One world, 1 s at 2 ms. PolyWorld (spatial alone) and Newton take the concave triangle mesh; MuJoCo's meshes "
        "are convex hulls, so that it gets the same heights as a height field.",
        ("bodies", *SPEED, "penetration [%]", "speed left [m/s]"),
        tuple(rows),
    )


def _chain(sizes: Sizes, engines: tuple[Engine, ...], peers: tuple[Engine, ...]) -> Table:
    def measure(scene: Scene, motion: Motion) -> tuple[str, ...]:
        error = measures.chain_error(scene, motion, ANGLE)
        return (f"{100 * error:.2g}", f"{100 * measures.chain_drift(scene, motion):.2g}")

    rows = []
    for count in sizes.chains:
        scene = scenes.chain(count, 1.0, ANGLE)
        rows += _rows(str(count), scene, 1, engines, peers, sizes.repeats, measure, 2)
    return Table(
        "Chains of hinged rods",
        "One world, 1 s at 2 ms, let go straight at 0.5 rad. error: of the last rod's middle against Lagrange's "
        "equations integrated to 1e-10, of the chain's length; drift: of the energy it can lose.",
        ("rods", *SPEED, "error [%]", "energy drift [%]"),
        tuple(rows),
    )
