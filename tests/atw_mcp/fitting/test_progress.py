"""Reports of a fit while it runs: steps, errors with units, the best so far; and the curve that its record keeps."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from atw_mcp.calls.error_curve import MOST_POINTS, ErrorCurve, in_words
from atw_mcp.calls.jobs import Progress
from atw_mcp.fitting.fitting import FitRequest, FitRun, chosen_parameters, digest, run_fit
from polyworld.estimation.world_fit.problem import FitProblem
from tests.polyworld.estimation.world_fit.closed_form import observe, thrown_ball

LINE = re.compile(
    r"(generation \d+ of 6|refining, iteration \d+|start 1 of at most 1, iteration \d+|[a-z ]+, iteration \d+), "
    r"error [\d.]+ (m|mm|µm), best [\d.]+ (m|mm|µm)( over \d+ of 20 frames)?"
)


class Heard(Progress):
    """Keeps what is reported."""

    def note(self, done: float, total: float | None = None, message: str = "") -> None:
        super().note(done, total, message)
        self.__dict__.setdefault("heard", []).append((done, message))


def fitted(method: str) -> tuple[FitRun, list[tuple[float, str]], FitProblem]:
    """A ball thrown otherwise than its world says, fitted in few steps."""
    truth = thrown_ball()
    tracks = observe(truth, frames=20, sigma=0.01)
    ball = truth.objects[0].model_copy(update={"velocity": (1.5, 1.2, 2.5)})
    world = truth.model_copy(update={"objects": (ball,)})
    request = FitRequest(method=method, generations=6, population=16, each=(), shared=())  # type: ignore[arg-type]
    progress = Heard()
    run = run_fit(world, tracks, chosen_parameters(world, tracks, request), request, progress)
    return run, progress.__dict__["heard"], FitProblem(world, tracks, chosen_parameters(world, tracks, request))


@pytest.mark.parametrize("method", ["cem_refined", "prefixes"])
def test_a_fit_reports_regular_lines_and_keeps_its_curve(method: str) -> None:
    run, heard, _ = fitted(method)
    steps = [message for _, message in heard if "error" in message]
    assert steps
    assert all(LINE.fullmatch(message) for message in steps), steps
    shares = [share for share, _ in heard]
    assert shares == sorted(shares)
    assert shares[-1] <= 1.0
    assert run.curve is not None
    assert run.curve.count == len(steps)
    kept = digest(run)["curve"]
    assert json.loads(json.dumps(kept, allow_nan=False)) == kept
    assert kept["unit"] == "m"
    assert kept["steps"] == list(range(1, len(steps) + 1))
    # The last best is the error of the world that the fit returns, as its own report measures it.
    assert run.result.accuracy is not None
    assert kept["best"][-1] == pytest.approx(run.result.accuracy.position, rel=1e-4)


def test_the_error_of_a_trial_is_its_rms_distance_and_losses_are_as_before() -> None:
    _, _, problem = fitted("cem")
    at = problem.space.mean[None]
    judged = problem.judged(at, problem.samples)
    assert np.array_equal(judged.losses, problem.losses(at, problem.samples))
    result = problem.finish("refine", "completed", at[0], None, [], 0)
    assert result.accuracy is not None
    assert judged.errors[0] == pytest.approx(result.accuracy.position, rel=1e-6)


def test_a_long_curve_is_thinned_and_keeps_its_course() -> None:
    curve = ErrorCurve("generation", "m")
    for number in range(1, 2001):
        curve.add(1.0 / number, float("nan") if number == 1 else 1.0 / number)
    drawn = curve.to_dict()
    assert len(drawn["steps"]) <= MOST_POINTS
    assert drawn["steps"][0] == 1
    assert drawn["steps"][-1] > 1980
    assert drawn["best"][0] is None
    assert drawn["current"] == pytest.approx([1.0 / step for step in drawn["steps"]], rel=1e-5)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(0.00312, "m", "3.12 mm"), (12.3, "m", "12.3 m"), (4.2e-7, "m", "420 nm"), (1.0434, "sigma", "1.04 sigma"),
     (float("nan"), "m", "diverged"), (0.0, "m", "0 m")],
)  # fmt: skip
def test_errors_are_said_with_a_prefix(value: float, unit: str, text: str) -> None:
    assert in_words(value, unit) == text
