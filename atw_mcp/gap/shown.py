"""Short form of a gap for an agent: the few numbers that decide what to do next. The evidence keeps all of them."""

from __future__ import annotations

from typing import Any

MOST = 3  # levels of a factor, onsets, worst series
POWERLESS = 12  # most effects listed that could have been missed


def shown_discrepancy(data: dict[str, Any]) -> dict[str, Any]:
    """The short form of `gap_work.examine`'s data."""
    goodness, noise, where = data["goodness"], data["noise"], data["where"]
    shown: dict[str, Any] = {
        "explained": data["explained"],
        "goodness": {"passes": goodness["passes"], "p": goodness["p"], "ratio_to_noise": goodness["statistic"]},
        "worst": [
            f"{item['name']} {item['kind']} {item['axis']}, run {item['run']}: {item['ratio']:.3g} times noise"
            for item in goodness["worst"][:MOST]
        ],
        "noise": noise["summary"],
        "share_of_gap": {
            factor: {level["level"]: round(level["share"], 3) for level in levels[:MOST]}
            for factor, levels in where["factors"].items()
            if len(levels) > 1
        }
        if not data["explained"]
        else {},
        "onsets": where["onsets"][:MOST],
        "base": [{key: item[key] for key in ("name", "value", "unit")} for item in data["base"]],
    }
    if goodness["rhythm"]:
        shown["goodness"]["rhythm"] = goodness["rhythm"]
    if data["cautions"]:
        shown["cautions"] = data["cautions"]
    if "power" in data:
        rows = data["power"]
        missed = [row["summary"] for row in rows if not row["seen"]]
        shown["could_have_been_missed"] = missed[:POWERLESS]
        if len(missed) > POWERLESS:
            shown["and_more"] = len(missed) - POWERLESS
        shown["would_have_been_seen"] = sorted({row["effect"] for row in rows if row["seen"]})
    shown["whole"] = "ReadEvidence(evidence=this result's evidence id, path='where'), or 'goodness', 'noise', 'power'"
    return shown


def shown_proposals(data: dict[str, Any]) -> dict[str, Any]:
    """The short form of `gap_work.propose`'s data."""
    null = data["null_control"]
    shown: dict[str, Any] = {
        "verdict": data["verdict"],
        "proposals": [
            {
                "hypothesis": number,
                "title": item["title"],
                "explains": item["passes"],
                "ebic_behind": item["ebic_behind"],
                "effects": [_effect(effect) for effect in item["effects"]],
            }
            for number, item in enumerate(data["proposals"])
        ],
        "runner_up": data["runner_up"],
        "goodness": data["goodness"]["summary"],
        "noise": data["noise"]["summary"],
        "base": {name: value["value"] for name, value in data["base"]["unknowns"].items()},
        "null_control": None if null is None else f"on data made from the world itself: {null['verdict']}",
    }
    shown["set_aside"] = [item["summary"] for item in data["set_aside"]]
    shown["plain_laws"] = [
        {key: law[key] for key in ("name", "label", "values", "ebic_behind", "passes")}
        for law in data["plain_laws"][:MOST]
    ]
    if data["remainder"] is not None:
        shown["remainder"] = data["remainder"]["summary"]
    for key in ("checks", "stability", "time_limit", "other_forms", "near_misses", "experiment", "residual_force"):
        if data[key]:
            shown[key] = data[key]
    shown["whole"] = "ReadEvidence(evidence=this result's evidence id, path='history'), or 'goodness', 'noise', ..."
    return shown


def _effect(effect: dict[str, Any]) -> dict[str, Any]:
    shown: dict[str, Any] = {"name": effect["name"], "law": effect["law"]}
    if effect["label"]:
        shown["label"] = effect["label"]
    if effect["same_as"]:
        shown["same_as"] = effect["same_as"]
    shown["unknowns"] = {
        name: {key: value[key] for key in ("value", "unit", "interval95") if value[key] is not None}
        for name, value in effect["unknowns"].items()
    }
    return shown


def next_step(case: str, data: dict[str, Any]) -> str:
    """Advise what to do after a verdict."""
    add = f"AddEffect(case={case!r}, proposal=this result's evidence id)"
    if data["verdict"] == "nothing_missing":
        return f"nothing to add; FindDiscrepancy(case={case!r}, power=true) lists what these data could not have shown"
    if data["verdict"] == "identified":
        return add
    if data["verdict"] == "identified_with_remainder":
        return f"{add}, reporting the remainder with it; runs set aside deserve a look: InspectObservedMotion"
    if data["verdict"] == "ambiguous":
        best = (
            "the experiment described, its data imported with the rest, then ProposeEffects again"
            if (data["experiment"])
            else "other data: none of the starts tried would distinguish them"
        )
        return f"{best}; or {add[:-1]}, hypothesis=NUMBER), saying that others would do as well"
    force = data["residual_force"]
    if force and force["expression"]:
        numbers = {name: number["value"] for name, number in force["numbers"].items()}
        units = {name: number["unit"] for name, number in force["numbers"].items()}
        effect = {
            "name": "unexplained",
            "kind": "expression",
            "expression": force["expression"],
            "parameters": {name: float(f"{value:.6g}") for name, value in numbers.items()},
            "parameter_units": units,
        }
        return f"AddEffect(case={case!r}, effect={effect}), or a law of your own that the residual force suggests"
    return f"a law of your own: AddEffect(case={case!r}, effect={{name, kind: 'expression', expression, parameters}})"
