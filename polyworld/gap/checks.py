"""Hold the program's own checks against a name: each that contradicts it lowers the verdict by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from polyworld.estimation.criteria import held_out_gain
from polyworld.gap.decide import Kind, Verdict
from polyworld.gap.held_out import HeldOutGap
from polyworld.gap.null_control import NullControl
from polyworld.gap.search_loop import Searched
from polyworld.gap.settings import DecisionSettings
from polyworld.gap.stability import names_of


@dataclass(frozen=True)
class Check:
    """A check that contradicts a name: what it is called, and what it found."""

    name: Literal[
        "null_control",
        "held_out",
        "held_out_remainder",
        "runner_up",
        "nothing_held_out",
        "time_limit",
    ]
    found: str


LOWERED: dict[str, dict[Kind, Kind]] = {
    # A name that held-out data refute is not given.
    "held_out": {"identified": "unexplained", "identified_with_remainder": "unexplained"},
    # What leaves only noise in the data fitted and half of the gap in others has not named what acts, if anything does.
    "held_out_remainder": {"identified": "unexplained", "nothing_missing": "unexplained"},
    # A procedure that finds effects in data without any proves nothing by finding one.
    "null_control": {"identified": "ambiguous", "identified_with_remainder": "unexplained"},
    # A competitor that was not fitted is not excluded.
    "time_limit": {"identified": "ambiguous", "identified_with_remainder": "unexplained"},
    "runner_up": {"identified": "ambiguous", "identified_with_remainder": "ambiguous"},
    "nothing_held_out": {"identified": "ambiguous", "identified_with_remainder": "ambiguous"},
}


def lowered(kind: Kind, checks: Sequence[Check]) -> Kind:
    """Return the verdict after the checks that contradict it."""
    for check in checks:
        kind = LOWERED[check.name].get(kind, kind)
    return kind


def contradictions(
    found: Searched,
    verdict: Verdict,
    gap: HeldOutGap | None,
    null: NullControl | None,
    settings: DecisionSettings,
) -> list[Check]:
    """Return the checks that contradict the verdict. gap: of held-out data, None where nothing was held out."""
    best, other = verdict.best, verdict.runner_up
    if verdict.kind == "nothing_missing":
        refuted = None if gap is None else gap.contradicts
        return [] if refuted is None else [Check("held_out_remainder", refuted)]
    if best is None or verdict.kind not in ("identified", "identified_with_remainder"):
        return []
    checks = []
    incomplete = found.limited and verdict.kind == "identified_with_remainder"
    if not found.competitors_fitted or incomplete:
        missing = "further effect beside it" if incomplete and found.competitors_fitted else "effect in question"
        checks.append(Check("time_limit", f"the time ran out before every {missing} was fitted"))
    if null is not None and null.verdict != "nothing_missing":
        checks.append(Check("null_control", f"the same search names effects ({null.verdict}) where none is missing"))
    if "dropped_frames" in best.hypothesis.names:
        return checks  # no other run can confirm what happened in one
    if gap is not None and gap.gap_after**2 > gap.gap_before**2 + gap.noise_floor**2:  # by more than the noise
        checks.append(
            Check("held_out", f"sealed data get worse: {gap.gap_before:.3g} -> {gap.gap_after:.3g} {gap.unit}")
        )
    elif gap is not None and verdict.kind == "identified" and gap.contradicts is not None:
        checks.append(Check("held_out_remainder", gap.contradicts))
    if verdict.kind == "identified" and other is not None and other.ebic_behind < settings.reach:
        names = names_of(other.trial)
        if not set(names_of(best)) <= set(names):
            text = f"{' + '.join(names)} is only {other.ebic_behind:.2g} behind in the extended BIC"
            checks.append(Check("runner_up", text))
    if gap is None and verdict.stability is None:  # which compares predictions of runs left out itself
        folds = len(best.held_out)
        gain = held_out_gain(best.held_out, found.ground.held_out)
        if folds < 2 or gain.gain * folds <= settings.decisive or not gain.exceeds(settings.clearly):
            parts = "later parts" if len(found.context.design.runs) == 1 else "the other runs"
            text = f"nothing was held out, and {parts} are not predicted decisively better"
            checks.append(Check("nothing_held_out", text))
    return checks
