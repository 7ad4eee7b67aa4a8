"""Fits of a forward model in closed form: what is found, how well it is known, and how a fit can be stopped."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from polyworld.estimation.world_fit import (
    CemSettings,
    FitProblem,
    ObjectiveSettings,
    SearchProgress,
    SearchSettings,
    Unknown,
    fit,
    fit_by_random_search,
    refine,
)
from polyworld.estimation.world_fit.search import stages
from polyworld.world import World
from polyworld.world.parameters import with_parameters
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere
from tests.polyworld.estimation.world_fit.closed_form import ClosedForm, observe, thrown_ball

TRUTH = {
    "position.x": 0.0,
    "position.z": 1.0,
    "velocity.x": 2.0,
    "velocity.z": 3.0,
    "linear_damping": 0.5,
    "angular_velocity.z": 2.0,
}


def unknowns() -> list[Unknown]:
    path = "objects.ball.".__add__
    return [
        Unknown("position.x", (path("position.x"),), "", 0.05, -0.2, 0.2, 0.05),
        Unknown("position.z", (path("position.z"),), "", 1.05, 0.8, 1.2, 0.05),
        Unknown("velocity.x", (path("velocity.x"),), "", 1.8, 1.0, 3.0, 0.3),
        Unknown("velocity.z", (path("velocity.z"),), "", 3.3, 2.0, 4.0, 0.3),
        Unknown("linear_damping", (path("linear_damping"),), "", 0.8, 0.0, 2.0, 0.5),
        Unknown("angular_velocity.z", (path("angular_velocity.z"),), "", 1.0, 0.0, 4.0, 1.0),
    ]


def wrong_world() -> World:
    changed = {"objects.ball.velocity.x": 1.8, "objects.ball.linear_damping": 0.8}
    return with_parameters(thrown_ball(), changed)


def problem(tracks, parameters=None, **given) -> FitProblem:
    return FitProblem(wrong_world(), tracks, parameters or unknowns(), make_simulator=ClosedForm, **given)


def run(tracks, parameters=None, *, generations=60, seed=0, **given):
    return fit(problem(tracks, parameters, **given), SearchSettings(generations=generations, seed=seed))


def test_cem_recovers_the_truth_within_its_stated_errors() -> None:
    stated = ObjectiveSettings(rotation_sigma=0.05)
    result = run(observe(thrown_ball(), frames=60), generations=60, objective=stated)
    for name, true in TRUTH.items():
        found = result.value(name)
        assert abs(found.value - true) < 4.0 * found.standard_error, name
        assert found.standard_error < 0.2 * (found.bounds[1] - found.bounds[0]), name
    assert result.loss == pytest.approx(1.0, abs=0.3)
    assert result.loss < 0.1 * result.loss_start
    assert result.undetermined == () or all("not fitted" in u.reason for u in result.undetermined)
    assert 60 * 64 <= result.rollouts <= 60 * 64 + 3


def test_found_loss_is_no_worse_than_that_of_the_truth() -> None:
    tracks = observe(thrown_ball(), frames=60)
    truth = refine(FitProblem(thrown_ball(), tracks, unknowns(), make_simulator=ClosedForm), TRUTH, iterations=1)
    at_truth = fit(
        FitProblem(thrown_ball(), tracks, unknowns(), make_simulator=ClosedForm), SearchSettings(generations=1)
    ).loss_start
    found = run(tracks, generations=60)
    assert truth.loss <= at_truth
    # A minimum over 6 parameters lies below the truth by about 6 / (60 x 6) of the noise level.
    assert found.loss < at_truth + 0.02


def test_stated_errors_are_those_of_repeated_experiments() -> None:
    # 24 data sets with independent noise: the scatter of the estimates is what the errors claim.
    z = []
    for seed in range(24):
        result = refine(
            FitProblem(
                thrown_ball(), observe(thrown_ball(), frames=40, seed=seed), unknowns(), make_simulator=ClosedForm
            ),
            TRUTH,
        )
        z.append([(v.value - TRUTH[v.name]) / v.standard_error for v in result.values])
    scatter = np.sqrt(np.mean(np.square(z), axis=0))
    # chi distribution with 24 degrees of freedom: 0.6 to 1.45 holds 99.9% per parameter
    assert np.all((scatter > 0.55) & (scatter < 1.5)), scatter


def test_correlated_noise_widens_the_errors() -> None:
    world = thrown_ball()
    white = observe(world, frames=120, seed=4)
    truth = ClosedForm(world, white.times, n_worlds=1).run().world(0).positions
    noise = white.positions - truth
    slow = np.zeros_like(noise)
    for t in range(1, len(noise)):  # first-order autoregression with the same variance
        slow[t] = 0.9 * slow[t - 1] + np.sqrt(1 - 0.81) * noise[t]
    coloured = replace(white, positions=truth + slow)
    fits = [refine(FitProblem(world, t, unknowns(), make_simulator=ClosedForm), TRUTH) for t in (white, coloured)]
    assert fits[0].correlation_time < 2.0 < fits[1].correlation_time
    assert fits[1].value("velocity.x").standard_error > 1.5 * fits[0].value("velocity.x").standard_error


def test_refine_takes_fewer_rollouts_to_the_same_minimum() -> None:
    tracks = observe(thrown_ball(), frames=60)
    searched = run(tracks, generations=60)
    polished = refine(problem(tracks))
    assert polished.loss <= searched.loss
    assert polished.rollouts < 0.1 * searched.rollouts
    assert polished.method == "refine"


def test_random_search_spends_the_same_budget_and_does_worse() -> None:
    tracks = observe(thrown_ball(), frames=60)
    settings = SearchSettings(generations=30)
    ours = fit(problem(tracks), settings)
    theirs = fit_by_random_search(problem(tracks), settings)
    assert theirs.rollouts <= ours.rollouts <= theirs.rollouts + 3  # CEM's contenders are judged once more
    assert ours.loss < theirs.loss < ours.loss_start


def test_seconds_per_frame_is_found_where_gravity_gives_the_scale() -> None:
    world = thrown_ball()
    tracks = replace(observe(world, frames=40), seconds_per_frame=1.0 / 25.0)
    guess = with_parameters(world, {"time.seconds_per_frame": 0.03})
    time_base = Unknown("seconds_per_frame", ("time.seconds_per_frame",), "", 0.03, 0.01, 0.1, 0.3, scale="log")
    result = fit(
        FitProblem(guess, tracks, [*unknowns(), time_base], make_simulator=ClosedForm), SearchSettings(generations=80)
    )
    found = result.value("seconds_per_frame")
    assert abs(found.value - 0.04) < 4.0 * found.standard_error
    assert found.value == pytest.approx(0.04, rel=0.03)
    assert result.world.time.seconds_per_frame == found.value


def test_one_value_is_given_to_all_its_paths() -> None:
    ball = thrown_ball().objects[0]
    other = RigidObject(
        name="other", shape=Sphere(radius=0.1), position=(5, 0, 1), velocity=(1, 0, 3), linear_damping=0.5
    )
    world = World(objects=(ball, other), time=thrown_ball().time)
    tied = Unknown("damping", ("objects.ball.linear_damping", "objects.other.linear_damping"), "", 1.0, 0.0, 2.0, 0.5)
    result = fit(
        FitProblem(world, observe(world, frames=60), [tied], make_simulator=ClosedForm), SearchSettings(generations=20)
    )
    assert [o.linear_damping for o in result.world.objects] == [result.value("damping").value] * 2
    assert result.value("damping").value == pytest.approx(0.5, abs=4 * result.value("damping").standard_error)


def test_a_prior_pulls_by_its_weight_against_the_data() -> None:
    # One parameter, linear in the data: the posterior mean is the precision-weighted mean.
    world = thrown_ball(linear_damping=0.0)
    tracks = observe(world, frames=10, turn_sigma=0.0)
    free = Unknown("v", ("objects.ball.velocity.x",), "", 2.0, 0.0, 4.0, 0.5)
    held = replace(free, prior=(2.5, 0.02))
    squares = ObjectiveSettings(huber=np.inf)
    alone, pulled = (
        refine(FitProblem(world, tracks, [p], objective=squares, make_simulator=ClosedForm)).value("v")
        for p in (free, held)
    )
    precision = (tracks.times**2).sum() / 0.01**2
    expected = (precision * alone.value + 2.5 / 0.02**2) / (precision + 1 / 0.02**2)
    assert pulled.value == pytest.approx(expected, abs=1e-3)
    assert alone.value == pytest.approx(2.0, abs=4.0 / np.sqrt(precision))


def test_what_the_data_cannot_determine_is_named_with_the_reason() -> None:
    tracks = observe(thrown_ball(), frames=60)
    blind = Unknown("bounce", ("objects.ball.restitution",), "", 0.5, 0.0, 1.0, 0.2)
    both = [
        Unknown("gravity", ("environment.gravity.y",), "", 0.1, -1.0, 1.0, 0.3),
        Unknown("vy", ("objects.ball.velocity.y",), "", 1.0, 0.0, 2.0, 0.2),
    ]
    result = run(tracks, [*unknowns(), blind, *both], generations=30)
    reasons = {u.parameters: u.reason for u in result.undetermined}
    assert reasons[("bounce",)] == "no contact involving ball in the observed frames"
    assert not any("vy" in names for names in reasons)
    # Two frames determine a displacement: of velocity and acceleration only a combination.
    short = observe(thrown_ball(), frames=2, sigma=0.001)
    result = fit(FitProblem(thrown_ball(), short, both, make_simulator=ClosedForm), SearchSettings(generations=5))
    assert ("gravity",) in {u.parameters for u in result.undetermined}


def test_a_pair_known_only_together_is_reported_as_a_pair() -> None:
    # Without gravity's scale, and without damping, time and velocity enter as their product.
    world = thrown_ball(linear_damping=0.0, angular_damping=0.0)
    world = world.model_copy(update={"environment": world.environment.model_copy(update={"gravity": (0.0, 0.0, 0.0)})})
    parameters = [
        Unknown("seconds_per_frame", ("time.seconds_per_frame",), "", 0.04, 0.02, 0.08, 0.2, scale="log"),
        *(
            Unknown(f"{kind}.{a}", (f"objects.ball.{kind}.{a}",), "", 2.0, 0.5, 6.0, 0.5)
            for kind, a in (("velocity", "x"), ("velocity", "y"), ("velocity", "z"), ("angular_velocity", "z"))
        ),
    ]
    result = refine(FitProblem(world, observe(world, frames=60), parameters, make_simulator=ClosedForm))
    groups = [u.parameters for u in result.undetermined if "combination" in u.reason]
    assert any("seconds_per_frame" in g and len(g) >= 3 for g in groups), result.undetermined


def test_held_out_frames_judge_and_do_not_inform() -> None:
    world = thrown_ball()
    tracks = observe(world, frames=60)
    spoiled = tracks.positions.copy()
    spoiled[45:] += 100.0
    fits = [run(t, generations=20, holdout_from=45) for t in (tracks, replace(tracks, positions=spoiled))]
    assert [v.value for v in fits[0].values] == [v.value for v in fits[1].values]
    assert fits[0].fitted_frames == (0, 44)
    assert fits[0].held_out is not None
    assert fits[0].held_out.position < 0.1 < fits[0].held_out_start.position
    assert fits[1].held_out.position == pytest.approx(100.0 * np.sqrt(3.0), rel=0.01)


def test_a_cancelled_fit_returns_the_best_found_so_far() -> None:
    kept: list[SearchProgress] = []
    settings = SearchSettings(generations=12)
    stopped = fit(problem(observe(thrown_ball())), settings, progress=kept.append, cancelled=lambda: len(kept) >= 7)
    assert stopped.status == "cancelled"
    assert len(stopped.history) == 7
    assert stopped.loss <= stopped.loss_start


def test_equal_seeds_give_equal_worlds_and_results_are_json() -> None:
    tracks = observe(thrown_ball())
    one, same, other = (run(tracks, generations=5, seed=s) for s in (1, 1, 2))
    assert one.world.id == same.world.id != other.world.id
    text = json.dumps(one.to_dict(), allow_nan=False)
    assert json.loads(text)["seed"] == 1


def test_the_search_starts_short_and_ends_on_the_whole_horizon() -> None:
    result = run(observe(thrown_ball(), frames=40), generations=20)
    lengths = [p.samples for p in result.history]
    assert lengths[0] == 5
    assert lengths[-1] == 40
    assert lengths == sorted(lengths)
    assert lengths.count(40) == 8


def test_a_parameter_waits_for_the_horizon_in_which_it_shows() -> None:
    tracks = observe(thrown_ball(), frames=40)
    late = [replace(p, enters=1.0) if p.name == "linear_damping" else p for p in unknowns()]
    kept: list[SearchProgress] = []
    fit(
        FitProblem(wrong_world(), tracks, late, make_simulator=ClosedForm),
        SearchSettings(generations=20),
        progress=kept.append,
    )
    index = [p.name for p in late].index("linear_damping")
    means = [(k.samples, k.state.mean[index]) for k in kept]
    assert {m for samples, m in means if samples <= 20} == {0.8}
    assert len({m for samples, m in means if samples > 30}) > 1


def test_stages_share_all_generations() -> None:
    for count in (1, 2, 5, 60):
        plan = stages(128, SearchSettings(generations=count, horizon=(0.25, 0.5, 0.75, 1.0)))
        assert len(plan) == count
        assert plan == sorted(plan)
        assert plan[-1] == 128


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ([], "at least one parameter"),
        ([Unknown("a", ("objects.ball.friction",), "", 0.5, 0.0, 1.0, 0.1)] * 2, "repeated"),
        ([Unknown("a", ("objects.ball.friction",), "", 0.5, -1.0, 1.0, 0.1)], "exceed those of"),
    ],
)
def test_unsuitable_parameters_are_refused(parameters: list[Unknown], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        run(observe(thrown_ball()), parameters or [], generations=1) if parameters else fit(
            FitProblem(thrown_ball(), observe(thrown_ball()), [], make_simulator=ClosedForm)
        )


def test_an_unknown_path_names_the_choices() -> None:
    with pytest.raises(KeyError, match=r"objects\.ball\.friction"):
        run(observe(thrown_ball()), [Unknown("a", ("objects.ball.colour",), "", 0.5, 0.0, 1.0, 0.1)])


def test_a_holdout_outside_the_frames_is_refused() -> None:
    with pytest.raises(ValueError, match=r"1\.\.24"):
        run(observe(thrown_ball()), holdout_from=25)


def test_a_candidate_has_the_same_loss_alone_as_among_others() -> None:
    own = problem(observe(thrown_ball()))
    space = own.space
    drawn = np.random.default_rng(0).uniform(space.lower, space.upper, size=(9, len(space.mean)))
    alone = [own.losses(one[None], 20)[0] for one in drawn]
    assert own.losses(drawn, 20) == pytest.approx(alone, rel=1e-12)
    assert own.rollouts == 18


def test_fewer_elites_than_asked_cannot_be() -> None:
    with pytest.raises(ValueError, match="elites"):
        SearchSettings(cem=CemSettings(population=4, elites=8))
