"""A pendulum of another length, and a spring of another stiffness, that soon lose step with the world's."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from polyworld.data.recording import Recording, Run
from polyworld.gap import find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.report import effects_of
from polyworld.world import World
from polyworld.world.parameters import read_parameter
from tests.polyworld.gap_scenes import LENGTH, MASS, G, pendulum_world

TIMES = np.arange(90) / 30.0
SPRUNG = World.model_validate(
    {
        "objects": [{"name": "bob", "shape": {"kind": "sphere", "radius": 0.05}, "position": [0, 0, 0], "mass": MASS}],
        "joints": [
            {
                "kind": "spring",
                "name": "coil",
                "object": "bob",
                "anchor": [0, 0, 0],
                "other_anchor": [-1, 0, 0],
                "stiffness": 20.0,
            }
        ],
        "environment": {"gravity": [0, 0, 0]},
        "time": {"substep": 0.01},
    }
)


def recorded(places: list[np.ndarray]) -> Recording:
    rng = np.random.default_rng(1)
    turns = np.full((len(TIMES), 1, 4), np.nan)
    return Recording(
        tuple(
            Run(f"r{k}", ("bob",), TIMES, (p + rng.normal(0, 1e-3, p.shape))[:, None], turns)
            for k, p in enumerate(places)
        )
    )


def test_a_pendulum_of_another_length_is_found_from_its_angles() -> None:
    """Angles as an encoder on the hinge measures them, which says nothing of lengths."""
    length, places = 1.1, []
    for start in (0.3, 0.7, 1.2):
        swing = solve_ivp(lambda _, y: [y[1], -G / length * np.sin(y[0])], (0, 3), (start, 0), t_eval=TIMES, rtol=1e-9)
        angle = swing.y[0]
        places.append(LENGTH * np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], axis=1))
    offered = named(["length_error", "joint_damping", "quadratic_drag"])
    report = find_gap(pendulum_world(), recorded(places), candidates=offered)
    assert (report.verdict.kind, report.names) == ("identified", ("length_error",))
    (unknown,) = effects_of(report.verdict.best)[0]["unknowns"].values()
    inertia = 1.0 + 0.4 * (0.05 / LENGTH) ** 2  # the world's bob is no point
    assert -unknown["value"] == pytest.approx(G * LENGTH / length * inertia, rel=1e-3)


@pytest.mark.benchmark  # the same search as of the pendulum
def test_a_spring_of_another_stiffness_is_found() -> None:
    stiffness, places = 31.0, []
    for k, size in enumerate((0.1, 0.2, 0.3)):
        along = size * np.cos(np.sqrt(stiffness / MASS) * TIMES + k)
        places.append(np.stack([along, 0 * along, 0 * along], axis=1))
    offered = named(["stiffness_error", "linear_drag"])
    report = find_gap(SPRUNG, recorded(places), candidates=offered)
    assert (report.verdict.kind, report.names) == ("identified", ("stiffness_error",))
    assert read_parameter(report.world, "joints.coil.stiffness") == pytest.approx(stiffness, rel=1e-3)
