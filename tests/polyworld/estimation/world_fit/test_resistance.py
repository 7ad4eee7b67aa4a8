"""The law of resistance that the evidence chooses is the one that made the tracks: closed formulas, SciPy, noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.world_fit import (
    FitProblem,
    FitResult,
    PrefixSettings,
    choose_resistance,
    default_unknowns,
    fit_by_prefixes,
    laws_of_resistance,
    plausible_unknowns,
    with_supports,
)
from polyworld.world import World
from polyworld.world.representations.joint import Hinge, Slider
from tests.polyworld.estimation.world_fit.floor_scenes import (
    GRAVITY,
    RADIUS,
    ball,
    box,
    frames,
    rolling_deceleration,
    scene,
    slowed,
    thrown,
    tracks_of,
    upright,
)

Array = NDArray[np.float64]


def chosen(world: World, tracks: ObservedTracks) -> tuple[FitResult, set[str]]:
    """Fit a world as FitWorld does, and add laws of resistance by evidence: the fit, and the laws kept."""
    unknowns = plausible_unknowns(world, tracks, default_unknowns(world, tracks, shared=()))
    problem = FitProblem(world, tracks, unknowns)
    best = fit_by_prefixes(problem, PrefixSettings(starts=1))[0]
    laws = laws_of_resistance(world, tracks, {path for u in unknowns for path in u.paths})
    _, best, tested = choose_resistance(problem, best, laws)
    return best.best, {law.name for law in tested if law.kept}


def test_a_box_that_slides_to_rest_has_friction_alone() -> None:
    """mu g stops it; the clip ends before it rests."""
    mu = 0.25
    tracks = tracks_of({"box": slowed(frames(24), 2.2, mu * GRAVITY)}, orientations={"box": upright(24)})
    result, kept = chosen(with_supports(scene([box()], tracks), tracks), tracks)
    assert kept == set()
    assert result.by_name["box.friction"] == pytest.approx(mu, abs=0.02)


@pytest.mark.parametrize("lever", [0.002, 0.01])
def test_a_ball_that_rolls_to_rest_has_rolling_resistance_alone(lever: float) -> None:
    tracks = tracks_of({"ball": slowed(frames(40), 0.8, rolling_deceleration(lever))}, sigma=0.001)
    result, kept = chosen(with_supports(scene([ball(friction=0.5)], tracks), tracks), tracks)
    assert kept == set()
    assert result.by_name["ball.rolling_resistance"] == pytest.approx(lever, abs=0.1 * lever + 2e-4)


@pytest.mark.parametrize(
    ("viscous", "quadratic", "law"),
    [(0.8, 0.0, "linear_damping"), (0.0, 0.3, "quadratic_damping"), (0.0, 0.0, None)],
)
def test_air_resists_a_throw_as_speed_its_square_or_not_at_all(
    viscous: float, quadratic: float, law: str | None
) -> None:
    tracks = tracks_of({"ball": thrown(frames(30), (6.0, 1.0, 5.0), viscous, quadratic)})
    result, kept = chosen(scene([ball()], tracks, statics=()), tracks)
    assert kept == (set() if law is None else {law})
    if law == "linear_damping":
        assert result.by_name["linear_damping"] == pytest.approx(viscous, rel=0.1)
    if law == "quadratic_damping":
        assert result.by_name["air_resistance"] == pytest.approx(quadratic, rel=0.1)


def test_a_law_shows_below_a_noise_that_was_stated_three_times_too_large() -> None:
    tracks = tracks_of({"ball": thrown(frames(30), (6.0, 1.0, 5.0), 0.3, 0.0)})
    tracks = replace(tracks, position_sigma=3.0 * tracks.position_sigma)
    result, kept = chosen(scene([ball()], tracks, statics=()), tracks)
    assert kept == {"linear_damping"}
    assert result.by_name["linear_damping"] == pytest.approx(0.3, rel=0.1)


def test_a_world_that_gets_a_law_is_another_world() -> None:
    """Draws from the posterior are set in the world with the law, which is found by its id."""
    tracks = tracks_of({"ball": thrown(frames(20), (2.0, 0.0, 3.0), 0.0, 0.0)})
    world = scene([ball()], tracks, statics=())
    known = world.id
    (law,) = [law for law in laws_of_resistance(world, tracks, set()) if law.name == "quadratic_damping"]
    assert law.world.id != known
    assert law.world.id == World.model_validate_json(law.world.model_dump_json()).id
    assert world.id == known


def cart(viscous: float, dry: float, times: Array) -> Array:
    """Places (T, 3) of a cart on a track, slowed by c v and by a constant force; it does not turn back."""

    def rates(_: float, state: Array) -> list[float]:
        return [state[1], -viscous * state[1] - dry if state[1] > 0.0 else 0.0]

    solved = solve_ivp(rates, (0.0, times[-1]), [0.0, 1.5], t_eval=times, rtol=1e-8, max_step=0.01)
    return np.stack([solved.y[0], np.zeros_like(times), np.full_like(times, RADIUS)], axis=1)


@pytest.mark.parametrize(("viscous", "dry", "law"), [(0.7, 0.0, "track.damping"), (0.0, 0.6, "track.friction")])
def test_a_cart_is_slowed_by_a_viscous_or_a_dry_track(viscous: float, dry: float, law: str) -> None:
    tracks = tracks_of({"box": cart(viscous, dry, frames(35))}, orientations={"box": upright(35)}, sigma=0.001)
    track = Slider(name="track", object="box", anchor=(0.0, 0.0, RADIUS), axis=(1.0, 0.0, 0.0))
    result, kept = chosen(scene([box(mass=1.0)], tracks, statics=(), joints=(track,)), tracks)
    assert kept == {law}
    assert result.by_name[law] == pytest.approx(viscous + dry, rel=0.1)  # at a mass of 1 kg


def test_a_pendulum_keeps_the_damping_of_its_hinge() -> None:
    """I phi'' = -m g l sin(phi) - d phi' with I = m l^2 + 2/5 m R^2."""
    arm, damping = 0.6, 0.15
    inertia = arm**2 + 0.4 * RADIUS**2

    def rates(_: float, state: Array) -> list[float]:
        return [state[1], (-GRAVITY * arm * np.sin(state[0]) - damping * state[1]) / inertia]

    times = frames(60)
    angle = solve_ivp(rates, (0.0, times[-1]), [0.6, 0.0], t_eval=times, rtol=1e-9).y[0]
    places = np.stack([arm * np.sin(angle), 0.0 * angle, 1.0 - arm * np.cos(angle)], axis=1)
    tracks = tracks_of({"ball": places})
    pivot = Hinge(name="pivot", object="ball", anchor=(0.0, 0.0, 1.0), axis=(0.0, 1.0, 0.0))
    result, kept = chosen(scene([ball(mass=1.0)], tracks, statics=(), joints=(pivot,)), tracks)
    assert "pivot.damping" in kept
    assert "pivot.friction" not in kept
    assert result.by_name["pivot.damping"] == pytest.approx(damping, rel=0.1)


def test_laws_that_a_fit_has_already_are_not_offered_again_nor_any_to_what_rests() -> None:
    tracks = tracks_of({"ball": thrown(frames(20), (2.0, 0.0, 3.0), 0.0, 0.0)})
    world = scene([ball()], tracks, statics=())
    assert {law.name for law in laws_of_resistance(world, tracks, set())} == {"linear_damping", "quadratic_damping"}
    left = laws_of_resistance(world, tracks, {"objects.ball.linear_damping"})
    assert {law.name for law in left} == {"quadratic_damping"}
    still = tracks_of({"ball": np.tile([0.0, 0.0, RADIUS], (20, 1))})
    assert laws_of_resistance(scene([ball()], still), still, set()) == []
