"""CLEVRER's explanatory question programs, run on the objects and events of a scene.

A program is a stack machine's tape (Yi et al., CLEVRER, ICLR 2020, table of operations); operations have the meaning of
the executor that its authors published. An event's causes are, of each object that takes part in it, the event before,
and the causes of that in turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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


@dataclass(frozen=True)
class Known:
    """Objects and events that programs are run on."""

    things: Sequence[Thing]
    events: Sequence[Happening]


LITERALS = {"gray", "red", "blue", "green", "brown", "cyan", "purple", "yellow", "metal", "rubber"}
LITERALS |= {"cube", "sphere", "cylinder"}


def run(program: Sequence[str], known: Known, stack: list[Any]) -> Any:
    """Run a program on a stack (a choice's result may lie on it already); returns what is on top at the end.

    Raises NotInScene where the scene has not what is spoken of, and ValueError for an unknown operation.
    """
    for token in program:
        if token in LITERALS:
            stack.append(token)
        elif token in _SOURCES:
            stack.append(_SOURCES[token](known))
        elif token in _ONE:
            stack.append(_ONE[token](stack.pop()))
        elif token in _TWO:
            second, first = stack.pop(), stack.pop()
            stack.append(_TWO[token](known, first, second))
        else:
            raise ValueError(f"operation {token!r} is none of CLEVRER's explanatory questions")
    return stack[-1]


def answer_choice(question: Sequence[str], choice: Sequence[str], known: Known) -> bool:
    """Return whether a choice of a question is correct."""
    return bool(run(question, known, [run(choice, known, [])]))


def causes(event: Happening, events: Sequence[Happening]) -> list[Happening]:
    """Return all events that led to this one."""
    ordered = sorted(events, key=lambda e: e.frame)
    found: list[Happening] = []
    waiting = [event]
    while waiting:
        later = waiting.pop()
        for name in later.objects:
            own = [e for e in ordered if name in e.objects]
            place = own.index(later)
            if place > 0 and own[place - 1] not in found:
                found.append(own[place - 1])
                waiting.append(own[place - 1])
    return sorted(found, key=lambda e: e.frame)


def _unique(items: list[Any]) -> Any:
    if len(items) != 1:
        named = [t.name if isinstance(t, Thing) else f"{t.kind} at frame {t.frame:.0f}" for t in items]
        raise NotInScene(f"the question means one thing, the scene has {len(items)}: {named}")
    return items[0]


def _having(attribute: str) -> Callable[[Known, list[Thing], str], list[Thing]]:
    return lambda _, things, wanted: [t for t in things if getattr(t, attribute) == wanted]


def _of_kind(kind: str) -> Callable[[Known, list[Happening], Any], list[Happening]]:
    def chosen(_: Known, events: list[Happening], things: Any) -> list[Happening]:
        names = {t.name for t in ([things] if isinstance(things, Thing) else things)}
        return [e for e in events if e.kind == kind and e.objects & names]

    return chosen


def _ancestors(known: Known, events: list[Happening], event: Happening) -> list[Happening]:
    led = causes(event, known.events)
    return [e for e in events if e in led]


def _belongs(_: Known, candidate: Any, events: list[Happening]) -> bool:
    if isinstance(candidate, Thing):
        return any(candidate.name in e.objects for e in events)
    return any((e.kind, e.objects) == (candidate.kind, candidate.objects) for e in events)


_SOURCES: dict[str, Callable[[Known], Any]] = {
    "objects": lambda known: list(known.things),
    "events": lambda known: sorted(known.events, key=lambda e: e.frame),
}
_ONE: dict[str, Callable[[Any], Any]] = {"unique": _unique, "negate": lambda said: not said}
_TWO: dict[str, Callable[[Known, Any, Any], Any]] = {
    "filter_color": _having("color"),
    "filter_material": _having("material"),
    "filter_shape": _having("shape"),
    "filter_in": _of_kind("in"),
    "filter_out": _of_kind("out"),
    "filter_collision": _of_kind("collision"),
    "filter_ancestor": _ancestors,
    "belong_to": _belongs,
}
