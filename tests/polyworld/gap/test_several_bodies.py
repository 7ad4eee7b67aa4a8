"""Discs that slide on a plane and collide, as a video shows them: 30 Hz, 2 mm, no spin measured.

The data come from an independent integrator, from event to event (SciPy), in `tests.scenes.discs`.
"""

from dataclasses import replace

import numpy as np

from polyworld.data.recording import Recording, Run
from polyworld.gap import GapReport, find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.report import effects_of
from polyworld.world import World
from tests.scenes.discs import Discs, Started, slide

FRICTION, RESTITUTION, SIGMA, RATE, DURATION = 0.06, 0.85, 0.002, 30.0, 1.5


def scene(count: int, seed: int) -> tuple[Discs, list[Started]]:
    """Draw discs of 6 to 12 cm and four runs that throw them across one another's paths at 0.6 to 2.2 m/s."""
    rng = np.random.default_rng([seed, count])
    discs = Discs(
        np.round(rng.uniform(0.3, 1.2, count), 2),
        np.round(rng.uniform(0.06, 0.12, count), 3),
        np.full(count, FRICTION),
        RESTITUTION,
    )
    return discs, [started(rng, count) for _ in range(4)]


def started(rng: np.random.Generator, count: int) -> Started:
    """Draw the start of a run: on a ring, towards its middle."""
    angles = 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
    places = rng.uniform(0.7, 1.2, (count, 1)) * np.column_stack([np.cos(angles), np.sin(angles)])
    ways = rng.normal(0.0, 0.08, (count, 2)) - places
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return Started(places, rng.uniform(0.6, 2.2, (count, 1)) * ways, rng.uniform(-8.0, 8.0, count))


def recorded(hidden: Discs, starts: list[Started], seed: int) -> Recording:
    """Simulate the runs with white noise."""
    rng = np.random.default_rng(seed)
    times = np.arange(round(DURATION * RATE) + 1) / RATE
    runs = []
    for k, begin in enumerate(starts):
        flat = slide(hidden, begin, times)[..., :2]
        places = np.zeros((*flat.shape[:2], 3))
        places[..., :2] = flat + rng.normal(0.0, SIGMA, flat.shape)
        names = tuple(f"disc{i}" for i in range(flat.shape[1]))
        runs.append(Run(f"run{k}", names, times, places, np.full((*flat.shape[:2], 4), np.nan)))
    return Recording(tuple(runs))


def described(discs: Discs, first: Started) -> World:
    """The discs without what is hidden, and without what the data do not show of their start."""
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


def found(hidden: Discs, discs: Discs, starts: list[Started], *names: str) -> GapReport:
    return find_gap(described(discs, starts[0]), recorded(hidden, starts, 2), candidates=named(names))


def test_collisions_without_anything_hidden_are_explained() -> None:
    """The spins show in how far each disc slides, and their signs only in how it leaves a collision."""
    discs, starts = scene(3, 2)
    report = found(discs, discs, starts, "quadratic_drag", "restitution_error")
    assert report.verdict.kind == "nothing_missing"
    assert report.verdict.before < 1.3


def test_another_restitution_shows_in_collisions_alone() -> None:
    discs, starts = scene(2, 2)
    hidden = replace(discs, restitution=0.6)
    report = found(hidden, discs, starts, "restitution_error", "linear_drag")
    assert (report.verdict.kind, report.names) == ("identified", ("restitution_error",))
    low, high = effects_of(report.verdict.best)[0]["unknowns"]["restitution"]["interval95"]
    assert low - 0.01 < 0.6 < high + 0.01


def test_drag_of_each_disc_by_itself_is_one_law_of_all() -> None:
    discs, starts = scene(2, 3)
    drag = 0.2  # [kg/s]
    hidden = replace(discs, forces=(lambda _t, _x, v, _w: -drag * v,))
    report = found(hidden, discs, starts, "linear_drag", "quadratic_drag", "restitution_error")
    assert (report.verdict.kind, report.names) == ("identified", ("linear_drag",))
    (effect,) = effects_of(report.verdict.best)
    assert effect["label"] == "one coefficient for all bodies"
    low, high = effect["unknowns"]["coefficient"]["interval95"]
    assert abs(0.5 * (low + high) - drag) < high - low  # four standard errors
