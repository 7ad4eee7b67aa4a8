"""Edits and questions of rendered clips in the vocabulary of the tools, and what of them it cannot express."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.foresight.scene import Clip, tool_name

Floats = NDArray[np.float64]

FAR = 1e3  # m: beyond any scene
INSTANT = 1e-3  # s: half an interval that holds one sample


class Inexpressible(Exception):
    """A question that has no counterpart in the tools."""


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
        return [_turned(clip, name, float(np.radians(f)))]
    if op in ("shift", "raise"):
        return [{"action": "move", "object": name, "shift": [f, 0.0, 0.0] if op == "shift" else [0.0, 0.0, f]}]
    if op == "angle":
        return [_swung(clip, name, objects[name], f)]
    if op == "gravity":
        return [{"action": "environment", "gravity_factor": f}]
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


def _turned(clip: Clip, name: str, angle: float) -> dict[str, Any]:
    """Return a velocity turned about z, of a tossed body from x towards z."""
    turn = [0.0, -angle, 0.0] if clip.kind in ("tossed", "bouncing") else [0.0, 0.0, angle]
    return {"action": "scale_velocity", "object": name, "turn": turn}


def _swung(clip: Clip, name: str, state: dict[str, Any], factor: float) -> dict[str, Any]:
    """Return a pendulum that starts at a multiple of its angle from the vertical, in the plane y = 0."""
    pivot = next(b["pivot"] for b in clip.bodies if b["name"] == name)
    x, _, z = np.asarray(state["position"]) - pivot
    return {"action": "move", "object": name, "turn": [0.0, -(factor - 1.0) * float(np.arctan2(x, -z)), 0.0]}


def question_of(clip: Clip, question: dict[str, Any], names: set[str]) -> tuple[dict[str, Any], bool]:
    """Fields of Ask's whether for a question, and whether its answer is the opposite of theirs."""
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
        slow = float(clip.hidden["physics"]["rest_speed"])  # of the centre
        return {"predicate": {"predicate": "moving", "object": body, "speed": slow}, "interval": [time, end]}, True
    if question["type"] == "touch":
        both = {"predicate": "in_contact", "a": body, "b": tool_name(question["other"])}
        return {"predicate": both, "interval": [question["from"], time]}, False
    raise Inexpressible(f"questions of type {question['type']}")
