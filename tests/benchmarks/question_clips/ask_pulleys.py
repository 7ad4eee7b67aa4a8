"""Questions about ropes over pulleys in the layout of ContPhy's question engine, answered from MuJoCo alone.

`program` holds the features that its engine writes: of mass [color, shape, comparison, factor, color, shape], of the
counts [feature], of existence [color, shape], of counterfactuals {question: [object, increase or decrease, "mass"],
choices: {letter: [object, motion or rotation, way]}}, of goals {question: [object, motion or rotation, way], choices:
{letter: [object, increase or decrease, "mass"]}}. That engine asks nothing predictive of this group; `rope_predictive`
is ours: [object, "higher", object, seconds after the clip].
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.random import Generator

from .pulleys import COLORS, MOVES, RATE, Group, Part, Run, changed, simulate

MUCH = 5.0  # by what factor a much heavier thing is heavier, and a much lighter one lighter
BRANCH = 12  # frames from the start in which directions are judged: before a load reaches a wheel
AHEAD = (0.1, 0.2, 0.3)  # s after the clip
APART = 0.04  # m: heights nearer than this are not compared
EQUAL = 0.01  # share by which equal masses differ at most
COMPARISONS = ("greater than", "less than", "equal to")

Item = dict[str, Any]


def ask(rng: Generator, groups: list[Group], frames: int) -> dict[str, list[Item]]:
    """Return questions by family."""
    names = [p.name for g in groups for p in (*g.parts, *g.hung) if p.kind != "fixed"]
    loads = [p for g in groups for p in g.loads]
    what_if = {
        (p.name, way): simulate(changed(groups, p.name, MUCH if way == "increase" else 1 / MUCH), BRANCH)
        for p in loads
        for way in ("increase", "decrease")
    }
    return {
        "mass": _masses(rng, groups),
        "color": _colors(rng, groups),
        "existence": _existence(rng, groups),
        "rope_predictive": _predictive(rng, groups, frames),
        "rope_counterfactual2": _single(rng, names, what_if),
        "rope_counterfactual": _several(rng, names, what_if),
        "rope_goaldriven": _goals(rng, names, what_if),
    }


def way_of(run: Run, name: str, what: str) -> str:
    """Return which way a thing moved or turned over the clip, stationary below `MOVES`."""
    if what == "rotation":
        turn = run.turns[name]
        return "stationary" if abs(turn) < MOVES / 0.1 else "clockwise" if turn > 0 else "anti-clockwise"
    if name not in run.heights:
        return "stationary"  # a fixed wheel
    rise = run.heights[name][-1] - run.heights[name][0]
    return "stationary" if abs(rise) < MOVES else "up" if rise > 0 else "down"


def _open(family: str, question: str, answer: str, program: Sequence[Any]) -> Item:
    return {
        "question": question,
        "answer": answer,
        "question_family": family,
        "positive": [answer],
        "negative": [],
        "program": list(program),
        "answer_type": "open_ended",
    }


def _closed(family: str, question: str, options: Sequence[tuple[str, list[str], bool]], about: list[str]) -> Item:
    letters = "ABCDE"[: len(options)]
    text = "\n".join([question, *(f"{c}. {words}" for c, (words, _, _) in zip(letters, options, strict=True))])
    return {
        "question": text,
        "answer": " ".join(c for c, (_, _, right) in zip(letters, options, strict=True) if right),
        "question_family": family,
        "positive": [words for words, _, right in options if right],
        "negative": [words for words, _, right in options if not right],
        "program": {"question": about, "choices": {c: f for c, (_, f, _) in zip(letters, options, strict=True)}},
        "answer_type": "multiple_choice",
    }


def _masses(rng: Generator, groups: list[Group]) -> list[Item]:
    found = []
    pairs = [(a, b, True) for g in groups for a in g.loads for b in g.loads if a.name < b.name]
    if len(groups) == 2:
        pairs.append((groups[0].loads[0], groups[1].loads[0], False))
    for a, b, known in pairs:
        hung = {p.name for g in groups for p in g.hung}
        factor, word = (2.0, "twice ") if a.name in hung else (0.5, "half ") if b.name in hung else (1.0, "")
        comparison = str(rng.choice(COMPARISONS))
        ratio = a.mass / (b.mass * factor)
        truth = "equal to" if abs(ratio - 1) < EQUAL else "greater than" if ratio > 1 else "less than"
        answer = ("yes" if comparison == truth else "no") if known else "can not answer"
        text = f"Is the mass of the {a.name} {comparison} {word}that of the {b.name}?"
        found.append(_open("mass", text, answer, [*a.name.split(" "), comparison, word, *b.name.split(" ")]))
    return found


def _colors(rng: Generator, groups: list[Group]) -> list[Item]:
    used = [c for g in groups for c in (g.rope, *(p.color for p in (*g.parts, *g.hung)))]
    color = str(rng.choice(list(COLORS)))
    return [_open("color", f"How many {color} objects are there in the video?", str(used.count(color)), [color])]


def _existence(rng: Generator, groups: list[Group]) -> list[Item]:
    loads = [p for g in groups for p in g.loads]
    color = loads[int(rng.integers(len(loads)))].color
    shape = str(rng.choice(["cube", "sphere"]))
    there = any(p.name == f"{color} {shape}" for p in loads)
    text = f"Is there any {color} {shape} in the video?"
    return [_open("existence", text, "yes" if there else "no", [color, shape])]


def _predictive(rng: Generator, groups: list[Group], frames: int) -> list[Item]:
    loads: list[Part] = [p for g in groups for p in g.loads]
    ahead = float(rng.choice(AHEAD))
    run = simulate(groups, frames + round(ahead * RATE))
    found = []
    for n, a in enumerate(loads):
        for b in loads[n + 1 :]:
            first, second = (a, b) if rng.random() < 0.5 else (b, a)
            gap = run.heights[first.name] - run.heights[second.name]
            if abs(gap[-1]) > APART:
                when = f"{ahead:g} s after the video ends"
                text = f"Will the {first.name} be higher than the {second.name} {when}?"
                answer = "yes" if gap[-1] > 0 else "no"
                found.append(_open("rope_predictive", text, answer, [first.name, "higher", second.name, ahead]))
    return found


def _kinds(name: str) -> tuple[str, tuple[str, ...]]:
    if name.endswith("pulley"):
        return "rotation", ("clockwise", "anti-clockwise", "stationary")
    return "motion", ("down", "up", "stationary")


def _words(name: str, what: str, way: str) -> str:
    verb = "rotate" if what == "rotation" else "move"
    return f"The {name} would not {verb}" if way == "stationary" else f"The {name} would {verb} {way}"


def _single(rng: Generator, names: list[str], what_if: dict[tuple[str, str], Run]) -> list[Item]:
    found = []
    for (load, change), run in what_if.items():
        if rng.random() < 0.5:
            continue
        name = str(rng.choice(names))
        what, ways = _kinds(name)
        truth = way_of(run, name, what)
        options = [(way.capitalize(), [name, what, way], way == truth) for way in ways]
        verb = "rotate" if what == "rotation" else "move"
        text = f"If the {load} were much {_changed(change)}, which direction would the {name} {verb}?"
        found.append(_closed("rope_counterfactual2", text, options, [load, change, "mass"]))
    return found


def _several(rng: Generator, names: list[str], what_if: dict[tuple[str, str], Run]) -> list[Item]:
    found = []
    keys = list(what_if)
    for n in rng.permutation(len(keys))[:2]:
        load, change = keys[n]
        options = []
        for name in rng.permutation(names)[:4]:
            what, ways = _kinds(str(name))
            way = str(rng.choice(ways))
            right = way_of(what_if[keys[n]], str(name), what) == way
            options.append((_words(str(name), what, way), [str(name), what, way], right))
        if not any(right for _, _, right in options):  # as in the engine, one at least is right
            name = options[0][1][0]
            what, _ = _kinds(name)
            truth = way_of(what_if[keys[n]], name, what)
            options[0] = (_words(name, what, truth), [name, what, truth], True)
        text = f"If the {load} were much {_changed(change)}, which of the following would happen?"
        found.append(_closed("rope_counterfactual", text, options, [load, change, "mass"]))
    return found


def _goals(rng: Generator, names: list[str], what_if: dict[tuple[str, str], Run]) -> list[Item]:
    found: list[Item] = []
    for name in rng.permutation(names).tolist():
        what, ways = _kinds(name)
        way = str(rng.choice(ways[:2]))
        options = [
            (f"{change.capitalize()} the mass of the {load}", [load, change, "mass"], way_of(run, name, what) == way)
            for (load, change), run in what_if.items()
        ]
        options = [options[n] for n in rng.permutation(len(options))[:4]]
        if any(right for _, _, right in options) and len(found) < 2:
            verb = "rotate" if what == "rotation" else "move"
            found.append(
                _closed(
                    "rope_goaldriven",
                    f"If we want the {name} to {verb} {way}, what can we do?",
                    options,
                    [name, what, way],
                )
            )
    return found


def _changed(change: str) -> str:
    return "heavier" if change == "increase" else "lighter"
