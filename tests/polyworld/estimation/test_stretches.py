"""Runs are cut where bodies collide, by whoever took part, and nowhere else: SciPy's pucks with noise."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.estimation.fit_settings import LinkSettings
from polyworld.estimation.stretches import Stretch, collisions, stretches
from tests.polyworld.estimation.pucks import CROSSING, FRAME, RADIUS, SIGMA, discs, tracks, world
from tests.scenes.discs import Started, slide

FRAMES = 40
LINKS = LinkSettings()
BYSTANDER = Started(
    np.concatenate([CROSSING.positions, [[0.0, 1.5]]]),
    np.concatenate([CROSSING.velocities, [[-0.9, 0.2]]]),
    np.zeros(3),
)


def path(count: int = 2, start: Started = CROSSING) -> np.ndarray:
    return slide(discs([0.12, 0.2, 0.15][:count]), start, np.arange(FRAMES) * FRAME)


def contact(start: Started, count: int) -> float:
    """When the first two are nearest [s], to a millisecond."""
    times = np.arange(0.0, 0.8, 1e-3)
    states = slide(discs([0.12, 0.2, 0.15][:count]), start, times)
    return float(times[np.argmin(np.hypot(*(states[:, 0, :2] - states[:, 1, :2]).T))])


@pytest.mark.parametrize("seed", range(6))
def test_a_collision_is_found_at_its_frame_and_by_those_who_met(seed: int) -> None:
    exact = path(3, BYSTANDER)
    found = collisions(world(3), tracks(exact, seed=seed), np.full(3, SIGMA), LINKS)
    assert [set(who) for _, who in found] == [{"a", "b"}]
    ((rows, _),) = found
    assert rows.start - 2 <= contact(BYSTANDER, 3) / FRAME <= rows.stop


@pytest.mark.parametrize("after", range(7))
def test_a_clip_that_ends_after_a_collision_is_not_cut_before_it(after: int) -> None:
    """Two parabolas that share out the jump otherwise may fit its last samples as well."""
    met = contact(CROSSING, 2) / FRAME
    for seed in range(6):
        seen = tracks(path(), seed=seed).window(0, round(met) + after)
        found = collisions(world(2), seen, np.full(2, SIGMA), LINKS)
        assert all(rows.start - 2 <= met <= rows.stop for rows, _ in found)
        assert found or after < 6


@pytest.mark.parametrize("seed", range(6))
def test_a_light_body_that_strikes_a_heavy_one_collides_though_the_heavy_one_hardly_jumps(seed: int) -> None:
    heavy = discs([0.1, 0.1], masses=[40.0, 1.0])
    exact = slide(heavy, CROSSING, np.arange(FRAMES) * FRAME)
    found = collisions(world(2), tracks(exact, seed=seed), np.full(2, SIGMA), LINKS)
    assert [set(who) for _, who in found] == [{"a", "b"}]


@pytest.mark.parametrize("seed", range(6))
def test_noise_friction_and_stopping_are_no_collision(seed: int) -> None:
    """One puck comes to rest, and two pass each other at 5 cm."""
    start = Started(
        np.array([[-0.75, 0.0], [0.75, 2.0 * RADIUS + 0.05]]), np.array([[1.0, 0.0], [-1.9, 0.0]]), np.zeros(2)
    )
    assert collisions(world(2), tracks(path(2, start), seed=seed), np.full(2, SIGMA), LINKS) == []


def cut(seed: int = 0) -> tuple[Stretch, ...]:
    return stretches(0, world(3), tracks(path(3, BYSTANDER), seed=seed), np.full(3, SIGMA), LINKS)


def test_stretches_hold_all_frames_but_those_of_the_contact_and_begin_where_tracks_do() -> None:
    before, after = cut()
    frames = [*before.tracks.frames, *(after.tracks.frames + round(after.begin / FRAME))]
    assert len(set(range(FRAMES)) - set(frames)) <= 2
    assert before.tracks.frames[-1] * FRAME < contact(BYSTANDER, 3) < after.begin
    assert after.begin == pytest.approx(FRAME * (frames[len(before.tracks.frames)]))
    assert after.world.time.origin == pytest.approx(after.begin)
    exact = path(3, BYSTANDER)[round(after.begin / FRAME)]
    for i, name in enumerate("abc"):
        assert after.world.object(name).position[:2] == pytest.approx(exact[i, :2], abs=4.0 * SIGMA)
        slow = np.linalg.norm(exact[i, 3:5]) < 0.3  # may be taken for rest
        assert after.world.object(name).velocity[:2] == pytest.approx(exact[i, 3:5], abs=0.3 if slow else 0.15)


def test_a_link_is_loose_for_those_who_met_by_their_jump_and_tight_for_others() -> None:
    before, after = cut()
    assert before.link is not None
    assert after.link is None
    assert before.link.time == pytest.approx(after.begin)
    assert before.link.place == {"a": LINKS.place, "b": LINKS.place, "c": LINKS.close}
    exact, met = path(3, BYSTANDER), round(after.begin / FRAME)
    jump = np.linalg.norm(exact[met, :2, 3:5] - exact[0, :2, 3:5], axis=1).max()  # with what friction took before
    assert before.link.velocity["a"] == pytest.approx(LINKS.jump * jump, rel=0.1)
    assert before.link.velocity["c"] == LINKS.near
