"""Hidden parameters of every material, recovered from noisy readouts: `python -m tests.benchmarks.recovery`.

The data come from a finer resolution and half the step of the model that is fitted (no inverse crime), so that the
discretisation of the model is part of the error. Prints, for each parameter, hidden and fitted value, the error and the
80% interval, which knows of the noise, not of the model's resolution.
"""

from __future__ import annotations

import argparse
import time

from polyworld.estimation.fit import FitOptions, fit
from tests.polyworld.synthetic import of_one
from tests.scenes.material_parameters import scenes


def main() -> None:
    """Fit all scenes, or those named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", help="names of scenes")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    known = {scene.name: scene for scene in scenes()}
    unknown = sorted(set(asked.only or ()) - set(known))
    if unknown:
        parser.error(f"unknown scenes {unknown}; scenes: {list(known)}")
    print(f"{'scene':<20} {'parameter':<28} {'hidden':>10} {'fitted':>10} {'error':>7}  80% interval")
    for name in asked.only or known:
        scene, began = known[name], time.process_time()
        options = FitOptions(share=0.0, states=False, edit=lambda _, own=scene.unknowns: list(own))  # type: ignore[misc]
        found = fit(of_one(scene.build(False), scene.observed(asked.seed)), options)
        for c in found.constants:
            hidden = scene.hidden[c.unknown.paths[0]]
            low, high = (f"{v / hidden - 1.0:+.1%}" for v in c.interval)
            error = f"{c.value / hidden - 1.0:+.1%}"
            print(f"{name:<20} {c.unknown.name:<28} {hidden:>10.4g} {c.value:>10.4g} {error:>7}  {low} to {high}")
        seconds = time.process_time() - began
        print(f"{'':<20} misfit {found.misfit:.2f}, {found.rollouts} rollouts, {seconds:.1f} s", flush=True)


if __name__ == "__main__":
    main()
