"""Draw questions near their limit, and answer them from the simulation run on or with a change."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from tests.benchmarks.examination_scenes.world import SAMPLE, Edit, Run, Scene, edited, moved, simulate

NEAR = 0.1, 0.4  # a value is this far from its threshold, in parts of the threshold
STEPS_AGREE = 0.01  # [m], [s], [m/s] between the step and its half
SPLASHED = 0.02  # [m], [s], [m/s] the same of water
STEADY = 0.06  # [m] change of a place when hidden quantities change by a little; more cannot be asked of a clip
BOUNCIER = 0.03, 0.2  # of restitution, by which it is varied; in water, where most clips show no bounce
Question = dict[str, Any]


@dataclass
class World:
    """Hold a scene after edits, with its runs: the truth, a run of the double step, and perturbed runs."""

    scene: Scene
    edits: list[Edit]
    duration: float

    @cached_property
    def truth(self) -> Run:
        """Run the scene with half the step."""
        return simulate(edited(self.scene, self.edits), self.duration)

    @cached_property
    def others(self) -> tuple[Run, Run]:
        """Run it with the whole step, and with velocities 1% higher, friction 3%, restitution 0.03; 0.2 in water."""
        scene = edited(self.scene, self.edits)
        bouncier = BOUNCIER[self.scene.water is not None]
        near = replace(
            scene,
            bodies=tuple(moved(b, 1.01) for b in scene.bodies),
            friction={name: 1.03 * f for name, f in scene.friction.items()},
            restitution=scene.restitution + bouncier,
            floor_restitution=scene.floor_restitution + bouncier * (scene.floor_restitution > 0),
        )
        return simulate(scene, self.duration, 1), simulate(near, self.duration, 1)


def spoken(name: str) -> str:
    """Return a name as a sentence has it."""
    return "the " + name.replace("_", " ")


def condition(edits: list[Edit]) -> str:
    """Return the opening of a counterfactual question."""
    if not edits:
        return ""
    names = " and ".join(spoken(e["object"]) for e in edits)
    if edits[0]["action"] == "remove":
        return f"If {names} had not been there from the first frame on (all else in the first frame the same): "
    return f"If the velocity of {names} in the first frame had been halved (spin too; all else the same): "


def touch(run: Run, pair: frozenset[str], since: float) -> float:
    """Return how long after `since` two bodies first touch [s], or infinity."""
    hits = np.flatnonzero(run.gaps[pair][round(since / SAMPLE) :] <= 0.0)
    return float(hits[0] * SAMPLE) if len(hits) else np.inf


def limit(rng: np.random.Generator, value: float, above: bool) -> float | None:
    """Return a threshold of two digits near a value, above or below it, or None."""
    part = rng.uniform(0.12, 0.37)
    threshold = float(f"{value / (1 - part if above else 1 + part):.2g}")
    near = threshold > 0 and NEAR[0] <= abs(value - threshold) / threshold <= NEAR[1]
    return threshold if near and (value < threshold) == above else None


def round_time(time: float) -> float:
    """Return a time without binary residue [s]."""
    return round(float(time), 6)


class Asker:
    """Draw the questions of a scene. end: time of the clip's last frame [s]; axes: those of places."""

    def __init__(self, rng: np.random.Generator, scene: Scene, end: float, horizon: float, axes: str) -> None:
        self.rng, self.end, self.horizon = rng, end, horizon
        self.axes, self.indices = axes, ["xyz".index(a) for a in axes]
        self.names = [b.name for b in scene.named]
        moving = [b.name for b in scene.bodies if any(b.velocity)]
        duration = end + horizon + 0.02
        tied: list[tuple[str, ...]] = [s.bodies for s in scene.strings if len(s.bodies) == 2]
        halves = tied or [(n,) for n in moving]
        things = [b.name for b in scene.bodies] + ([scene.soft.name] if scene.soft else [])
        things += ["water"] if scene.water else []
        self.agree = SPLASHED if scene.water else STEPS_AGREE
        self.fact = World(scene, [], duration)
        removed: list[list[Edit]] = [[{"action": "remove", "object": n}] for n in things if len(things) > 1]
        halved: list[list[Edit]] = [
            [{"action": "scale_velocity", "object": n, "factor": 0.5} for n in group] for group in halves
        ]
        self.changed = [
            World(scene, edits[i], duration) for edits in (removed, halved) for i in rng.permutation(len(edits))[:2]
        ]

    def times(self) -> Iterator[float]:
        """Yield times after the clip's end to ask about [s]."""
        for after in self.rng.permutation(np.arange(0.3, self.horizon + 1e-9, 0.05)):
            yield round(float(after), 2)

    def there(self, world: World) -> list[str]:
        """Return the names that are in a world, shuffled."""
        return [str(n) for n in self.rng.permutation([n for n in self.names if n in world.truth.places])]

    def place(self, world: World, name: str, after: float) -> Question | None:
        """Return a question for a place, or None where it is not worth asking."""
        at = self.end + after
        true = world.truth.place(name, at)[self.indices]
        last = self.fact.truth.place(name, self.end)[self.indices]
        stays = float(np.linalg.norm(true - last))
        fact = self.fact.truth.place(name, at)[self.indices]
        if stays < 0.08 or (world.edits and np.linalg.norm(true - fact) < 0.05):
            return None
        coarse, near = (r.place(name, at)[self.indices] for r in world.others)
        if np.linalg.norm(true - coarse) > self.agree or np.linalg.norm(true - near) > STEADY:
            return None
        when = f"{after:g} s after the {'moment of the ' if world.edits else ''}clip's last frame"
        verb = "where would the centre of {} be" if world.edits else "Where is the centre of {}"
        text = f"{condition(world.edits)}{verb.format(spoken(name))} ({', '.join(self.axes)} in m) {when}?"
        return {
            "text": text, "ask": "where", "object": name, "at": round_time(at), "axes": self.axes, "edits": world.edits,
            "answer": np.round(true, 4).tolist(), "stays": round(stays, 4),
        }  # fmt: skip

    def whether(self, world: World, kind: str, pair: list[str], after: float, yes: bool) -> Question | None:
        """Return a yes/no question whose answer is `yes`, near its limit, or None."""
        at, changed, (a, b) = self.end + after, bool(world.edits), pair
        since = 0.0 if changed else self.end
        measure: Callable[[Run], float]
        if kind == "moved_by_more_than":
            measure, unit = lambda r: float(np.linalg.norm(r.place(a, at) - r.place(a, since))), 0.08
        elif kind == "nearer_than":
            measure, unit = lambda r: float(np.linalg.norm(r.place(a, at) - r.place(b, at))), 0.1
        elif kind == "at_rest":
            measure, unit = lambda r: r.speed(a, at), 0.1
        else:
            measure, unit = lambda r: touch(r, frozenset(pair), since), 0.1
        value = measure(world.truth)
        if not np.isfinite(value):
            return self.miss(world, pair, after) if not yes else None
        threshold = limit(self.rng, value, above=yes != (kind == "moved_by_more_than"))
        if threshold is None or value < unit:
            return None
        others = [measure(r) for r in world.others]
        agree = all((v < threshold) == (value < threshold) for v in others)
        if not agree or abs(value - others[0]) > self.agree:
            return None
        predicate: dict[str, Any] = {"predicate": kind}
        if kind == "collides":
            begun = self.fact.truth.gaps[frozenset(pair)][round(self.end / SAMPLE)] < 0.02
            late = since + threshold - self.end
            if begun or since + value < self.end + 0.03 or late < 0.1 or late > self.horizon:
                return None
            return self.collision(world, pair, threshold, "yes" if yes else "no", value, threshold)
        when = f"{after:g} s after the {'moment of the ' if changed else ''}clip's last frame"
        start = "in the first frame" if changed else "in that last frame"
        will = "would" if changed else "will"
        if kind == "moved_by_more_than":
            predicate |= {"object": a, "distance": threshold, "since": round_time(since)}
            text = (
                f"{when}, {will} the centre of {spoken(a)} be more than {threshold:g} m away from where it is {start}?"
            )
        elif kind == "nearer_than":
            predicate |= {"a": a, "b": b, "distance": threshold}
            text = f"{when}, {will} the centres of {spoken(a)} and {spoken(b)} be less than {threshold:g} m apart?"
        else:
            predicate |= {"object": a, "speed": threshold}
            text = f"{when}, {will} {spoken(a)} be moving slower than {threshold:g} m/s?"
        interval = [round_time(at)] * 2
        return self.written(world, text, predicate, interval, "yes" if yes else "no", value, threshold)

    def miss(self, world: World, pair: list[str], after: float) -> Question | None:
        """Return a question whether two bodies collide that pass each other closely; the answer is no."""
        since = 0.0 if world.edits else self.end
        value, threshold, gaps = 0.0, 1.0, []
        for run in (world.truth, *world.others):
            part = run.gaps[frozenset(pair)][round(since / SAMPLE) : round((self.end + after) / SAMPLE)]
            low = int(part.argmin()) + round(since / SAMPLE)
            gaps.append(float(part.min()))
            if run is world.truth:
                value = float(np.linalg.norm(run.places[pair[0]][low] - run.places[pair[1]][low]))
                threshold = value - gaps[0]
        near = NEAR[0] <= (value - threshold) / threshold <= NEAR[1]
        if not near or min(gaps) <= 0.0 or abs(gaps[0] - gaps[1]) > self.agree:
            return None
        return self.collision(world, pair, round(self.end + after - since, 3), "no", value, threshold)

    def collision(
        self, world: World, pair: list[str], within: float, answer: str, value: float, threshold: float
    ) -> Question:
        """Return a question whether two bodies collide within a time [s]."""
        names = f"{spoken(pair[0])} and {spoken(pair[1])}"
        if world.edits:
            text, since = f"would {names} collide within {within:g} s of the first frame?", 0.0
        else:
            text, since = f"after the clip's last frame, will {names} collide within the next {within:g} s?", self.end
        predicate = {"predicate": "collides", "a": pair[0], "b": pair[1]}
        return self.written(world, text, predicate, [since, round_time(since + within)], answer, value, threshold)

    def written(
        self, world: World, text: str, predicate: dict[str, Any], interval: list[float], answer: str, value: float,
        threshold: float,
    ) -> Question:  # fmt: skip
        """Return a yes/no question as scene.json has it."""
        text = condition(world.edits) + text
        return {
            "text": text[0].upper() + text[1:], "ask": "whether", "predicate": predicate, "interval": interval,
            "edits": world.edits, "answer": answer, "value": round(value, 4), "threshold": round(threshold, 4),
        }  # fmt: skip

    def draw(self) -> list[Question] | None:
        """Return four yes/no questions and four places, half of each counterfactual, or None where some lack."""
        result: list[Question] = []
        order = self.rng.permutation([True, False]).tolist()
        for changed in (False, True):
            used: set[str] = set()
            for yes in order:
                asked = self.first_whether(changed, bool(yes), used)
                if asked is None:
                    return None
                used.add(asked["predicate"]["predicate"])
                result.append(asked)
        for changed in (False, True):
            named: set[str] = set()
            for _ in range(2):
                found = self.first_place(changed, named)
                if found is None:
                    return None
                named.add(found["object"] + str(found["edits"]))
                result.append(found)
        return result

    def worlds(self, changed: bool) -> list[World]:
        """Return the worlds to ask about, shuffled."""
        return [self.changed[i] for i in self.rng.permutation(len(self.changed))] if changed else [self.fact]

    def first_whether(self, changed: bool, yes: bool, used: set[str]) -> Question | None:
        """Return a yes/no question of a predicate not used yet, or None."""
        kinds = ["collides", *(str(k) for k in self.rng.permutation(["moved_by_more_than", "nearer_than", "at_rest"]))]
        for kind in kinds if self.rng.random() < 0.5 else [*kinds[1:], kinds[0]]:
            for world in self.worlds(changed) if kind not in used else ():
                names = self.there(world)
                for a, b in ((a, b) for a in names for b in names if a != b):
                    for after in list(self.times())[:4]:
                        asked = self.whether(world, kind, [a, b], after, yes)
                        if asked is not None:
                            return asked
        return None

    def first_place(self, changed: bool, named: set[str]) -> Question | None:
        """Return a question for the place of a body not yet asked about, or of one asked about at another time."""
        for fresh in (True, False):
            for world in self.worlds(changed):
                for name in self.there(world):
                    if fresh and name + str(world.edits) in named:
                        continue
                    for after in self.times():
                        found = self.place(world, name, after)
                        if found is not None:
                            return found
        return None
