"""Reports of a fit while it runs: steps, misfits, the best so far; and the curve that its record keeps."""

from __future__ import annotations

import json
import re

import pytest

from atw_mcp.calls.error_curve import MOST_POINTS, ErrorCurve, in_words
from atw_mcp.calls.jobs import Progress
from atw_mcp.fitting.fitting import FitInput, FitRequest, FitRun, digest, run_fit
from polyworld.estimation.fitted import Method
from tests.polyworld.estimation.closed_form import observe, thrown_ball

LINE = re.compile(r"(generation \d+ of 6|fitting [a-z ]+), misfit [\d.e+]+ sigma")


class Heard(Progress):
    """Keeps what is reported."""

    def note(self, done: float, total: float | None = None, message: str = "") -> None:
        super().note(done, total, message)
        self.__dict__.setdefault("heard", []).append((done, message))


def fitted(method: Method) -> tuple[FitRun, list[tuple[float, str]]]:
    """A ball thrown otherwise than its world says, fitted in few steps."""
    truth = thrown_ball()
    tracks = observe(truth, frames=20, sigma=0.01)
    ball = truth.objects[0].model_copy(update={"velocity": (1.5, 1.2, 2.5)})
    world = truth.model_copy(update={"objects": (ball,)})
    progress = Heard()
    request = FitRequest(method=method, generations=6, population=16)
    run = run_fit([FitInput("throw", world, tracks)], request, progress)
    return run, progress.__dict__["heard"]


@pytest.mark.parametrize("method", ["least_squares", "cem"])
def test_a_fit_reports_regular_lines_and_keeps_its_curve(method: Method) -> None:
    run, heard = fitted(method)
    steps = [message for _, message in heard if "misfit" in message]
    assert steps
    assert all(LINE.fullmatch(message) for message in steps), steps
    shares = [share for share, _ in heard]
    assert shares == sorted(shares)
    assert shares[-1] <= 1.0
    assert run.curve.count == len(steps)
    kept = digest(run, 0)["curve"]
    assert json.loads(json.dumps(kept, allow_nan=False)) == kept
    assert kept["unit"] == "sigma"
    assert kept["steps"] == list(range(1, len(steps) + 1))
    assert kept["best"] == kept["current"], "a descent ends at its best; the next one is of more frames"


def test_a_fit_that_is_cancelled_at_once_returns_what_it_has() -> None:
    progress = Heard()
    progress.cancel()
    run = run_fit([FitInput("throw", thrown_ball(), observe(thrown_ball(), frames=20))], FitRequest(), progress)
    assert digest(run, 0)["status"] == "cancelled"


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
