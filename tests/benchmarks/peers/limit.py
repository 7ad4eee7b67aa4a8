"""How near a step is to what the processor can do: bandwidth, multiply-adds, and the least work of six bodies."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import warp as wp

from polyworld.core import buffers
from tests.benchmarks.peers.polyworld_engine import PolyWorld
from tests.benchmarks.peers.scenes import Scene, six
from tests.benchmarks.peers.table import Table
from tests.benchmarks.peers.timing import interleaved

wp.set_module_options({"enable_backward": False})

LOOPS = 1_000_000
# Least multiply-adds of a step, by counting the terms of the formulas: of a body (motion, rotation, friction with the
# floor), of a pair (are their bounds apart?) and of a touching pair (geometry, rows, one pass of impulses).
WORK = {"planar": (40, 6, 120), "spatial": (250, 9, 600)}
PAIRS = 15
# Numbers of double precision that a step reads and writes of a body: pose, velocities, inertia and shape.
STATE = {"planar": 20, "spatial": 45}


@wp.kernel
def dependent(loops: int, out: wp.array[wp.float64]) -> None:
    """Multiply and add, each after the one before."""
    a = wp.float64(0.999999)
    x = a * out[0]
    for _ in range(loops):
        x = x * a + a
    out[0] = x  # type: ignore[index]


@wp.kernel
def independent(loops: int, out: wp.array[wp.float64]) -> None:
    """Multiply and add in eight chains that do not wait for each other."""
    a = wp.float64(0.999999)
    x0, x1, x2, x3 = a * out[0], a * out[1], a * out[2], a * out[3]
    x4, x5, x6, x7 = a * out[4], a * out[5], a * out[6], a * out[7]
    for _ in range(loops):
        x0 = x0 * a + a
        x1 = x1 * a + a
        x2 = x2 * a + a
        x3 = x3 * a + a
        x4 = x4 * a + a
        x5 = x5 * a + a
        x6 = x6 * a + a
        x7 = x7 * a + a
    out[0] = x0 + x1 + x2 + x3 + x4 + x5 + x6 + x7  # type: ignore[index]


def multiply_adds(kernel: Any, chains: int) -> float:
    """Return multiply-adds a second of one core in a compiled kernel, best of five."""
    out = buffers.zeros(8, wp.float64)
    buffers.launch(kernel, 1, [10, out])
    return LOOPS * chains / min(_seconds(lambda: buffers.launch(kernel, 1, [LOOPS, out])) for _ in range(5))


def bandwidth() -> float:
    """Return bytes read and written a second by a copy of 128 MiB, one core, best of five (STREAM's copy)."""
    source = np.ones(2**24)
    target = np.zeros_like(source)
    return 2 * source.nbytes / min(_seconds(lambda: np.copyto(target, source)) for _ in range(5))


def _seconds(call: Any) -> float:
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


def touching(scene: Scene) -> float:
    """Return the mean number of pairs of bodies that touch, within a tenth of their radius, from their centres."""
    run = PolyWorld(planar=True).prepare(scene, 1, 0.02, 1)
    run.run()
    x = run.motion().positions
    i, j = np.triu_indices(x.shape[1], 1)
    radius = scene.bodies[0].size[0]
    return float((np.linalg.norm(x[:, i] - x[:, j], axis=-1) < 2.1 * radius).sum(axis=1).mean())


def table(quick: bool) -> Table:
    """Return the step of six bodies, measured on one core, beside what its arithmetic and its memory would take."""
    scene, worlds = six(1.0 if quick else 5.0), 8
    runs = {name: PolyWorld(planar=name == "planar").prepare(scene, worlds, 0.04, 1) for name in WORK}
    times, _ = interleaved({name: run.run for name, run in runs.items()}, 2 if quick else 5)
    slow, fast, stream = multiply_adds(dependent, 1), multiply_adds(independent, 8), bandwidth()
    contacts = touching(scene)
    rows = []
    for name, (body, pair, contact) in WORK.items():
        measured = 1e9 * times[name].cpu / (worlds * scene.steps)
        floor_contacts = 6.0 if name == "spatial" else 0.0
        work = 6 * body + PAIRS * pair + (contacts + floor_contacts) * contact
        size = 6 * STATE[name] * 8
        in_turn, at_once, memory = 1e9 * work / slow, 1e9 * work / fast, 1e9 * 2 * size / stream
        rows.append(
            (
                name,
                f"{measured:.0f}",
                f"{work:.0f}",
                f"{in_turn:.0f}",
                f"{at_once:.0f}",
                f"{measured / at_once:.1f}",
                f"{2 * size}",
                f"{memory:.0f}",
            )
        )
    return Table(
        "The limit: a step of six bodies on one core",
        f"Measured here: {slow / 1e9:.2f} thousand million double multiply-adds a second where each waits for the one "
        f"before, {fast / 1e9:.2f} in eight chains, {stream / 1e9:.1f} GB/s of memory. Multiply-adds are estimates: "
        f"terms of the formulas for 6 bodies, {PAIRS} pairs, {contacts:.2f} touching pairs on average, and 6 contacts "
        "with the floor in space. A world stays in the cache, so that the bytes are an upper bound, and branches, "
        "divisions and roots are not counted: what is above the limit is those, searches and repeated passes.",
        (
            "PolyWorld",
            "measured [ns]",
            "multiply-adds",
            "in turn [ns]",
            "in eight chains [ns]",
            "times the limit",
            "bytes",
            "from memory [ns]",
        ),
        tuple(rows),
    )
