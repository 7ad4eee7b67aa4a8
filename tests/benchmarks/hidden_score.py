"""The scorer: verdicts against truths, case by case. It alone opens `truth.json`.

`python -m tests.benchmarks.hidden_score --public DIR --private DIR --out SCORES.json` writes one outcome a case that
was judged.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.hidden_cases import same_class
from tests.benchmarks.hidden_files import read_json, write_json

EXPONENT_CLOSE = 0.3
WALL_TURN, WALL_AWAY = np.cos(np.radians(15.0)), 0.15  # within which a wall found overlaps the true one
GAPLESS = frozenset({"dropped_frames"})  # effects that the held-out runs do not show


@dataclass
class Outcome:
    """Score of one verdict. None where a question does not arise.

    right: the truth's class named alone. decisive_wrong: one name, and not the truth's. covers, size: of the credible
    set, counted in classes. cpu_seconds: work of the process, which other processes do not lengthen. closed: share of
    the held-out gap beyond the noise, closed; closed_with_noise: the same with the noise in both gaps. inside: for each
    known parameter, whether its interval holds it. place: whether the place or onset found overlaps the true one.
    form: whether an unexplained force is described rightly.
    """

    case: str
    section: str
    noise: float
    kind: str
    design: str
    truth: list[str]
    sizes: list[float]
    verdict: str
    named: list[str]
    credible: list[list[str]]
    right: bool
    decisive_wrong: bool
    covers: bool
    size: int
    seconds: float | None
    cpu_seconds: float | None
    effects_count: int
    proposed: bool = False
    decides: bool | None = None
    resolved: bool | None = None
    second_verdict: str | None = None
    second_credible: list[list[str]] | None = None
    closed: float | None = None
    closed_with_noise: float | None = None
    inside: dict[str, bool] = field(default_factory=dict)
    place: bool | None = None
    form: bool | None = None
    expression: str | None = None
    error: str | None = None


def classes(names: Iterable[str], section: str) -> frozenset[frozenset[str]]:
    """Return a hypothesis, indistinguishable effects taken as one."""
    return frozenset(same_class(n, section) for n in names)


def hypotheses(report: dict[str, Any], section: str) -> list[frozenset[frozenset[str]]]:
    """Return the credible set in classes, without repetitions."""
    sets: Sequence[Sequence[str]] = report.get("credible_set") or []
    if not sets and report["verdict"] == "identified":
        sets = [[e["name"] for e in report["effects"]]]
    return list(dict.fromkeys(classes(s, section) for s in sets))


def judge_names(report: dict[str, Any], truths: Sequence[Sequence[str]], section: str) -> tuple[bool, bool, bool, int]:
    """right, decisive_wrong, covers, size; `truths` holds every set of names that is right, none for a null case."""
    true = [classes(t, section) for t in truths]
    if report["verdict"] not in ("identified", "ambiguous"):
        return (not true and report["verdict"] == "nothing_missing"), False, False, 0
    found = hypotheses(report, section)
    alone = len(found) == 1
    right = alone and found[0] in true
    return right, alone and not right, any(f in true for f in found), len(found)


def score(public: Path, private: Path) -> Outcome:
    """Return the outcome of one case."""
    truth, report = read_json(private / "truth.json"), read_json(public / "verdict.json")
    case = truth["case"]
    names = [e["name"] for e in truth["effects"]]
    outside = case["section"] == "outside"
    truths = truth["effects"][0]["form"]["allowed"] if outside else ([names] if names else [])
    right, wrong, covers, size = judge_names(report, truths, case["section"])
    found = Outcome(
        case=public.name,
        section=case["section"],
        noise=case["noise"],
        kind=case["kind"],
        design=f"{case['design']}, {case['runs']} runs, {case['rate']:g} Hz",
        truth=names,
        sizes=[e["size"] for e in truth["effects"]],
        verdict=report["verdict"],
        named=sorted(e["name"] for e in report["effects"]),
        credible=report.get("credible_set") or [],
        right=right,
        decisive_wrong=wrong,
        covers=covers,
        size=size,
        seconds=report.get("seconds"),
        cpu_seconds=report.get("cpu_seconds"),
        effects_count=len(names),
        proposed=bool(report.get("experiment")),
        error=report.get("error"),
    )
    if found.proposed:
        found.decides = report["experiment"].get("decides")
    more = public / "verdict_more.json"
    if more.exists():
        second = read_json(more)
        found.resolved = judge_names(second, truths, case["section"])[0]
        found.second_verdict, found.second_credible = second["verdict"], second.get("credible_set")
    if outside:
        found.form = right or (
            report["verdict"] == "unexplained" and form_is_right(truth["effects"][0]["form"], report)
        )
        found.expression = (report.get("residual_force") or {}).get("written")
    elif names and not GAPLESS & set(names):
        found.closed, found.closed_with_noise = closed_shares(report)
    if right and names and not outside:
        found.inside = intervals_hold(truth["effects"], report)
        found.place = place_overlaps(truth["effects"], report)
    return found


def closed_shares(report: dict[str, Any]) -> tuple[float, float] | tuple[None, None]:
    """Return the share of the held-out gap closed, beyond the noise and with it; none by a verdict without a world.

    None where the held-out runs show no gap beyond the noise.
    """
    held_out = report.get("sealed")
    if not held_out or held_out["gap_before"] is None or held_out["gap_after"] is None:
        return 0.0, 0.0
    before, after, floor = held_out["gap_before"], held_out["gap_after"], held_out["noise_floor"]
    if before <= 0.0:
        return None, None
    return 1.0 - after / before, 1.0 - float(np.hypot(after, floor) / np.hypot(before, floor))


def form_is_right(form: dict[str, Any], report: dict[str, Any]) -> bool:
    """Return whether the residual force has the exponent, direction and dependence that it should."""
    force = report.get("residual_force") or {}
    directions = " ".join(force.get("direction") or [])
    if form["direction"] not in directions or form["expression"] not in (force.get("expression") or ""):
        return False
    if form["exponent"] is None:
        return True
    return any(
        abs(x["value"] - form["exponent"]) < EXPONENT_CLOSE
        or (x["interval95"][0] <= form["exponent"] <= x["interval95"][1] <= x["interval95"][0] + 2.0)
        for x in force.get("speed_exponent") or []
    )


def intervals_hold(effects: Sequence[dict[str, Any]], report: dict[str, Any]) -> dict[str, bool]:
    """For every parameter of which truth and interval are known, whether the one is in the other."""
    held: dict[str, bool] = {}
    for effect in effects:
        for found in report["effects"]:
            if found["name"] != effect["name"]:
                continue
            for name, true in effect["numbers"].items():
                reported = found["unknowns"].get(name) or found["unknowns"].get(_short(name))
                if reported and reported.get("interval95") and None not in reported["interval95"]:
                    low, high = reported["interval95"]
                    held[f"{effect['name']}.{name}"] = bool(low <= true <= high)
    return held


def _short(name: str) -> str:
    """Return gravity where gravity_z is not distinguished."""
    return name.removesuffix("_z")


def place_overlaps(effects: Sequence[dict[str, Any]], report: dict[str, Any]) -> bool | None:
    """Return whether the places found overlap the true ones; None where there is none to find."""
    answers = []
    for effect in effects:
        place = effect["place"]
        found = next((e for e in report["effects"] if e["name"] == effect["name"]), None)
        if place is None or found is None:
            continue
        values = {k: u["value"] for k, u in found["unknowns"].items()}
        if effect["name"] == "hidden_wall":
            answers.append(_wall_overlaps(place, report))
        elif effect["name"] == "dropped_frames":
            run = ((report.get("world") or {}).get("observer") or {}).get("shift_run")
            near = abs(values.get("shift_time", np.inf) - place["onset"]) <= 2.0 * place["extent"]
            answers.append(near and run in (None, f"run{int(place['run'])}"))
        else:
            centre = [[values.get(f"centre_{a}", values.get(a, np.nan)), place[a]] for a in "xyz" if a in place]
            apart = float(np.linalg.norm([a - b for a, b in centre]))
            answers.append(apart < place["extent"] + abs(values.get("width", values.get("radius", 0.0))))
    return all(answers) if answers else None


def _wall_overlaps(place: dict[str, float], report: dict[str, Any]) -> bool:
    """Return whether a plane, or upright wall, that was added stands where the true one does."""
    true = np.array([place["normal_x"], place["normal_y"], 0.0])
    for static in (report.get("world") or {}).get("statics", []):
        if static["name"] == "floor":
            continue
        shape, at = static["shape"], np.asarray(static.get("position") or (0.0, 0.0, 0.0), dtype=float)
        if shape["kind"] == "plane":
            normal = _turned(np.asarray(shape["normal"], dtype=float), static.get("orientation"))
            normal /= np.linalg.norm(normal)
            offset = shape["offset"] + float(normal @ at)
            if normal @ true > WALL_TURN and abs(offset - place["offset"]) < WALL_AWAY:
                return True
        elif shape["kind"] == "wall":
            ends = [
                _turned(np.asarray(shape[k], dtype=float), static.get("orientation")) + at for k in ("start", "end")
            ]
            along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
            nearest = min(abs(float(true @ (e + s * along)) - place["offset"]) for e in ends for s in (0.0,))
            if abs(along @ true) < np.sqrt(1.0 - WALL_TURN**2) and nearest < 2.0 * WALL_AWAY + shape["thickness"]:
                return True
    return False


def _turned(vector: np.ndarray[Any, Any], quaternion: Sequence[float] | None) -> np.ndarray[Any, Any]:
    if quaternion is None:
        return vector
    w, u = quaternion[0], np.asarray(quaternion[1:], dtype=float)
    return vector + 2.0 * np.cross(u, np.cross(u, vector) + w * vector)


def main() -> None:
    """Score every case that was judged."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--public", type=Path, required=True)
    parser.add_argument("--private", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    chosen = parser.parse_args()
    names = read_json(chosen.public / "order.json")
    judged = [n for n in names if (chosen.public / n / "verdict.json").exists()]
    outcomes = [asdict(score(chosen.public / n, chosen.private / n)) for n in judged]
    write_json(chosen.out, outcomes)


if __name__ == "__main__":
    main()
