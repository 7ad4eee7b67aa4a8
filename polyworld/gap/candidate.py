"""Describe an effect that may be missing, and how it is put into a world."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from polyworld.data.recording import Recording
from polyworld.estimation.unknown import Unknown
from polyworld.world import World

Group = Literal["force", "contact", "structure", "joint", "material", "base", "observer"]


@dataclass(frozen=True)
class Variant:
    """One way to put an effect into a world: the child world and what has to be fitted in it.

    world: the child, with the effect where it does nothing (at the unknowns' starts it moves as its parent does, or
    nearly so). unknowns: fitted together with the base parameters. starts: where fits begin, as values by name of
    unknown; several for an effect with a place or a frequency, and at least one. label: whom it acts on and by what
    rule, for readers; empty where there is but one way. same_as: other effects that this design cannot distinguish by
    construction (a uniform force on one body and a tilt), reported with every verdict. idle: unknowns that do nothing
    while the effect is off (its place, its rhythm), where it is off at all of its starts: the score test leaves them
    out, and takes the motion at all starts to be the parent's.
    """

    world: World
    unknowns: tuple[Unknown, ...]
    starts: tuple[Mapping[str, float], ...]
    label: str = ""
    same_as: tuple[str, ...] = ()
    idle: tuple[str, ...] = ()


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing: its law and how it shows.

    name: standard name, as verdicts state it. law: formula. variants: (world, recording) -> the ways to add it; none
    where it cannot apply. plain: a law that is expected of ordinary scenes: fitted and reported beside any richer
    answer. local: whether it acts at one place or in one run, so that it may be taken for an outlying run.
    """

    name: str
    group: Group
    law: str
    variants: Callable[[World, Recording], tuple[Variant, ...]]
    plain: bool = False
    local: bool = False
