"""Draw yes/no questions whose answers lie near the boundary, from the outcomes of a clip and of its edits."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import Generator

from .bodies import POSE_RATE, Scene
from .physics import Run

WANTED = 20
TIME_ERROR = 0.08  # s, a typical error of a predicted time


@dataclass(frozen=True)
class Outcome:
    """A run about which questions are asked. edit: index of the edit or None; start: questions concern later times."""

    run: Run
    edit: int | None
    text: str
    start: float


def _round_time(t: float) -> float:
    return round(round(t * POSE_RATE) / POSE_RATE, 4)


def _sample(run: Run, name: str, t: float) -> np.ndarray:
    return np.asarray(run.poses[round(t * POSE_RATE), run.names.index(name), :3])


def spoken(name: str) -> str:
    """Return how a question names a recorded point."""
    return {"rope": "the free end of the rope", "cloth": "the lower west corner of the cloth"}.get(
        name, f"the centre of {name}"
    )


def _margin(rng: Generator, hard: bool, error: float) -> float:
    return float(error * (rng.uniform(0.15, 0.9) if hard else rng.uniform(1.5, 4.0)))


def length_error(run: Run, name: str, t: float, start: float, size: float) -> float:
    """Return a typical error of a predicted place in m: a tenth of the way since start and a fifth of the size."""
    i = run.names.index(name)
    path = run.poses[round(start * POSE_RATE) : round(t * POSE_RATE) + 1, i, :3]
    way = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    return 0.1 * way + 0.2 * size


def touches_between(run: Run, a: str, b: str, start: float, end: float) -> bool:
    """Return whether two things touch at any time between start and end (s)."""
    key = tuple(sorted((a, b)))
    return any((p, q) == key and s <= end and e >= start for p, q, s, e in run.touches)


class _Asker:
    def __init__(self, rng: Generator, scene: Scene) -> None:
        self.rng, self.scene = rng, scene
        self.sizes = {b.name: b.size[0] for b in scene.bodies}

    def _pick(self, outcome: Outcome) -> str:
        """Pick a recorded thing, mostly one that moves after the start."""
        run, first = outcome.run, round(outcome.start * POSE_RATE)
        way = np.linalg.norm(np.diff(run.poses[first:, :, :3], axis=0), axis=2).sum(axis=0)
        weights = np.where(way > 0.02, 1.0, 0.08)
        return run.names[int(self.rng.choice(len(run.names), p=weights / weights.sum()))]

    def left(self, outcome: Outcome, hard: bool) -> dict[str, Any] | None:
        """Ask whether a body ends left of a line of constant x."""
        run, name = outcome.run, self._pick(outcome)
        t = _round_time(run.end)
        error = length_error(run, name, t, outcome.start, self.sizes.get(name, 0.05))
        margin = _margin(self.rng, hard, error)
        x = round(float(_sample(run, name, t)[0]) + margin * (1 if self.rng.random() < 0.5 else -1), 4)
        return {
            "type": "left",
            "body": name,
            "x": x,
            "time": t,
            "text": f"Is {spoken(name)} at x < {x} m at {t:.3f} s?",
            "answer": bool(_sample(run, name, t)[0] < x),
            "margin": abs(float(_sample(run, name, t)[0]) - x),
            "typical_error": error,
        }

    def far(self, outcome: Outcome, hard: bool) -> dict[str, Any] | None:
        """Ask whether a body is farther than d from another body or from a point."""
        run, name = outcome.run, self._pick(outcome)
        t = _round_time(float(self.rng.uniform(outcome.start + 0.3, run.end - 0.02)))
        others = [n for n in run.names if n != name]
        here = _sample(run, name, t)
        record: dict[str, Any] = {"type": "far", "body": name, "time": t}
        error = length_error(run, name, t, outcome.start, self.sizes.get(name, 0.05))
        if others and self.rng.random() < 0.8:
            other = str(self.rng.choice(others))
            there = _sample(run, other, t)
            error = max(error, length_error(run, other, t, outcome.start, self.sizes.get(other, 0.05)))
            record["other"] = other
            what = spoken(other)
        else:
            there = np.round(run.poses[0, run.names.index(name), :3], 2)
            record["point"] = [float(c) for c in there]
            what = f"the point {record['point']}"
        distance = float(np.linalg.norm(here - there))
        margin = _margin(self.rng, hard, error)
        d = round(distance + margin * (1 if self.rng.random() < 0.5 else -1), 4)
        if d <= 0.01:
            d = round(distance + margin, 4)
        return {
            **record,
            "distance": d,
            "text": f"Is {spoken(name)} farther than {d} m from {what} at {t:.3f} s?",
            "answer": bool(distance > d),
            "margin": abs(distance - d),
            "typical_error": error,
        }

    def rest(self, outcome: Outcome, hard: bool) -> dict[str, Any] | None:
        """Ask whether a body comes to rest for good before a time."""
        run = outcome.run
        stopping = [n for n in run.names if (run.rest[n] or 0.0) > outcome.start + 0.1]
        if not stopping:
            return None
        name = str(self.rng.choice(stopping))
        when = float(run.rest[name] or 0.0)
        margin = _margin(self.rng, hard, TIME_ERROR)
        t = round(when + margin * (1 if self.rng.random() < 0.5 else -1), 4)
        if not outcome.start < t < run.end:
            return None
        return {
            "type": "rest",
            "body": name,
            "time": t,
            "text": f"Is {spoken(name)} at rest from some time before {t:.3f} s until {run.end:.3f} s?",
            "answer": bool(when < t),
            "margin": abs(when - t),
            "typical_error": TIME_ERROR,
        }

    def _touchable(self, outcome: Outcome) -> list[tuple[str, str]]:
        run = outcome.run
        bodies = [b.name for b in self.scene.bodies if b.name in run.names]
        pairs = [(a, b) for i, a in enumerate(bodies) for b in bodies[i + 1 :]]
        solid = [f.name for f in self.scene.fixtures if f.solid and f.name not in ("ramp", "board", "stand")]
        for b in self.scene.bodies:
            if b.name in run.names and b.joint in ("free", "track"):
                flies = self.scene.kind in ("tossed", "bouncing", "ramp") and b.name in ("A", "B")
                meets = ["floor", *solid] if flies else solid
                if b.joint == "track":
                    meets = [n for n in solid if n.startswith("stop")]
                pairs.extend((b.name, n) for n in meets)
        s = outcome.start
        return [p for p in pairs if not touches_between(run, *p, max(0.0, s - 0.01), s + 0.01)]

    def touch(self, outcome: Outcome, hard: bool) -> dict[str, Any] | None:
        """Ask whether two things touch between the start and a time."""
        run, pairs = outcome.run, self._touchable(outcome)
        meeting: dict[tuple[str, str], float] = {}
        for a, b in pairs:
            key = sorted((a, b))
            times = [s for p, q, s, _ in run.touches if [p, q] == key and s > outcome.start]
            if times:
                meeting[(a, b)] = min(times)
        if meeting and self.rng.random() < 0.75:
            options = list(meeting)
            a, b = options[int(self.rng.integers(len(options)))]
            margin: float | None = _margin(self.rng, hard, TIME_ERROR)
            t = round(meeting[(a, b)] + float(margin or 0) * (1 if self.rng.random() < 0.5 else -1), 4)
            margin, unit, error = abs(t - meeting[(a, b)]), "s", TIME_ERROR
        else:
            near = []
            for a, b in pairs:
                if (a, b) in meeting or b not in run.names:
                    continue
                first = round(outcome.start * POSE_RATE)
                i, j = run.names.index(a), run.names.index(b)
                apart = np.linalg.norm(run.poses[first:, i, :3] - run.poses[first:, j, :3], axis=1).min()
                near.append((float(apart) - (self.sizes[a] + self.sizes[b]) / 2, a, b))
            near.sort()
            if not near:
                return None
            gap, a, b = near[int(self.rng.integers(min(2, len(near))))]
            if gap > 0.25:
                return None
            t, margin, unit = _round_time(run.end), max(gap, 0.0), "m"
            error = max(length_error(run, n, t, outcome.start, self.sizes[n]) for n in (a, b))
        if not outcome.start + 0.02 < t <= run.end:
            return None
        return {
            "type": "touch",
            "body": a,
            "other": b,
            "from": round(outcome.start, 4),
            "time": t,
            "text": f"Do {a} and {b} touch between {outcome.start:.3f} s and {t:.3f} s?",
            "answer": touches_between(run, a, b, outcome.start, t),
            "margin": margin,
            "margin_unit": unit,
            "typical_error": error,
        }


def draw_questions(rng: Generator, scene: Scene, outcomes: list[Outcome], wanted: int = WANTED) -> list[dict[str, Any]]:
    """Draw questions; the first outcome is the clip itself (predictive) and gets half of them."""
    asker = _Asker(rng, scene)
    makers: list[Callable[[Outcome, bool], dict[str, Any] | None]] = [asker.touch, asker.far, asker.rest, asker.left]
    out: list[dict[str, Any]] = []
    texts: set[str] = set()
    yes = 0
    for attempt in range(60 * wanted):
        if len(out) >= wanted:
            break
        predictive = len(out) % 2 == 0 or len(outcomes) == 1
        outcome = outcomes[0] if predictive else outcomes[1 + int(rng.integers(len(outcomes) - 1))]
        if not outcome.run.names:
            continue
        maker = makers[int(rng.choice(4, p=[0.35, 0.3, 0.15, 0.2]))]
        question = maker(outcome, len(out) % 4 < 2)
        if question is None or (question["text"], outcome.edit) in texts:
            continue
        lopsided = yes - (len(out) - yes)
        if abs(lopsided) > 3 and question["answer"] == (lopsided > 0) and attempt < 30 * wanted:
            continue
        texts.add((question["text"], outcome.edit))  # type: ignore[arg-type]
        yes += question["answer"]
        margin = question["margin"]
        question["margin"] = round(margin, 4)
        question["typical_error"] = round(question["typical_error"], 4)
        group = "predictive" if outcome.edit is None else "counterfactual"
        prefix = "" if outcome.edit is None else f"If {outcome.text}: "
        question["text"] = prefix + question["text"]
        question["close"] = bool(margin < question["typical_error"])
        out.append({"group": group, "edit": outcome.edit, **question})
    return out
