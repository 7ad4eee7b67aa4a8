"""Answers of an ensemble are right as often as they claim: worlds drawn at random, fitted to noisy tracks, and asked
questions whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.world_fit import (
    FitProblem,
    SearchSettings,
    default_unknowns,
    multistart,
    sample_posterior,
)
from polyworld.probing.ensemble import member_worlds, roll_out_members
from polyworld.solver.rollout import rollout
from polyworld.world import Environment, MotionPlane, TimeBase, World
from polyworld.world.parameters import with_parameters
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Cylinder
from tests.polyworld.sliding_block import fitted_block, stopping_distance

FRAMES, FRAME, SIGMA, MEMBERS = 16, 0.04, 0.004, 40
LATER = 2.0  # [s] when it is asked where the pucks are
NEAR = 1.3  # standard deviations of the prediction within which the lines are drawn
# Of how many standard errors a share may depart, and the Brier score from that of a calibrated forecast.
ERRORS, BRIER = 3.0, 0.05


class Claims:
    """Probabilities with which questions were answered, and whether the answers were right."""

    def __init__(self) -> None:
        self.claimed: list[float] = []
        self.right: list[bool] = []

    def ask(self, ends: NDArray[np.float64], truth: float, rng: np.random.Generator) -> None:
        """Ask whether the true end lies beyond a line drawn near the members' ends (N,)."""
        line = float(np.median(ends)) + NEAR * float(ends.std()) * rng.normal()
        probability = float((ends > line).mean())
        self.claimed.append(max(probability, 1.0 - probability))
        self.right.append((truth > line) == (probability >= 0.5))

    def check(self) -> None:
        """Compare the share of right answers with the claims, in bands and as a whole."""
        p, hit = np.array(self.claimed), np.array(self.right, dtype=float)
        for low, high in ((0.5, 0.75), (0.75, 0.95), (0.95, 1.01)):
            chosen = (p >= low) & (p < high)
            mean = p[chosen].mean()
            error = np.sqrt(max(mean * (1.0 - mean), 0.01) / chosen.sum())
            assert abs(hit[chosen].mean() - mean) < ERRORS * error, f"{low} to {high}: {hit[chosen].mean()}"
        assert ((p - hit) ** 2).mean() == pytest.approx((p * (1.0 - p)).mean(), abs=BRIER)


@pytest.mark.benchmark
def test_where_a_block_stops_is_answered_as_surely_as_claimed() -> None:
    """Against v^2 / (2 mu g), from 0.3 s of a slide that goes on for longer."""
    rng, claims = np.random.default_rng(11), Claims()
    for _ in range(60):
        friction, speed = rng.uniform(0.1, 0.3), rng.uniform(0.8, 1.4)
        start, fitted, sample = fitted_block(friction, speed, rng)
        values = sample.overrides(MEMBERS)
        rollouts = roll_out_members(fitted, member_worlds(start, values, ()), values, 1.5)
        ends = np.array([r.trajectory.positions[-1, 0, 0] for r in rollouts])
        claims.ask(ends, stopping_distance(friction, speed), rng)
    claims.check()


def two_pucks() -> World:
    """A puck slides towards another one beside its path."""
    puck = {"representation": "rigid_planar", "shape": Cylinder(radius=0.1, half_height=0.05), "mass": 1.0}
    first = RigidObject(name="a", position=(0.0, 0.0, 0.05), velocity=(1.5, 0.0, 0.0), friction=0.15, **puck)
    second = RigidObject(name="b", position=(0.6, 0.05, 0.05), friction=0.15, **puck)
    return World(
        objects=(first, second),
        environment=Environment(motion_plane=MotionPlane()),
        time=TimeBase(seconds_per_frame=FRAME, frame_count=FRAMES, substep=0.004),
    )


@pytest.mark.benchmark
def test_where_a_struck_puck_ends_is_answered_as_surely_as_claimed() -> None:
    """The collision is seen, the slide after it is not: speed, friction, restitution, mass and offset are unknown."""
    rng, claims = np.random.default_rng(3), Claims()
    for _ in range(24):
        ranges = {
            "a.velocity.x": (1.2, 1.8),
            "a.friction": (0.05, 0.3),
            "b.friction": (0.05, 0.3),
            "a.restitution": (0.3, 0.9),
            "b.restitution": (0.3, 0.9),
            "b.mass": (0.5, 2.0),
            "b.position.y": (-0.12, 0.12),
        }
        drawn = {f"objects.{name}": rng.uniform(*limits) for name, limits in ranges.items()}
        true = rollout(with_parameters(two_pucks(), drawn), LATER).trajectory
        places = true.positions[:FRAMES] + SIGMA * rng.normal(size=(FRAMES, 2, 3)) * np.array([1.0, 1.0, 0.0])
        tracks = ObservedTracks(
            names=("a", "b"),
            frames=np.arange(FRAMES),
            seconds_per_frame=FRAME,
            positions=places,
            position_sigma=np.full((FRAMES, 2), SIGMA),
            orientations=np.full((FRAMES, 2, 4), np.nan),
            confidence=np.ones((FRAMES, 2)),
            orientation_confidence=np.zeros((FRAMES, 2)),
            symmetry=(0, 0),
        )
        start = with_parameters(two_pucks(), {"objects.b.position.y": float(places[:5, 1, 1].mean())})
        unknowns = default_unknowns(start, tracks, shared=(), each=("friction", "restitution", "mass"))
        problem = FitProblem(start, tracks, unknowns)
        results = [found.best for found in multistart(problem, SearchSettings(generations=8, seed=1), 2)]
        sample = sample_posterior(problem, results, count=MEMBERS, seed=int(rng.integers(2**31)))
        assert sample is not None
        values = sample.overrides(MEMBERS)
        rollouts = roll_out_members(results[0].world, member_worlds(start, values, ()), values, LATER)
        ends = np.array([r.trajectory.positions[-1, 1] for r in rollouts])
        for axis in (0, 1):
            claims.ask(ends[:, axis], float(true.positions[-1, 1, axis]), rng)
    claims.check()
