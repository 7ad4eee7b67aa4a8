"""Questions about a simulated scene in CLEVRER's program language, answered from MuJoCo's events alone."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.random import Generator

from .solids import Collision, Run, Solid, simulate

FUTURE = 50  # frames after the clip in which a predicted event may fall
CLEAR = 3  # frames: events nearer to the clip's end are not asked about
MOVING = 0.1  # m/s; speeds from half to twice this are not asked about
OPTIONS = 4


@dataclass(frozen=True)
class Event:
    """An entry, exit or collision of objects at a frame."""

    kind: str
    who: frozenset[int]
    frame: int


def events_of(run: Run, frames: int) -> list[Event]:
    """Return the events of the first frames in order of time."""
    found = [Event("collision", frozenset(c.pair), c.frame) for c in run.collisions if c.frame < frames]
    for k in range(run.visible.shape[1]):
        change = np.diff(run.visible[:frames, k].astype(int))
        found += [Event("in", frozenset({k}), int(f) + 1) for f in np.flatnonzero(change > 0)]
        found += [Event("out", frozenset({k}), int(f) + 1) for f in np.flatnonzero(change < 0)]
    return sorted(found, key=lambda e: e.frame)


def ancestors(target: Event, events: list[Event]) -> set[Event]:
    """Return the events that led to one: of each participant the one before, and those before that."""
    found: set[Event] = set()
    waiting = [target]
    while waiting:
        event = waiting.pop()
        for k in event.who:
            own = [e for e in events if k in e.who and e.frame < event.frame]
            if own and own[-1] not in found:
                found.add(own[-1])
                waiting.append(own[-1])
    return found


class Asker:
    """Draws questions about one scene; `frames` is the length of the clip."""

    def __init__(self, rng: Generator, solids: list[Solid], restitution: float, run: Run, frames: int) -> None:
        self.rng, self.solids, self.restitution, self.run, self.frames = rng, solids, restitution, run, frames
        self.events = events_of(run, frames)
        self.pairs = [frozenset(p) for p in combinations(range(len(solids)), 2)]

    def ask(self) -> list[dict[str, Any]]:
        """Return the questions, numbered, as CLEVRER's files hold them."""
        found = [*self.descriptive(), *self.explanatory(), *self._predictive(), *self._counterfactual()]
        return [{"question_id": n, **q} for n, q in enumerate(found)]

    def _meant(self, k: int) -> tuple[str, list[str]]:
        """Words and program of an object by its colour, which is its alone, and sometimes its shape.

        Not by its material: MuJoCo's renderer has no reflections by which metal is known.
        """
        s = self.solids[k]
        program = ["objects", s.color, "filter_color"]
        if self.rng.random(2)[1] < 0.5:
            return f"{s.color} {s.shape}", [*program, s.shape, "filter_shape", "unique"]
        return f"{s.color} object", [*program, "unique"]

    def _collide(self, pair: frozenset[int], source: str) -> tuple[str, list[str]]:
        (one, first), (other, second) = (self._meant(k) for k in sorted(pair))
        program = [source, *first, "filter_collision", *second, "filter_collision", "unique"]
        return f"The {one} collides with the {other}", program

    def _choices(self, options: list[tuple[str, list[str], bool]]) -> list[dict[str, Any]]:
        order = self.rng.permutation(len(options))
        return [
            {
                "choice_id": n,
                "choice": options[k][0],
                "program": options[k][1],
                "answer": "correct" if options[k][2] else "wrong",
            }
            for n, k in enumerate(order)
        ]

    def descriptive(self) -> list[dict[str, Any]]:
        """Return up to three questions about what is seen."""
        collisions = [e for e in self.events if e.kind == "collision"]
        entries = [e for e in self.events if e.kind == "in"]
        asked: list[tuple[str, list[str], str, str]] = [
            (
                "How many collisions happen?",
                ["events", "objects", "filter_collision", "count"],
                str(len(collisions)),
                "count",
            ),
            (
                "How many objects enter the scene?",
                ["events", "objects", "filter_in", "count"],
                str(len(entries)),
                "count",
            ),
        ]
        for when, frame in (("start", 0), ("end", self.frames - 1)):
            speeds = np.linalg.norm(self.run.velocities[frame, :, :2], axis=-1)[self.run.visible[frame]]
            if not ((speeds > MOVING / 2) & (speeds < MOVING * 2)).any():
                moving = int((speeds > MOVING).sum())
                verb = "begins" if when == "start" else "ends"
                text = f"How many objects are moving when the video {verb}?"
                asked.append((text, ["objects", when, "get_frame", "filter_moving", "count"], str(moving), "count"))
        if collisions and (len(collisions) < 2 or collisions[1].frame > collisions[0].frame + CLEAR):
            k = int(self.rng.choice(sorted(collisions[0].who)))
            (partner,) = collisions[0].who - {k}
            words, program = self._meant(k)
            if sum(k in e.who for e in collisions) == 1:
                what = str(self.rng.choice(["color", "shape"]))
                asked.append(
                    (
                        f"What is the {what} of the object to collide with the {words}?",
                        [
                            "events",
                            *program,
                            "filter_collision",
                            "unique",
                            *program,
                            "get_col_partner",
                            f"query_{what}",
                        ],
                        str(getattr(self.solids[partner], what)),
                        f"query_{what}",
                    )
                )
        picked = self.rng.permutation(len(asked))[:3]
        return [
            {
                "question": asked[n][0],
                "question_type": "descriptive",
                "question_subtype": asked[n][3],
                "program": asked[n][1],
                "answer": asked[n][2],
            }
            for n in picked
        ]

    def explanatory(self) -> list[dict[str, Any]]:
        """Return a question about what led to each of the last two collisions."""
        collisions = [e for e in self.events if e.kind == "collision"]
        once = [e for e in collisions if sum(c.who == e.who for c in collisions) == 1]
        asked = []
        for target in [e for e in once if ancestors(e, self.events)][-2:]:
            led = ancestors(target, self.events)
            options = []
            for e in self.events:
                if e == target or e.kind == "out":
                    continue
                if e.kind == "collision" and e in once:
                    words, program = self._collide(e.who, "events")
                    options.append((words, program, e in led))
                elif e.kind == "in" and sum(x.kind == "in" and x.who == e.who for x in self.events) == 1:
                    words, program = self._meant(*e.who)
                    options.append((f"The {words}'s entrance", ["events", *program, "filter_in", "unique"], e in led))
            for k in set(range(len(self.solids))) - target.who:
                words, program = self._meant(k)
                options.append((f"The presence of the {words}", program, any(k in e.who for e in led)))
            options = [options[n] for n in self.rng.permutation(len(options))[:OPTIONS]]
            words, program = self._collide(target.who, "events")
            negate = bool(self.rng.random() < 0.3)
            asked.append(
                {
                    "question": f"Which of these is {'not ' * negate}responsible for this: {words}?",
                    "question_type": "explanatory",
                    "program": ["events", *program, "filter_ancestor", "belong_to", *["negate"] * negate],
                    "choices": self._choices([(w, p, right != negate) for w, p, right in options]),
                }
            )
        return asked

    def _predictive(self) -> list[dict[str, Any]]:
        after = [c for c in self.run.collisions if self.frames <= c.frame < self.frames + FUTURE]
        unclear = {frozenset(c.pair) for c in self.run.collisions if abs(c.frame - self.frames) < CLEAR}
        unclear |= {frozenset(c.pair) for c in self.run.collisions if abs(c.frame - self.frames - FUTURE) < CLEAR}
        happen = list(dict.fromkeys(frozenset(c.pair) for c in after if frozenset(c.pair) not in unclear))
        not_ = [p for p in self.pairs if p not in {frozenset(c.pair) for c in after} | unclear]
        asked = []
        for pair in happen[:3]:
            if not not_:
                break
            other = not_.pop(int(self.rng.integers(len(not_))))
            options = [(*self._collide(pair, "all_events"), True), (*self._collide(other, "all_events"), False)]
            asked.append(
                {
                    "question": "Which event will happen next?",
                    "question_type": "predictive",
                    "program": ["unseen_events", "belong_to"],
                    "choices": self._choices(options),
                }
            )
        return asked

    def _counterfactual(self) -> list[dict[str, Any]]:
        factual = {e.who for e in self.events if e.kind == "collision"}
        asked = []
        for k in self.rng.permutation(len(self.solids)).tolist():
            rest = [s for n, s in enumerate(self.solids) if n != k]
            run = simulate(rest, self.restitution, self.frames + CLEAR)

            def renamed(collision: Collision, k: int = k) -> frozenset[int]:
                return frozenset(n + (n >= k) for n in collision.pair)

            unclear = {renamed(c) for c in run.collisions if abs(c.frame - self.frames) < CLEAR}
            happen = {renamed(c) for c in run.collisions if c.frame < self.frames} - unclear
            open_ = [p for p in self.pairs if k not in p and p not in unclear]
            open_.sort(key=lambda p: (p not in happen ^ factual, p not in happen, self.rng.random()))
            chosen = open_[: int(self.rng.integers(3, OPTIONS + 1))]
            if not happen & set(chosen):
                continue
            words, program = self._meant(k)
            negate = bool(self.rng.random() < 0.5)
            options = [(*self._collide(p, "all_events"), (p in happen) != negate) for p in chosen]
            asked.append(
                {
                    "question": f"Without the {words}, which event will {'not ' * negate}happen?",
                    "question_type": "counterfactual",
                    "program": ["all_events", *program, "get_counterfact", "belong_to", *["negate"] * negate],
                    "choices": self._choices(options),
                }
            )
        return asked
