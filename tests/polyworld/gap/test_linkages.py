"""Damping of hinges: a double pendulum by Lagrange's equations, and a single one."""

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.gap import find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.report import effects_of
from polyworld.world import World
from tests.polyworld.double_pendulum import LOWER, MASS, RADIUS, UPPER, angles
from tests.polyworld.gap_scenes import pendulum_recording, pendulum_world

Array = NDArray[np.float64]
SIGMA, TIMES = 0.001, np.arange(60) / 60.0


def double() -> World:
    """Two balls that hang: one from the origin, the other from the first."""
    balls = [
        {"name": n, "shape": {"kind": "sphere", "radius": RADIUS}, "mass": MASS, "position": (0, 0, z)}
        for n, z in (("a", -UPPER), ("b", -UPPER - LOWER))
    ]
    hinges = [
        {"kind": "hinge", "name": "h1", "anchor": (0, 0, 0), "axis": (0, 1, 0), "object": "a"},
        {"kind": "hinge", "name": "h2", "anchor": (0, 0, -UPPER), "axis": (0, 1, 0), "object": "b", "other": "a"},
    ]
    return World.model_validate({"objects": balls, "joints": hinges, "time": {"substep": 0.005}})


def swung(start: tuple[float, float, float, float], damping: float, seed: int) -> Run:
    """Angles from hanging and their rates, with the balls' own inertia; damping [N m s/rad] of the upper hinge."""
    found = angles(start, TIMES, damping)
    upper, lower = (
        long * np.stack([-np.sin(q), 0.0 * q, -np.cos(q)], axis=-1)
        for long, q in ((UPPER, found[0]), (LOWER, found[1]))
    )
    places = np.stack([upper, upper + lower], axis=1)
    places += np.random.default_rng(seed).normal(0.0, SIGMA, places.shape)
    places[:, :, 1] = np.nan
    return Run(f"r{seed}", ("a", "b"), TIMES, places, np.full((len(TIMES), 2, 4), np.nan))


def test_damping_in_one_hinge_of_two_is_named_with_the_hinge() -> None:
    starts = [(1.2, 0.4, 0.0, 0.0), (-0.6, 0.5, 0.0, 1.0), (0.3, -1.0, 0.0, 0.0)]
    recording = Recording(tuple(swung(s, 0.002, k) for k, s in enumerate(starts)))
    report = find_gap(double(), recording, candidates=named(["joint_damping", "joint_friction"]))
    assert report.verdict.kind == "identified"
    (effect,) = effects_of(report.verdict.best)
    assert (effect["name"], effect["label"]) == ("joint_damping", "of h1")
    low, high = effect["unknowns"]["damping"]["interval95"]
    assert low - 2e-5 < 0.002 < high + 2e-5


def test_dry_friction_in_a_hinge_is_distinguished_from_damping() -> None:
    recording = pendulum_recording(lambda rate: -0.03 * float(np.sign(rate)), np.random.default_rng(2), runs=3)
    offered = named(["joint_friction", "joint_damping", "quadratic_drag"])
    report = find_gap(pendulum_world(), recording, candidates=offered)
    assert (report.verdict.kind, report.names) == ("identified", ("joint_friction",))
    (unknown,) = effects_of(report.verdict.best)[0]["unknowns"].values()
    low, high = unknown["interval95"]
    assert low - 3e-4 < 0.03 < high + 3e-4
