"""Edits and questions of rendered clips in the vocabulary of the tools, and what of them it cannot express."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.foresight_scene import Clip, tool_name

Floats = NDArray[np.float64]

FAR = 1e3  # m: beyond any scene
INSTANT = 1e-3  # s: half an interval that holds one sample


class Inexpressible(Exception):
    """What is asked has no counterpart in the tools."""


def edits_of(clip: Clip, world: dict[str, Any], edit: dict[str, Any]) -> list[dict[str, Any]]:
    """Edits of Rollout for one change of the scene.

    world: objects with their initial states, and joints, as InspectWorld lists them.
    """
    op, name, f = edit["op"], edit["body"], float(edit["factor"])
    objects = {item["name"]: item["initial_state"] for item in world["objects"]}
    if name and name not in objects:
        raise Inexpressible(f"{op} of {name}, which is not in the world")
    if op == "remove":
        return [{"action": "remove", "object": name}]
    if op == "speed":
        return [{"action": "scale_velocity", "object": name, "factor": f}]
    if op == "turn":
        return [_turned(clip, name, objects[name], np.radians(f))]
    if op in ("shift", "raise"):
        place = np.asarray(objects[name]["position"]) + (np.array([f, 0, 0]) if op == "shift" else np.array([0, 0, f]))
        return [{"action": "move", "object": name, "position": place.tolist()}]
    if op == "angle":
        return [_swung(clip, name, objects[name], f)]
    if op == "gravity":
        return [{"action": "environment", "gravity": [0.0, 0.0, -9.81 * f]}]
    return [{"action": "scale_parameter", "path": path, "factor": f} for path in _paths(clip, world, op, name)]


def _paths(clip: Clip, world: dict[str, Any], op: str, name: str) -> list[str]:
    """Parameters that a scaled property of the scene stands for."""
    names = [item["name"] for item in world["objects"]]
    if op == "mass":
        return [f"objects.{name}.mass"]
    if op == "restitution":  # of the floor and the fixtures: those of the tools' bodies count among themselves too
        return [f"objects.{name}.restitution"]
    if op == "friction":
        return [f"objects.{n}.{field}" for n in names for field in ("friction", "rolling_resistance")]
    if op == "damping":
        joints = [f"joints.{j['name']}.{field}" for j in world["joints"] for field in ("friction", "damping")]
        return [*joints, *(f"objects.{n}.linear_damping" for n in names)]
    if op == "mutual restitution":
        if clip.kind not in ("floor", "entering"):
            raise Inexpressible("restitution between bodies alone, while they bounce on fixed things too")
        return [f"objects.{n}.restitution" for n in names]
    raise Inexpressible(op)


def _turned(clip: Clip, name: str, state: dict[str, Any], angle: float) -> dict[str, Any]:
    """A velocity turned about z, of a tossed body from x towards z."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = state["velocity"]
    upright = clip.kind in ("tossed", "bouncing")
    turned = [c * x - s * z, y, s * x + c * z] if upright else [c * x - s * y, s * x + c * y, z]
    edit = {"action": "set_velocity", "object": name, "velocity": [float(v) for v in turned]}
    if not upright:
        p, q, r = state["angular_velocity"]
        edit["angular_velocity"] = [float(c * p - s * q), float(s * p + c * q), float(r)]
    return edit


def _swung(clip: Clip, name: str, state: dict[str, Any], factor: float) -> dict[str, Any]:
    """A pendulum that starts at a multiple of its angle from the vertical, in the plane y = 0."""
    pivot = next(b["pivot"] for b in clip.bodies if b["name"] == name)
    x, _, z = np.asarray(state["position"]) - pivot
    half = 0.5 * (factor - 1.0) * float(np.arctan2(x, -z))
    w, i, j, k = state["orientation"]
    c, s = np.cos(half), -np.sin(half)  # about y, from x towards -z
    turned = [c * w - s * j, c * i + s * k, c * j + s * w, c * k - s * i]
    return {"action": "move", "object": name, "orientation": [float(v) for v in turned]}


def question_of(clip: Clip, question: dict[str, Any], names: set[str]) -> tuple[dict[str, Any], bool]:
    """Arguments of QueryWorld for a question, and whether its answer is the opposite of theirs."""
    body, time = question["body"], float(question["time"])
    for name in (body, question.get("other")):
        if name is not None and tool_name(name) not in names:
            raise Inexpressible(f"{name} is not in the world")
    end = float(clip.hidden["continuation"]["end"])
    instant = [max(time - INSTANT, 0.0), min(time + INSTANT, end)]
    if question["type"] == "left":
        box = {"lower": [-FAR, -FAR, -FAR], "upper": [question["x"], FAR, FAR]}
        return {"predicate": {"predicate": "inside_region", "object": body, **box}, "interval": instant}, False
    if question["type"] == "far":
        if "other" in question:
            near = {"predicate": "nearer_than", "a": body, "b": question["other"]}
        else:
            near = {"predicate": "within_distance", "a": body, "place": question["point"]}
        return {"predicate": {**near, "distance": question["distance"]}, "interval": instant}, True
    if question["type"] == "rest":
        still = {"predicate": "at_rest", "object": body, "speed": clip.hidden["physics"]["rest_speed"]}
        return {"predicate": still, "aggregation": "all", "interval": [time, end]}, False
    if question["type"] == "touch":
        both = {"predicate": "in_contact", "a": body, "b": tool_name(question["other"])}
        return {"predicate": both, "interval": [question["from"], time]}, False
    raise Inexpressible(f"questions of type {question['type']}")
