"""Outcomes of a search for the gap as `result_of` gives them, made up: verdicts that single tool calls seldom give."""

from __future__ import annotations

from typing import Any


def experiment(sigmas: float) -> dict[str, Any]:
    return {
        "object": "ball",
        "position": [0.0, 0.0, 0.1],
        "velocity": [2.0, 0.0, 0.0],
        "angular_velocity": [0.0, 0.0, 0.0],
        "duration": 1.0,
        "interval": 0.01,
        "watch": "ball.x at 1 s",
        "forecasts": {"linear_drag": 1.2, "viscous_friction": 1.4},
        "separations": [{"first": ["linear_drag"], "second": ["viscous_friction"], "sigmas": sigmas}],
        "decides": sigmas >= 5.0,
    }


def hypothesis(name: str, behind: float | None, interval: list[float | None]) -> dict[str, Any]:
    number = {"value": 0.1, "unit": "kg/s", "interval95": interval, "paths": [f"effects.{name}.coefficient"]}
    effect = {"name": name, "label": "ball", "law": "F = -c v", "same_as": ["wind"], "unknowns": {"c": number}}
    return {"title": name, "explains": True, "behind": behind, "error": 1.1, "effects": [effect]}


def result(verdict: str, **parts: Any) -> dict[str, Any]:
    """A verdict as `result_of` gives it."""
    return {
        "verdict": verdict,
        "effects": hypothesis("linear_drag", 0.0, [0.09, None])["effects"],
        "competitors": [{"effects": ["viscous_friction"]}],
        "cautions": ["z was never measured."],
        "title": "linear_drag",
        "reasons": [],
        "proposals": [
            hypothesis("linear_drag", 0.0, [0.09, None]),
            hypothesis("viscous_friction", None, [0.09, 0.11]),
        ],
        "runner_up": hypothesis("tilt", 12.0, [0.09, 0.11]),
        "error": {"before": None, "after": 1.1, "unit": "standard deviations of the noise"},
        "frequencies": {"linear_drag": 0.6, "viscous_friction": 0.4},
        "stable": 0.6,
        "noise": {"position": None, "unit": "m"},
        "base": {"objects.ball.restitution": 0.7},
        "set_aside": [{"run": "r2", "summary": "run r2 was set aside"}],
        "plain_laws": [hypothesis("linear_drag", 0.0, [0.09, None])],
        "equivalent": [{"effects": ["joint_damping"]}],
        "time_limit": 60.0,
        "experiment": None,
        "residual_force": None,
    } | parts
