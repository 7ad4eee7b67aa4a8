"""Seconds to the first rollout of each kind of world: in a new process, with and without compiled kernels.

python -m tests.benchmarks.peers.startup rope        # what one such process does
"""

from __future__ import annotations

import importlib.util
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.benchmarks.peers import progress
from tests.benchmarks.peers.table import Table

HORIZON = 0.02  # [s]: ten steps of 2 ms
RIGID = {
    "objects": [
        {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0, 0, 0.1]},
        {"name": "box", "shape": {"kind": "box", "half_extents": [0.1, 0.1, 0.1]}, "position": [0.25, 0, 0.1]},
    ],
    "statics": [{"name": "floor", "shape": {"kind": "plane"}}],
}
MATERIALS = ("rope", "cloth", "soft", "fluid")
KINDS = ("planar", "spatial", "spatial with joints", *MATERIALS, "coupled")
PEERS = ("MuJoCo", "Newton XPBD")


def run(kind: str) -> None:
    """Roll one small world of a kind out."""
    _peer(kind) if kind in PEERS else _rollout(kind)


def _rollout(kind: str) -> None:
    from polyworld.solver.rollout import rollout

    rollout(_world(kind), HORIZON)


def _world(kind: str) -> Any:
    from atw_mcp.warmup import MATERIALS as PARTS
    from polyworld.world import World
    from tests.benchmarks.peers.polyworld_engine import world_of
    from tests.benchmarks.peers.scenes import chain, six

    if kind in ("planar", "spatial"):
        return world_of(six(HORIZON), planar=kind == "planar")
    if kind == "spatial with joints":
        return world_of(chain(3, HORIZON), planar=False)
    chosen = [PARTS[name] for name in (MATERIALS if kind == "coupled" else (kind,))]
    everything = {key: value for parts in chosen for key, value in parts.items()}
    everything["deformables"] = [item for parts in chosen for item in parts["deformables"]]
    return World.model_validate({**RIGID, **everything})


def _peer(kind: str) -> None:
    from tests.benchmarks.peers.scenes import six

    engine: Any
    if kind == "MuJoCo":
        from tests.benchmarks.peers.mujoco_engine import MuJoCo

        engine = MuJoCo("rollout")
    else:
        from tests.benchmarks.peers.newton_engine import Newton

        engine = Newton("XPBD")
    engine.prepare(six(HORIZON), 1, HORIZON, 1).run()


@dataclass(frozen=True)
class Start:
    """Wall and CPU seconds of a process from its start to its end."""

    wall: float
    cpu: float


def process(kind: str, cache: Path) -> Start:
    """Return how long a new process takes for a kind of world with the kernels in `cache`."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "tests.benchmarks.peers.startup", kind],
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "WARP_CACHE_PATH": str(cache)},
    )
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Start(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def compiled(cache: Path) -> tuple[int, int, float]:
    """Return how many modules and kernels a cache holds, and their size [MB]."""
    modules = list(cache.rglob("*.meta"))
    kernels = sum(len(json.loads(path.read_text())) for path in modules)
    return len(modules), kernels, sum(path.stat().st_size for path in cache.rglob("*.o")) / 1e6


def tables(quick: bool) -> list[Table]:
    """Return the table of this section."""
    kinds = ("planar", "spatial") if quick else (*KINDS, *PEERS)
    rows = []
    for kind in kinds:
        progress.show(f"first rollout: {kind}")
        if kind.startswith("Newton") and importlib.util.find_spec("newton") is None:
            rows.append((kind, "not installed", *[""] * 6))
            continue
        with tempfile.TemporaryDirectory() as folder:
            rows.append(_row(kind, lambda kind=kind, folder=folder: process(kind, Path(folder)), Path(folder)))  # type: ignore[misc]
    return [
        Table(
            "First rollout in a new process",
            "From the start of Python to the end of ten steps; cold: no compiled kernels; warm: kernels cached by the "
            "cold run. All of the import is included. Newton compiles more than its solver: collisions of all shapes.",
            ("world", "cold [s]", "cold, CPU [s]", "warm [s]", "warm, CPU [s]", "modules", "kernels", "cached [MB]"),
            tuple(rows),
        )
    ]


def _row(kind: str, start: Callable[[], Start], cache: Path) -> tuple[str, ...]:
    try:
        cold = start()
        modules, kernels, megabytes = compiled(cache)
        warm = start()
    except subprocess.CalledProcessError as error:  # a finding, not the end of the comparison
        return (kind, f"failed: exit code {error.returncode}", *[""] * 6)
    times = (f"{seconds:.2f}" for seconds in (cold.wall, cold.cpu, warm.wall, warm.cpu))
    return (kind, *times, f"{modules}", f"{kernels}", f"{megabytes:.1f}")


if __name__ == "__main__":
    run(sys.argv[1])
