"""Discs that slide on a plane and collide, as a video shows them: 30 Hz, 2 mm, no spin measured; and their fits.

The data come from an independent integrator, from event to event (SciPy), in `tests.scenes.discs`.
"""

from functools import cache

import numpy as np

from polyworld.data.recording import Recording, Run
from polyworld.estimation import profile
from polyworld.estimation.design import Design, design
from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.refitting import refit_every_run, refit_ill_runs
from polyworld.gap.stepping import coarsened
from polyworld.world import World
from tests.scenes.discs import Discs, Started, slide

FRICTION, RESTITUTION, SIGMA, RATE, DURATION = 0.06, 0.85, 0.002, 30.0, 3.0


def scene(count: int, seed: int) -> tuple[Discs, list[Started]]:
    """Draw discs of 6 to 12 cm and three runs that throw them across one another's paths at 0.6 to 2.2 m/s."""
    rng = np.random.default_rng([seed, count])
    discs = Discs(
        np.round(rng.uniform(0.3, 1.2, count), 2),
        np.round(rng.uniform(0.06, 0.12, count), 3),
        np.full(count, FRICTION),
        RESTITUTION,
    )
    return discs, [started(rng, count) for _ in range(3)]


def started(rng: np.random.Generator, count: int) -> Started:
    """Draw the start of a run: on a ring, towards its middle."""
    angles = 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
    places = rng.uniform(0.7, 1.2, (count, 1)) * np.column_stack([np.cos(angles), np.sin(angles)])
    ways = rng.normal(0.0, 0.08, (count, 2)) - places
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return Started(places, rng.uniform(0.6, 2.2, (count, 1)) * ways, rng.uniform(-8.0, 8.0, count))


def recordings(hidden: Discs, starts: list[Started], seed: int) -> tuple[Recording, Recording]:
    """Simulate the runs with white noise: all but the last to be explained, the last one held out."""
    rng = np.random.default_rng(seed)
    times = np.arange(round(DURATION * RATE) + 1) / RATE
    runs = []
    for k, begin in enumerate(starts):
        flat = slide(hidden, begin, times)[..., :2]
        places = np.zeros((*flat.shape[:2], 3))
        places[..., :2] = flat + rng.normal(0.0, SIGMA, flat.shape)
        names = tuple(f"disc{i}" for i in range(flat.shape[1]))
        runs.append(Run(f"run{k}", names, times, places, np.full((*flat.shape[:2], 4), np.nan)))
    return Recording(tuple(runs[:-1])), Recording(tuple(runs[-1:]))


def world(discs: Discs, first: Started) -> World:
    """Describe the discs without what is hidden, and without what the data do not show of their start."""
    bodies = [
        {
            "name": f"disc{i}",
            "representation": "rigid_planar",
            "shape": {"kind": "cylinder", "radius": float(discs.radii[i]), "half_height": 0.025},
            "mass": float(discs.masses[i]),
            "friction": float(discs.frictions[i]),
            "restitution": discs.restitution,
            "torsional_radius": float(discs.share * discs.radii[i]),
            "position": [*(float(v) for v in np.round(first.positions[i], 2)), 0.0],
        }
        for i in range(len(discs.masses))
    ]
    return World.model_validate(
        {
            "objects": bodies,
            "environment": {"gravity": [0, 0, -9.81], "motion_plane": {"supports": True}},
            "time": {"seconds_per_frame": 1.0 / RATE, "substep": 0.002},
        }
    )


def laid_out(hidden: Discs, count: int, seed: int) -> Design:
    """Prepare the fit of discs that move by the laws of `hidden`: three runs."""
    discs, starts = scene(count, seed)
    base = world(discs, starts[0])
    data, _ = recordings(hidden, [*starts, starts[0]], seed)
    return design(coarsened(base, data), data)


@cache
def plain(count: int, seed: int) -> tuple[FitContext, FittedHypothesis]:
    """Fit discs of which nothing is hidden, by multistart of every run."""
    plan = laid_out(scene(count, seed)[0], count, seed)
    context = FitContext(plan, measured_noise(plan), 1)
    first = profile.start_states(plan)
    fitted = context.fit(Hypothesis(plan.world, ()), np.zeros(0), first, horizons=profile.FINE_HORIZONS)
    return context, refit_ill_runs(refit_every_run(fitted))


def bent_run(right: FittedHypothesis, run: int, start: str, off: float) -> FittedHypothesis:
    """Fit again from the states found, one component of one run's changed by `off`."""
    states = list(right.fit.states)
    labels = right.context.design.runs[run].labels
    states[run] = right.fit.states[run] + off * np.array([label == start for label in labels])
    return right.context.fit(right.hypothesis, right.values, states)
