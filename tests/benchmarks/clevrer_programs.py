"""CLEVRER's question programs, run on what is known of a scene.

A program is a stack machine's tape (Yi et al., CLEVRER, ICLR 2020, table of operations). Operations have the meaning
of the executor that its authors published; both its names and those of the question files are known. An event's
causes are, of each object that takes part in it, the event before, and the causes of that in turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
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
    """An entry into view, an exit from it, or a collision; `objects` are names. Also the clip's start and end."""

    kind: Literal["in", "out", "collision", "start", "end"]
    frame: float
    objects: frozenset[str]


class NotInScene(Exception):
    """A question speaks of something the scene does not have; the message says what."""


def _nothing_known(*_: object) -> Any:
    raise NotInScene("this is not known of the scene")


@dataclass(frozen=True)
class Known:
    """What programs are run on.

    events: those of the clip; unseen: those after it; last: its last frame. moving: whether an object that is in view
    at a frame moves, None where it is out of view; frame None: at any time. without: the events of the clip if an
    object had not been there.
    """

    things: Sequence[Thing]
    events: Sequence[Happening]
    unseen: Sequence[Happening] = ()
    last: float = 127.0
    moving: Callable[[str, float | None], bool | None] = field(default=_nothing_known)
    without: Callable[[str], Sequence[Happening]] = field(default=_nothing_known)


COLORS = {"gray", "red", "blue", "green", "brown", "cyan", "purple", "yellow"}
MATERIALS = {"metal", "rubber"}
SHAPES = {"cube", "sphere", "cylinder"}
ORDERS = {"first": 0, "second": 1, "last": -1}
LITERALS = COLORS | MATERIALS | SHAPES | set(ORDERS) | {"null"}


def run(program: Sequence[str], known: Known, stack: list[Any] | None = None) -> Any:
    """Run a program on a stack (a choice's result may lie on it already); returns what is on top at the end.

    Raises NotInScene where the scene has not what is spoken of, and ValueError for an operation not known here.
    """
    stack = [] if stack is None else stack
    for token in program:
        if token in LITERALS:
            stack.append(token)
        elif token in _SOURCES:
            stack.append(_SOURCES[token](known))
        elif token in _ONE:
            stack.append(_ONE[token](known, stack.pop()))
        elif token in _TWO:
            second, first = stack.pop(), stack.pop()
            stack.append(_TWO[token](known, first, second))
        else:
            raise ValueError(f"operation {token!r} is none of CLEVRER's")
    return stack[-1]


def answer_choice(question: Sequence[str], choice: Sequence[str], known: Known) -> bool:
    """Return whether a choice of a question is correct."""
    return bool(run(question, known, [run(choice, known)]))


def answer_words(program: Sequence[str], known: Known) -> str:
    """Answer a descriptive question as the question files do: a word, a number, yes or no."""
    said = run(program, known)
    return {True: "yes", False: "no"}[said] if isinstance(said, bool) else str(said)


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


def _events(known: Known) -> list[Happening]:
    ends = [Happening("start", 0.0, frozenset()), Happening("end", known.last, frozenset())]
    return sorted([*known.events, *ends], key=lambda e: e.frame)


def _possible(known: Known) -> list[Happening]:
    names = [t.name for t in known.things]
    return [Happening("collision", -1.0, frozenset(pair)) for pair in combinations(names, 2)]


def _unique(_: Known, items: list[Any]) -> Any:
    if len(items) != 1:
        named = [t.name if isinstance(t, Thing) else f"{t.kind} at frame {t.frame:.0f}" for t in items]
        raise NotInScene(f"the question means one thing, the scene has {len(items)}: {named}")
    return items[0]


def _boundary(kind: str) -> Callable[[Known, list[Happening]], Happening]:
    return lambda _, events: next(e for e in events if e.kind == kind)


def _having(attribute: str) -> Callable[[Known, list[Thing], str], list[Thing]]:
    return lambda _, things, wanted: [t for t in things if getattr(t, attribute) == wanted]


def _in_motion(wanted: bool) -> Callable[[Known, list[Thing], Any], list[Thing]]:
    def chosen(known: Known, things: list[Thing], frame: Any) -> list[Thing]:
        at = None if frame == "null" else frame
        return [t for t in things if known.moving(t.name, at) is wanted]

    return chosen


def _of_kind(kind: str) -> Callable[[Known, list[Happening], Any], list[Happening]]:
    def chosen(_: Known, events: list[Happening], things: Any) -> list[Happening]:
        names = {t.name for t in ([things] if isinstance(things, Thing) else things)}
        return [e for e in events if e.kind == kind and e.objects & names]

    return chosen


def _ordered(_: Known, events: list[Happening], order: str) -> Happening:
    place = ORDERS[order]
    if not events or place >= len(events):
        raise NotInScene(f"there is no {order} one of {len(events)} events")
    return events[place]


def _object_of(known: Known, event: Happening) -> Thing:
    if event.kind not in ("in", "out"):
        raise NotInScene(f"a single object of a {event.kind} is asked for")
    return next(t for t in known.things if t.name in event.objects)


def _partner(known: Known, event: Happening, thing: Thing) -> Thing:
    if event.kind != "collision" or thing.name not in event.objects:
        raise NotInScene(f"{thing.name} has no partner in the {event.kind} at frame {event.frame:.0f}")
    return next(t for t in known.things if t.name in event.objects - {thing.name})


def _ancestors(known: Known, events: list[Happening], event: Happening) -> list[Happening]:
    led = causes(event, known.events)
    return [e for e in events if e in led]


def _without(known: Known, events: list[Happening], thing: Thing) -> list[Happening]:
    pairs = {e.objects for e in known.without(thing.name) if e.kind == "collision"}
    return [e for e in events if e.objects in pairs]


def _belongs(_: Known, candidate: Any, events: list[Happening]) -> bool:
    if isinstance(candidate, Thing):
        return any(candidate.name in e.objects for e in events)
    return any((e.kind, e.objects) == (candidate.kind, candidate.objects) for e in events)


_SOURCES: dict[str, Callable[[Known], Any]] = {
    "objects": lambda known: list(known.things),
    "events": _events,
    "all_events": _possible,
    "unseen_events": lambda known: list(known.unseen),
    "start": lambda known: _boundary("start")(known, _events(known)),
    "end": lambda known: _boundary("end")(known, _events(known)),
}
_ONE: dict[str, Callable[[Known, Any], Any]] = {
    "unique": _unique,
    "count": lambda _, items: len(items),
    "exist": lambda _, items: bool(items),
    "negate": lambda _, said: not said,
    "filter_start": _boundary("start"),
    "filter_end": _boundary("end"),
    "query_color": lambda _, thing: thing.color,
    "query_material": lambda _, thing: thing.material,
    "query_shape": lambda _, thing: thing.shape,
    "query_frame": lambda _, event: event.frame,
    "query_object": _object_of,
    "counterfact_events": lambda known, thing: list(known.without(thing.name)),
}
_TWO: dict[str, Callable[[Known, Any, Any], Any]] = {
    "filter_color": _having("color"),
    "filter_material": _having("material"),
    "filter_shape": _having("shape"),
    "filter_moving": _in_motion(True),
    "filter_stationary": _in_motion(False),
    "filter_in": _of_kind("in"),
    "filter_out": _of_kind("out"),
    "filter_collision": _of_kind("collision"),
    "filter_order": _ordered,
    "filter_before": lambda _, events, event: [e for e in events if e.frame < event.frame],
    "filter_after": lambda _, events, event: [e for e in events if e.frame > event.frame],
    "filter_ancestor": _ancestors,
    "query_collision_partner": _partner,
    "filter_counterfact": _without,
    "belong_to": _belongs,
}
# The names of the question files beside those of the executor.
_ONE |= {"get_frame": _ONE["query_frame"], "get_object": _ONE["query_object"]}
_TWO |= {
    "get_col_partner": _partner,
    "get_counterfact": _without,
    "filter_resting": _TWO["filter_stationary"],
}
