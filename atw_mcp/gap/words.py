"""The outcome of a search for the gap, and the worth of an added effect, in words."""

from __future__ import annotations

from typing import Any

PLAIN = 3  # plain laws in a sentence
OF_RUNS = 6  # numbers of single runs from which on their spread is given instead
SHOWN = 4  # most names of a credible set, or pairs of it, in a sentence
SAME_MOTION = 1.0  # standard deviations between forecasts below which they are indistinguishable


def verdict_text(report: dict[str, Any]) -> str:
    """Return a verdict (`GapReport.to_dict`) in a few sentences, with what the recording cannot show."""
    parts = [_verdict(report)]
    if report["time_limit"] is not None:
        parts.append(f"The search ended after {_number(report['time_limit'])} s with the best answer so far")
    if report["checks"]:
        parts.append(f"Lowered by: {'; '.join(c['found'] for c in report['checks'])}")
    if report["set_aside"]:
        parts.append(f"Set aside, fitted by nothing: {'; '.join(o['summary'] for o in report['set_aside'])}")
    if report["plain_laws"] and report["verdict"] != "nothing_missing":
        parts.append(f"Plain laws by themselves: {_plain_laws(report['plain_laws'])}")
    if report["remainder"] is not None:
        parts.append(report["remainder"]["summary"].rstrip("."))
    return ". CAUTION: ".join((". ".join(parts), *(c.rstrip(".") for c in report["cautions"])))


def _plain_laws(laws: list[dict[str, Any]]) -> str:
    """List the plain laws that come nearest, each fitted alone."""
    listed = []
    for law in laws[:PLAIN]:
        name = f"{law['name']} ({law['label']})" if law["label"] else law["name"]
        values = ", ".join(f"{k} {_number(v)}" for k, v in law["values"].items())
        behind = law["ebic_behind"]
        place = (
            "the best" if abs(behind) < 0.05 else f"EBIC {_number(abs(behind))} {'behind' if behind > 0 else 'ahead'}"
        )
        listed.append(f"{name}: {values}, {place}")
    return "; ".join(listed)


def _verdict(report: dict[str, Any]) -> str:
    kind = report["verdict"]
    if kind == "nothing_missing":
        text = "nothing missing: the world explains the data to the noise"
        if report["near_misses"]:
            near = ", ".join(" + ".join(item["effects"]) for item in report["near_misses"][:SHOWN])
            text += f" (effects that would lower the misfit a little, not beyond chance: {near})"
        return text
    named = " + ".join(effect_text(effect) for effect in report["effects"])
    if kind == "identified":
        text = f"identified: {named}"
        if report["other_forms"]:
            text += f"; the data allow as well: {'; '.join(report['other_forms'][:SHOWN])}"
        if report["runner_up"] is not None:
            other = report["runner_up"]
            text += f"; next best {' + '.join(other['effects'])}, EBIC {_number(other['ebic_behind'])} behind"
            text += "" if other["passes"] else ", does not explain the data"
        return text
    if kind == "identified_with_remainder":
        stability = report["stability"]
        text = f"identified_with_remainder: {named}"
        if stability is not None:
            own = {e["name"] for e in report["effects"]}
            least = min((v for k, v in stability["chosen_in"].items() if k in own), default=0.0)
            text += (
                f"; chosen in {100 * least:.0f}% of the subsets of runs, "
                f"EBIC {_number(stability['ebic_ahead'])} ahead "
                "of no effect with model error admitted; intervals are widened for what remains"
            )
        return text
    if kind == "ambiguous" and len(report["credible_set"]) < 2:
        return f"ambiguous: {named}, but the program's own checks contradict it"
    if kind == "ambiguous":
        names = [" + ".join(item) for item in report["credible_set"]]
        listed = "; ".join(names[:SHOWN]) + ("" if len(names) <= SHOWN else f"; and {len(names) - SHOWN} more")
        return f"ambiguous: any of {listed}; best {named}. {experiment_text(report['experiment'])}"
    if not named and any(c["check"] == "held_out_remainder" for c in report["checks"]):
        return "unexplained: the world as it is explains the data fitted to the noise, but not the sealed data"
    if not named and report["time_limit"] is not None:
        return "unexplained: the time ran out before any effect was fitted"
    text = "unexplained: no effect of the catalogue leaves only noise"
    if named:
        text += f" (nearest: {named})"
    if report["stability"] is not None and report["stability"]["reasons"]:
        text += f"; none is named although model error was admitted: {'; '.join(report['stability']['reasons'])}"
    force = report["residual_force"]
    return text + (f". {force['summary']}" if force else "")


def effect_text(effect: dict[str, Any]) -> str:
    """Return an effect with its fitted numbers: "quadratic_drag (drag 0.0301 kg/m, 95% 0.0297 to 0.0305)"."""
    numbers = []
    unknowns = effect["unknowns"]
    of_runs = {name: value for name, value in unknowns.items() if " in " in name}
    if len(of_runs) > OF_RUNS:
        unknowns = {name: value for name, value in unknowns.items() if name not in of_runs}
        numbers.append(_spread(of_runs))
    for name, value in unknowns.items():
        unit = "" if value["unit"] in ("1", "") else f" {value['unit']}"
        text = f"{name} {_number(value['value'])}{unit}"
        if value["interval95"] is not None:
            low, high = value["interval95"]
            text += f", 95% {_number(low)} to {_number(high)}"
        numbers.append(text)
    head = f"{effect['name']} {effect['label']}".strip()
    same = f"; indistinguishable from {', '.join(effect['same_as'])}" if effect["same_as"] else ""
    return f"{head} ({'; '.join(numbers)}{same})"


def _spread(of_runs: dict[str, dict[str, Any]]) -> str:
    """Summarize numbers that every run has of its own: their count, unit and spread in one line."""
    groups: dict[str, list[float]] = {}
    for name, value in of_runs.items():
        groups.setdefault(name.split(" in ")[0], []).append(float(value["value"]))
    unit = next(iter(of_runs.values()))["unit"]
    spread = ", ".join(f"{name} {_number(min(v))} to {_number(max(v))}" for name, v in groups.items())
    return f"one of its own in each of {len(next(iter(groups.values())))} runs: {spread} {unit}"


def experiment_text(experiment: dict[str, Any] | None) -> str:
    """Describe the experiment that would decide, in a sentence."""
    if experiment is None:
        return "No experiment with these objects was found to distinguish them"
    place = ", ".join(_number(v) for v in experiment["position"])
    speed = ", ".join(_number(v) for v in experiment["velocity"])
    spin = ", ".join(_number(v) for v in experiment["angular_velocity"])
    least = min(item["sigmas"] for item in experiment["separations"])
    if least < SAME_MOTION:
        alike = [x for x in experiment["separations"] if x["sigmas"] < SAME_MOTION]
        pairs = "; ".join(f"{' + '.join(x['first'])} from {' + '.join(x['second'])}" for x in alike[:SHOWN])
        return f"No start of one object was found to distinguish {pairs}: they move these objects in the same way"
    head = "To decide" if experiment["decides"] else "The best experiment found, which may not decide"
    expected = "; ".join(f"{_number(value)} if {name}" for name, value in experiment["forecasts"].items())
    return (
        f"{head}: start {experiment['object']} at ({place}) m with velocity ({speed}) m/s and spin ({spin}) rad/s, "
        f"film {_number(experiment['duration'])} s and watch {experiment['watch']}: {expected}. The forecasts are "
        f"at least {_number(least)} standard deviations apart"
    )


def worth_text(data: dict[str, Any]) -> str:
    """Return what an added effect is worth, on fitted and sealed data, in a sentence."""
    text = f"gap on the data fitted {_gap_text(data['fitted_data'])}"
    if data["sealed"] is None:
        return text + "; no data were sealed to check it on"
    return text + f"; on sealed data {_gap_text(data['sealed'])}"


def _gap_text(gap: dict[str, Any]) -> str:
    closed = "" if gap["closed"] is None else f" ({100 * gap['closed']:.0f}% closed)"
    unit = gap["unit"]
    return (
        f"{_number(gap['gap_before'])} {unit} before, {_number(gap['gap_after'])} {unit} after{closed}, noise "
        f"{_number(gap['noise_floor'])} {unit}"
    )


def _number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.4g}"
