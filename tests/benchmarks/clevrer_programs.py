"""CLEVRER's question programs, run on a list of events.

A program is a stack machine's tape (Yi et al., CLEVRER, ICLR 2020, table of operations). An event's causes are
what happened before it to the objects that take part in it, and the causes of that in turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal


@dataclass(frozen=True)
class Thing:
    """An object as questions name it."""

    name: str
    color: str
    material: str
    shape: str


@dataclass(frozen=True)
class Happening:
    """An entry into view, an exit from it, or a collision; `objects` are names."""

    kind: Literal["in", "out", "collision"]
    frame: float
    objects: frozenset[str]


class NotInScene(Exception):
    """A question speaks of something the scene does not have; the message says what."""


COLORS = {"gray", "red", "blue", "green", "brown", "cyan", "purple", "yellow"}
MATERIALS = {"metal", "rubber"}
SHAPES = {"cube", "sphere", "cylinder"}


def run(program: Sequence[str], things: Sequence[Thing], events: Sequence[Happening], stack: list[Any]) -> Any:
    """Run a program on a stack (a choice's result may lie on it already); returns what is on top at the end.

    Raises NotInScene where `unique` does not find exactly one, and ValueError for an operation not known here.
    """
    for token in program:
        _step(token, things, events, stack)
    return stack[-1]


def answer_choice(
    question: Sequence[str], choice: Sequence[str], things: Sequence[Thing], events: Sequence[Happening]
) -> bool:
    """Return whether a choice of an explanatory question is correct."""
    stack: list[Any] = []
    run(choice, things, events, stack)
    return bool(run(question, things, events, [stack[-1]]))


def causes(event: Happening, events: Sequence[Happening]) -> list[Happening]:
    """Return all events that led to this one: the earlier ones of its participants, and theirs, and so on."""
    found: list[Happening] = []
    waiting = [event]
    while waiting:
        later = waiting.pop()
        for candidate in events:
            if candidate.frame < later.frame and candidate.objects & later.objects and candidate not in found:
                if candidate.kind == "out":  # what has left the view causes nothing that is seen
                    continue
                found.append(candidate)
                waiting.append(candidate)
    return sorted(found, key=lambda e: e.frame)


def _step(token: str, things: Sequence[Thing], events: Sequence[Happening], stack: list[Any]) -> None:
    if token == "events":
        stack.append(list(events))
    elif token == "objects":
        stack.append(list(things))
    elif token in COLORS | MATERIALS | SHAPES:
        stack.append(token)
    elif token in ("filter_color", "filter_material", "filter_shape"):
        wanted, items = stack.pop(), stack.pop()
        field = token.removeprefix("filter_")
        stack.append([t for t in items if getattr(t, field) == wanted])
    elif token == "unique":
        items = stack.pop()
        if len(items) != 1:
            named = [t.name if isinstance(t, Thing) else f"{t.kind} at frame {t.frame:.0f}" for t in items]
            raise NotInScene(f"the question means one thing, the scene has {len(items)}: {named}")
        stack.append(items[0])
    elif token in ("filter_in", "filter_out", "filter_collision"):
        thing, items = stack.pop(), stack.pop()
        kind = token.removeprefix("filter_")
        stack.append([e for e in items if e.kind == kind and thing.name in e.objects])
    elif token == "filter_ancestor":
        target, items = stack.pop(), stack.pop()
        stack.append(causes(target, items))
    elif token == "belong_to":
        items, candidate = stack.pop(), stack.pop()
        if isinstance(candidate, Thing):
            stack.append(any(candidate.name in e.objects for e in items))
        else:
            stack.append(candidate in items)
    elif token == "negate":
        stack.append(not stack.pop())
    else:
        raise ValueError(f"operation {token!r} is not one of the explanatory questions'")
