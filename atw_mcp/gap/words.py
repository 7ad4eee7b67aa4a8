"""The outcome of a search for the gap, and the worth of an added effect, in words."""

from __future__ import annotations

from typing import Any

MOST = 3  # plain laws, or sudden changes, in a summary
SAME_MOTION = 1.0  # standard deviations between forecasts below which they are indistinguishable
NOISE = "standard deviations of the noise"
KINDS = {
    "identified": "identified",
    "identified_with_remainder": "identified, with a remainder that nothing explains",
    "ambiguous": "ambiguous: these predict data left out about equally well",
    "unexplained": "unexplained: no effect may be named",
    "nothing_missing": "nothing missing",
}


def discrepancy_text(data: dict[str, Any]) -> str:
    """Return what `work.examine` found, in a few sentences."""
    head = "explained: nothing is missing" if data["explained"] else "not explained: something is missing"
    parts = [
        f"{head}. Data left out of the fit are predicted to {_number(data['error'])} {NOISE}",
        f"Residuals beyond the noise are {_number(data['gap'])} {data['unit']}, the noise {_number(data['noise'])} "
        f"{data['unit']}",
        data["where"]["summary"].rstrip("."),
    ]
    if data["kinks"]:
        parts.append(f"Sudden changes of velocity that nothing known explains: {'; '.join(kink_texts(data))}")
    return ". ".join(parts) + "."


def kink_texts(data: dict[str, Any]) -> list[str]:
    """Return the largest sudden changes of velocity, each in words."""
    return [
        f"{kink['name']} in run {kink['run']} at {_number(kink['time'])} s by {_number(kink['change'])} m/s, "
        f"{_number(kink['sigmas'])} standard deviations"
        for kink in data["kinks"][:MOST]
    ]


def verdict_text(result: dict[str, Any]) -> str:
    """Return a verdict (`work.result_of`) in a few sentences, with what the recording cannot show."""
    kind, named = result["verdict"], effects_text(result["effects"]) or "nothing missing"
    before, after = _number(result["error"]["before"]), _number(result["error"]["after"])
    head = KINDS[kind]
    if kind == "ambiguous":
        titles = [result["title"], *(" + ".join(c["effects"]) or "nothing missing" for c in result["competitors"])]
        head = f"{head}: {'; '.join(dict.fromkeys(titles))}. Nearest: {named}"
    elif kind == "unexplained":
        head = f"{head}{f'; nearest: {named}' if result['effects'] else ''}"
    elif kind != "nothing_missing":
        head = f"{head}: {named}"
    parts = [head]
    if result["reasons"]:
        parts.append(f"Why: {'; '.join(result['reasons'])}")
    without = f"{before} {NOISE} without an effect, {after} with it" if result["effects"] else f"{after} {NOISE}"
    parts.append(f"Error of predicting data left out: {without}")
    if result["frequencies"]:
        often = sorted(result["frequencies"].items(), key=lambda item: -item[1])
        parts.append(f"Chosen in bootstraps over runs: {', '.join(f'{n} {100 * s:.0f}%' for n, s in often)}")
    if result["equivalent"]:
        same = "; ".join(" + ".join(e["effects"]) for e in result["equivalent"])
        parts.append(f"In these runs the same motion follows from {same}")
    if kind == "ambiguous":
        parts.append(experiment_text(result["experiment"]))
    elif result["runner_up"] is not None and result["effects"]:
        parts.append(f"Next best: {law_text(result['runner_up'])}")
    if result["residual_force"] is not None:
        parts.append(result["residual_force"]["summary"].rstrip("."))
    if result["time_limit"] is not None:
        parts.append(f"The search ended after {_number(result['time_limit'])} s with the best answer so far")
    if result["set_aside"]:
        parts.append(f"Fitted by nothing: {'; '.join(o['summary'] for o in result['set_aside'])}")
    if result["plain_laws"] and kind != "nothing_missing":
        listed = "; ".join(law_text(law) for law in result["plain_laws"][:MOST])
        parts.append(f"Plain laws alone and in pairs: {listed}")
    return ". CAUTION: ".join((". ".join(parts), *(c.rstrip(".") for c in result["cautions"])))


def law_text(law: dict[str, Any]) -> str:
    """Return a hypothesis with its values, what it leaves and how far behind the best it is."""
    behind = law["behind"]
    place = "not compared" if behind is None else f"{_number(abs(behind))} nats {'behind' if behind > 0 else 'ahead'}"
    text = f"{effects_text(law['effects'], intervals=False)}, error {_number(law['error'])}"
    return text if behind == 0.0 else f"{text}, {place}"


def effects_text(effects: list[dict[str, Any]], *, intervals: bool = True) -> str:
    """Return effects with their numbers: "quadratic_drag (drag 0.0301 kg/m, 95% 0.0297 to 0.0305)"."""
    found = []
    for effect in effects:
        numbers = []
        for name, value in effect["unknowns"].items():
            unit = "" if value["unit"] in ("1", "") else f" {value['unit']}"
            ends = " to ".join("unbounded" if end is None else _number(end) for end in value["interval95"])
            spread = f", 95% {ends}" if intervals else ""
            numbers.append(f"{name} {_number(value['value'])}{unit}{spread}")
        if intervals and effect["same_as"]:
            numbers.append(f"indistinguishable from {', '.join(effect['same_as'])}")
        head = f"{effect['name']} {effect['label']}".strip()
        found.append(f"{head} ({'; '.join(numbers)})" if numbers else head)
    return " + ".join(found)


def experiment_text(experiment: dict[str, Any] | None) -> str:
    """Describe the experiment that would decide, in a sentence."""
    if experiment is None:
        return "No experiment with these objects was found to distinguish them"
    place, speed, spin = (
        ", ".join(_number(v) for v in experiment[key]) for key in ("position", "velocity", "angular_velocity")
    )
    least = min(item["sigmas"] for item in experiment["separations"])
    if least < SAME_MOTION:
        close = [x for x in experiment["separations"] if x["sigmas"] < SAME_MOTION]
        pairs = "; ".join(f"{' + '.join(x['first'])} from {' + '.join(x['second'])}" for x in close)
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
    text = f"gap on the data fitted {gap_text(data['fitted_data'])}"
    if data["sealed"] is None:
        return text + "; no data were sealed to check it on"
    return text + f"; on sealed data {gap_text(data['sealed'])}"


def sealed_text(result: dict[str, Any]) -> str:
    """Return what a verdict is worth on sealed data, in a sentence."""
    gap = result["sealed"]
    if gap is None:
        return str(result["sealed_data"])
    worth = f"gap {gap_text(gap)}" if result["effects"] else f"predicted to {_number(gap['before'])} {NOISE}"
    return f"{result['sealed_data']}: {worth}"


def gap_text(gap: dict[str, Any]) -> str:
    """Return a gap before and after beside the noise."""
    closed = "" if gap["closed"] is None else f", {100 * gap['closed']:.0f}% closed"
    before, after, floor = (_number(gap[key]) for key in ("gap_before", "gap_after", "noise_floor"))
    return f"{before} {gap['unit']} before, {after} after{closed}; noise {floor} {gap['unit']}"


def _number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.4g}"
