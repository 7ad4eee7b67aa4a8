"""What a user sees at a Python prompt: results in a few lines, fits of chosen constants, figures."""

from __future__ import annotations

import json
from xml.etree import ElementTree

import numpy as np
import pytest

from polyworld import FitOptions, Recording, Study, World, fit, plot, rollout
from polyworld.data.recording import Run
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere

GRAVITY, DAMPING = 9.81, 0.4  # [m/s^2], [1/s]


def thrown(name: str, velocity: tuple[float, float, float], seed: int) -> Run:
    """Return a ball thrown from the origin under linear damping, in closed form, with 1 mm of noise."""
    t = np.arange(0.0, 0.8, 0.02)[:, None]
    terminal = np.array([0.0, 0.0, -GRAVITY / DAMPING])
    places = terminal * t + (np.array(velocity) - terminal) * (1.0 - np.exp(-DAMPING * t)) / DAMPING
    noise = np.random.default_rng(seed).normal(scale=1e-3, size=places.shape)
    return Run(name, ("ball",), t[:, 0], (places + noise)[:, None], np.full((len(t), 1, 4), np.nan))


@pytest.fixture(scope="module")
def recording() -> Recording:
    return Recording((thrown("low", (3.0, 0.0, 3.0), 1), thrown("high", (1.0, 1.0, 5.0), 2)))


@pytest.fixture(scope="module")
def ball() -> World:
    return World(objects=(RigidObject(name="ball", shape=Sphere(radius=0.05), position=(0.0, 0.0, 0.0)),))


def test_a_chosen_constant_is_fitted_to_a_recording(ball: World, recording: Recording) -> None:
    found = fit(Study.of(ball, recording), FitOptions(only=("objects.ball.linear_damping",), share=0.0))
    (constant,) = found.constants
    assert constant.interval[0] < 1.05 * DAMPING
    assert constant.interval[1] > 0.95 * DAMPING
    assert constant.value == pytest.approx(DAMPING, rel=0.05)
    text = found.summary()
    assert f"{constant.value:.4g} 1/s" in text
    assert all(f"run {name}: off by" in text for name in ("low", "high"))
    assert repr(found) == text
    written = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert written["constants"][0]["value"] == constant.value
    assert [run["run"] for run in written["runs"]] == ["low", "high"]
    assert World.model_validate(written["runs"][0]["world"]).id == found.runs[0].world.id
    table = ElementTree.fromstring(found._repr_html_())
    assert table.findtext("caption") == text.splitlines()[0]
    assert table.findtext("tr/td") == constant.unknown.name


def test_a_constant_that_is_not_there_names_the_choices(ball: World, recording: Recording) -> None:
    with pytest.raises(ValueError, match=r"no constant 'friktion' to fit; there are: .*objects\.ball\.linear_damping"):
        fit(Study.of(ball, recording), FitOptions(only=("friktion",)))


def test_results_are_short_at_the_prompt(ball: World, recording: Recording) -> None:
    run = rollout(ball, 1.0)
    assert repr(run).splitlines()[1].strip().startswith("ball: (0, 0, 0) to (0, 0, -4.9")
    assert "completed; 26 samples, 0 events" in repr(run)
    assert len(repr(run.trajectory)) < 100
    assert repr(recording) == "Recording of 2 runs: Run('low': ball; 40 instants, 0 to 0.78 s), " + (
        "Run('high': ball; 40 instants, 0 to 0.78 s)"
    )


def test_a_rollout_is_written_as_json(ball: World) -> None:
    later = ball.objects[0].model_copy(update={"name": "later", "start_time": 0.1, "position": (1.0, 0.0, 0.0)})
    run = rollout(ball.model_copy(update={"objects": (*ball.objects, later)}), 0.2)
    written = json.loads(json.dumps(run.to_dict(), allow_nan=False))
    np.testing.assert_array_equal([row[0] for row in written["positions"]], run.trajectory.positions[:, 0])
    assert written["positions"][0][1] == [None] * 3, "it is not there yet"
    assert written["times"] == run.trajectory.times.tolist()
    assert written["times"][1] == 0.04
    assert ElementTree.fromstring(run._repr_html_()).findtext("tr/td") == "ball"


def test_a_figure_holds_simulated_lines_and_measured_dots(ball: World, recording: Recording) -> None:
    run = rollout(ball, 0.8)
    panels = plot(run, recording.runs[0]).axes
    assert [panel.get_ylabel() for panel in panels] == ["x [m]", "y [m]", "z [m]"]
    line, dots = panels[2].lines
    assert np.array_equal(line.get_ydata(), run.trajectory.positions[:, 0, 2])
    assert np.array_equal(dots.get_ydata(), recording.runs[0].positions[:, 0, 2])
    other = Run("other", ("cube",), np.zeros(1), np.zeros((1, 1, 3)), np.full((1, 1, 4), np.nan))
    with pytest.raises(ValueError, match="the rollout holds"):
        plot(run, other)
