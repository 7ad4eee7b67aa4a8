"""A verdict on a fit: good, doubtful or poor, by what it predicts of frames that it left out, beside noise and size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from atw_mcp.calls.app import App
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.fitted import FittedRun
from polyworld.world.geometry import equivalent_radius

Verdict = Literal["good", "doubtful", "poor"]


@dataclass(frozen=True)
class VerdictSettings:
    """When a fit is good, doubtful or poor.

    noisy: times the noise up to which an error is measurement, or nearly. small: of a body's radius up to which an
    error matters to no contact. large: of a body's radius, from which contacts happen or fail that the video shows
    otherwise. unexplained: of the motion itself, beyond which the fit says no more of where a body is than its mean
    place. share: of the moving bodies that must be largely off for the whole to be poor. wrong: probability that a
    world answers as chance would where a body is far off, from yes/no questions about rendered throws,
    bounces and ramps.
    """

    noisy: float = 2.0
    small: float = 0.05
    large: float = 0.5
    unexplained: float = 1.0
    share: float = 0.5
    wrong: float = 0.35


SETTINGS = VerdictSettings()


def is_far_off(error: float, noise: float, radius: float) -> bool:
    """Whether an error [m] that noise along the line of sight does not explain is more than noise and half a radius.

    noise [m]: distance that the noise across the line of sight makes.
    """
    return error > max(SETTINGS.large * radius, SETTINGS.noisy * noise)


@dataclass(frozen=True)
class BodyFit:
    """Root mean square distance of a body's simulated from its observed centre on the frames fitted [m].

    noise [m]: distance that the stated noise of its track makes. radius [m]: of the ball of its volume. motion [m]:
    root mean square distance of the observed centre from its mean. far_off: whether contacts happen or fail otherwise
    than the video shows, by an error that noise does not explain. ahead [m]: of the prediction of frames that were left
    out at first; None where none were.
    """

    object: str
    error: float
    noise: float
    radius: float
    motion: float
    far_off: bool = False
    ahead: float | None = None

    @property
    def verdict(self) -> Verdict:
        """Good where what was left out is predicted to noise, or to little beside the body; poor where the frames
        fitted are off by much beside body and motion."""
        predicted = self.error if self.ahead is None else max(self.error, self.ahead)
        if predicted <= max(SETTINGS.noisy * self.noise, SETTINGS.small * self.radius):
            return "good"
        large = max(SETTINGS.large * self.radius, SETTINGS.unexplained * self.motion)
        return "poor" if self.error > large else "doubtful"

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {"object": self.object, "verdict": self.verdict, "error_m": self.error, "noise_m": self.noise,
                "of_radius": self.error / self.radius, "far_off": self.far_off, "predicted_m": self.ahead}  # fmt: skip

    def in_words(self) -> str:
        """The error beside noise and size."""
        noise = "" if self.noise <= 0.0 else f", {self.error / self.noise:.2g} times its noise"
        of_radius = f"{self.error / self.radius:.0%} of its radius"
        ahead = "" if self.ahead is None else f"; {self.ahead:.2g} m where it was predicted"
        return f"{self.object} is {self.error:.2g} m off{noise} and {of_radius}{ahead}"


@dataclass(frozen=True)
class FitVerdict:
    """The worst bodies first. diverged: the fitted world has no later states to judge."""

    bodies: tuple[BodyFit, ...]
    diverged: bool = False

    @property
    def verdict(self) -> Verdict:
        """Poor where it diverges or half of the moving bodies are far off, doubtful where any body is off."""
        if self.diverged:
            return "poor"
        found = [body.verdict for body in self.bodies]
        if found.count("poor") >= max(1, SETTINGS.share * len(found)):
            return "poor"
        return "doubtful" if set(found) - {"good"} else "good"

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        off = [body for body in self.bodies if body.verdict != "good"]
        return {
            "verdict": self.verdict,
            "why": "the fitted world diverges" if self.diverged else "; ".join(body.in_words() for body in off[:4]),
            "bodies": [body.to_dict() for body in self.bodies],
        }


def judge(run: FittedRun, tracks: ObservedTracks) -> FitVerdict:
    """Judge a fit by its rigid bodies; those that never move count only where they are off."""
    if run.accuracy is None:
        return FitVerdict((), diverged=True)
    components = 2 if run.world.planar else 3
    ahead = {} if run.prediction is None else {body.object: body.error for body in run.prediction.bodies}
    found = []
    for item in run.world.objects:
        fitted = run.accuracy.position_by_object.get(item.name)
        if fitted is None or not np.isfinite(fitted) or item.name not in tracks.names:
            continue
        later = ahead.get(item.name, np.nan)
        column = tracks.index(item.name)
        known = tracks.confidence[:, column] > 0.0
        sigma = float(np.median(tracks.coordinate_sigma[known, column]))
        across = float(np.median(tracks.position_sigma[known, column]))
        radius = equivalent_radius(item.shape)
        seen = tracks.positions[known, column]
        motion = float(np.sqrt(np.mean(np.sum((seen - seen.mean(axis=0)) ** 2, axis=1))))
        far = is_far_off(run.accuracy.unexplained_by_object[item.name], across * float(np.sqrt(components)), radius)
        body = BodyFit(
            item.name,
            float(fitted),
            sigma * float(np.sqrt(components)),
            radius,
            motion,
            far,
            float(later) if np.isfinite(later) else None,
        )
        if motion > SETTINGS.noisy * body.noise or body.verdict != "good":
            found.append(body)
    return FitVerdict(tuple(sorted(found, key=lambda body: -body.error / body.radius)))


def verdict_of(app: App, world: str) -> Mapping[str, Any] | None:
    """The verdict on the fit that made a world, by its id; None where it was not made by one, or by one not kept."""
    for descent in app.store.worlds.parents(world):
        if descent.how == "fitted" and "verdict" in descent.detail:
            found: Mapping[str, Any] = descent.detail["verdict"]
            return found
    return None


def predicted_errors(bodies: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the error beside noise [m] of each body of a verdict on the frames that its fit left out at first."""
    rows = ((b["object"], b["predicted_m"], b["noise_m"]) for b in bodies)
    errors = {name: float(np.hypot(error, noise)) for name, error, noise in rows if error is not None}
    return {name: error for name, error in errors.items() if error > 0.0}


def chance_of_wrong(verdict: Mapping[str, Any] | None) -> tuple[float, str]:
    """Return the probability that a fitted world answers as chance would, and why; 0 where nothing speaks for it."""
    if verdict is None:
        return 0.0, ""
    for row in verdict["bodies"]:
        if row["far_off"]:
            return SETTINGS.wrong, f"the fit leaves {row['object']} {row['error_m']:.2g} m off"
    return 0.0, ""


def cure(case: str, world: str) -> str:
    """Advise what to do about a poor fit."""
    return (
        f"InspectRollout(case={case!r}, world={world!r}) shows where it leaves the video. Then correct tracks, shapes "
        "or obstacles (BuildWorld), or fit the frames up to the first that goes wrong (FitWorld with last_frame) and "
        "from that world all of them"
    )
