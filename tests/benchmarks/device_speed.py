"""Speed of rigid worlds on one device: `python -m tests.benchmarks.device_speed cuda`.

Six bodies slide and collide for 2 s in steps of 2 ms, each world with frictions of its own. World-steps a second of a
whole run, samples read back included; compiled and warm. On a GPU worlds run side by side, on a CPU on all its cores.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from polyworld.core import buffers
from polyworld.solver.rollout import simulator
from tests.scenes.six_bodies import BODIES, SUBSTEP, six_body_world

DURATION = 2.0  # [s]


def world_steps_a_second(worlds: int, *, planar: bool, duration: float = DURATION) -> tuple[float, float]:
    """Return world-steps a second of the second run, and the seconds that the first took, which compiles."""
    rng = np.random.default_rng(0)
    frictions = {f"objects.{name}.friction": rng.uniform(0.2, 0.4, worlds) for name, *_ in BODIES}
    runner = simulator(six_body_world(planar=planar), np.array([0.0, duration]), n_worlds=worlds)
    began = time.perf_counter()
    runner.run(frictions)
    first = time.perf_counter()
    found = runner.run(frictions)
    spent = time.perf_counter() - first
    if found.diverged.any():
        raise RuntimeError(f"{int(found.diverged.sum())} of {worlds} worlds diverged")
    return worlds * duration / SUBSTEP / spent, first - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("device", nargs="?", default="cpu")
    parser.add_argument("--worlds", type=int, nargs="+", default=[8192, 65536])
    parser.add_argument("--duration", type=float, default=DURATION, help="simulated [s]")
    options = parser.parse_args()
    buffers.use_device(options.device)
    for planar in (True, False):
        for worlds in options.worlds:
            rate, first = world_steps_a_second(worlds, planar=planar, duration=options.duration)
            kind = "planar" if planar else "spatial"
            speed = f"{rate / 1e6:7.2f} M world-steps/s, first run {first:.1f} s"
            print(f"{kind:8} {options.device} {worlds:6} worlds: {speed}")


if __name__ == "__main__":
    main()
