"""How the absence of a law shows in a recording, and where fits of it begin: plain data beside the law."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Literal

from polyworld.effects.conditions import FAR, Array, Conditions

WIDE = 300.0  # ordinary sizes that a strength may have at most
MOST_FREQUENCIES = 32  # of a grid


@dataclass(frozen=True)
class FreeParameter:
    """A parameter of a law that is fitted.

    typical: an ordinary departure from its neutral value. lower, upper: bounds, besides the law's own. plausible: the
    largest departure that physics makes ordinary; None where nothing is known. idle: whether it does nothing while the
    law is off (a place, a rhythm).
    """

    typical: float
    lower: float = -inf
    upper: float = inf
    plausible: float | None = None
    idle: bool = False


@dataclass(frozen=True)
class Way:
    """One way to add a law to a world: which of its parameters are fitted, and from where.

    free: the parameters that are fitted. values: parameters that are not at the law's default while the law is off.
    starts: where fits begin, as parameters that differ from these values. each: one law for all bodies; for each body
    one of its own; or for each body one with parameters of each run (`Conditions.unturned`) of its own. label: whom it
    acts on and by what rule, where there are several ways. same_as: other effects that this design cannot distinguish
    from it.
    """

    free: Mapping[str, FreeParameter]
    values: Mapping[str, float] = field(default_factory=dict)
    starts: Sequence[Mapping[str, float]] = ({},)
    label: str = ""
    each: Literal["", "body", "run"] = ""
    same_as: tuple[str, ...] = ()


@dataclass(frozen=True)
class Absence:
    """How the absence of a law shows, and how a fit adds it.

    ways: conditions of a recording -> the ways to add the law; none where it would not show. signature: what residuals
    look like where it is missing. effect: standard name of the effect, where that is not the law's; laws of one name
    are forms of one effect, whose signature stands with one of them. plain: whether it is a law expected of ordinary
    scenes; it stands with the signature.
    """

    ways: Callable[[Conditions], Sequence[Way]]
    signature: str = ""
    effect: str = ""
    plain: bool = False


def strength(typical: float, plausible: float | None = None) -> FreeParameter:
    """A parameter that is zero where the law is off, and at most WIDE times its typical size."""
    return FreeParameter(typical, -WIDE * typical, WIDE * typical, plausible)


def along(axes: Sequence[int], prefix: str, parameter: FreeParameter) -> dict[str, FreeParameter]:
    """The same for the components of a vector along some world axes: `prefix` and x, y or z."""
    return {f"{prefix}{'xyz'[a]}": parameter for a in axes}


def coordinates(prefix: str, place: Array, axes: Sequence[int] = (0, 1, 2)) -> dict[str, float]:
    """Components of a place (3,) along some world axes by name: `prefix` and x, y or z."""
    return {f"{prefix}{'xyz'[a]}": float(place[a]) for a in axes}


def somewhere(found: Conditions, axes: Sequence[int], prefix: str, far: float = FAR) -> dict[str, FreeParameter]:
    """A place that does nothing while the law is off, up to `far` sizes of the region visited off its middle.

    Plausible is a place as far from the middle as the region is large.
    """
    free: dict[str, FreeParameter] = {}
    for a in axes:
        middle = float(found.middle[a])
        free[f"{prefix}{'xyz'[a]}"] = FreeParameter(
            0.3 * found.spread, middle - far * found.size, middle + far * found.size, found.size, idle=True
        )
    return free
