"""Short form of a gap for an agent: the few numbers that decide what to do next. The evidence keeps all of them."""

from __future__ import annotations

from typing import Any

from atw_mcp.gap.words import kink_texts, law_text

MOST = 3  # levels of a factor, onsets, worst series, plain laws
POWERLESS = 12  # most effects listed that could have been missed


def shown_discrepancy(data: dict[str, Any]) -> dict[str, Any]:
    """The short form of `work.examine`'s data."""
    where = data["where"]
    shown: dict[str, Any] = {key: data[key] for key in ("explained", "error", "gap", "noise", "unit")}
    shown["worst"] = [
        f"{item['name']} {item['kind']} {item['axis']}, run {item['run']}: {item['error']:.3g} times noise"
        for item in data["worst"][:MOST]
    ]
    shown["share_of_gap"] = {
        factor: {level["level"]: round(level["share"], 3) for level in levels[:MOST]}
        for factor, levels in where["factors"].items()
        if len(levels) > 1 and not data["explained"]
    }
    shown["onsets"] = where["onsets"][:MOST]
    shown["kinks"] = kink_texts(data)
    shown["base"] = [{key: item[key] for key in ("name", "value", "unit")} for item in data["base"]]
    if data["cautions"]:
        shown["cautions"] = data["cautions"]
    if "power" in data:
        rows = data["power"]
        missed = [row["summary"] for row in rows if not row["seen"]]
        shown["could_have_been_missed"] = missed[:POWERLESS]
        if len(missed) > POWERLESS:
            shown["and_more"] = len(missed) - POWERLESS
        shown["would_have_been_seen"] = sorted({row["effect"] for row in rows if row["seen"]})
    shown["whole"] = "ReadEvidence(evidence=this result's evidence id, path='where'), or 'worst', 'kinks', 'power'"
    return shown


def shown_proposals(data: dict[str, Any]) -> dict[str, Any]:
    """The short form of `work.propose`'s data."""
    shown: dict[str, Any] = {key: data[key] for key in ("verdict", "reasons", "frequencies", "stable", "base")}
    shown["error"] = {key: data["error"][key] for key in ("before", "after")}
    shown["noise"] = data["noise"]["position"]
    shown["proposals"] = [
        {
            "hypothesis": number,
            **{key: item[key] for key in ("title", "explains", "behind", "error")},
            "effects": [_effect(effect) for effect in item["effects"]],
        }
        for number, item in enumerate(data["proposals"])
    ]
    shown["runner_up"] = None if data["runner_up"] is None else law_text(data["runner_up"])
    shown["set_aside"] = [item["summary"] for item in data["set_aside"]]
    shown["plain_laws"] = [law_text(law) for law in data["plain_laws"][:MOST]]
    if data["equivalent"]:
        shown["equivalent"] = [item["effects"] for item in data["equivalent"]]
    for key in ("time_limit", "experiment", "residual_force"):
        if data[key]:
            shown[key] = data[key]
    shown["whole"] = "ReadEvidence(evidence=this result's evidence id, path='history'), or 'plain_laws', 'hypotheses'"
    return shown


def _effect(effect: dict[str, Any]) -> dict[str, Any]:
    shown: dict[str, Any] = {key: effect[key] for key in ("name", "law", "label", "same_as") if effect[key]}
    shown["unknowns"] = {
        name: {key: value[key] for key in ("value", "unit", "interval95")} for name, value in effect["unknowns"].items()
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
        return f"{add}, reporting that a remainder is left; runs set aside deserve a look: InspectObservedMotion"
    if data["verdict"] == "ambiguous":
        best = (
            "the experiment described, its data imported with the rest, then ProposeEffects again"
            if data["experiment"]
            else "other data: none of the starts tried would distinguish them"
        )
        return f"{best}; or {add[:-1]}, hypothesis=NUMBER), saying that others would do as well"
    force = data["residual_force"]
    if force and force["expression"]:
        effect = {
            "name": "unexplained",
            "kind": "expression",
            "expression": force["expression"],
            "parameters": {name: float(f"{number['value']:.6g}") for name, number in force["numbers"].items()},
            "parameter_units": {name: number["unit"] for name, number in force["numbers"].items()},
        }
        return f"AddEffect(case={case!r}, effect={effect}), or a law of your own that the residual force suggests"
    return f"a law of your own: AddEffect(case={case!r}, effect={{name, kind: 'expression', expression, parameters}})"
