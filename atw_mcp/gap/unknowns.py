"""Numbers of a world that are refitted together with every effect."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from atw_mcp.calls.app import App
from atw_mcp.worlds.last_fit import last_fit
from polyworld.estimation.unknown import Unknown
from polyworld.world import World
from polyworld.world.parameter_tables import STATE_PARAMETERS
from polyworld.world.parameters import read_parameter, specification

FRAME, CLOCK = "time.seconds_per_frame", "observer.clock"
STATES = {path.rpartition(".")[0] for path in STATE_PARAMETERS} | {"shift"}
ERRORS = 5.0  # standard errors that make an ordinary change of a fitted number
SHARE = 0.05  # of its range, where no standard error is known


def base_unknowns(app: App, world: World, paths: Sequence[str] | None) -> tuple[Unknown, ...]:
    """Return the numbers refitted in every hypothesis: those given by path, else those FitWorld fitted in this world.

    Initial states are always free and not among them. Raises KeyError or ValueError for a path that cannot be fitted.
    """
    if paths is not None:
        return unknowns_at(world, paths)
    found: list[Unknown] = []
    taken: set[str] = set()
    fit = last_fit(app, world)
    # A friction that several constants make up is refitted as its own: those of single objects come first. Restitution
    # is refitted in common, since few bodies are seen to collide often.
    values = [
        v for v in ([] if fit is None else fit.values) if not v["name"].startswith("restitution of ") or not _departs(v)
    ]
    for value in sorted(values, key=lambda v: len(v["paths"])):
        if value["paths"] == [FRAME]:  # measured times follow the world's frames: what may be wrong is their clock
            error = value["standard_error"]
            found.append(unknown_of(world, (CLOCK,), "clock", error=None if error is None else error / value["value"]))
            continue
        powers = value.get("powers") or [1.0] * len(value["paths"])
        own = [p for p, power in zip(value["paths"], powers, strict=True) if power > 0.0]  # the others divide by it
        known = tuple(p for p in own if p not in taken and not _is_state(p) and _readable(world, p))
        taken |= set(known)
        if known:
            found.append(unknown_of(world, known, value["name"], *_range(value, powers)))
    return tuple(found)


def _departs(value: dict[str, Any]) -> bool:
    return " over " in value["name"]


def _range(value: dict[str, Any], powers: Sequence[float]) -> tuple[float | None, float | None, float | None]:
    """Return bounds and standard error of a fitted value; None where it is not the parameter itself."""
    if any(power != 1.0 for power in powers) or _departs(value):
        return None, None, None
    return value["lower"], value["upper"], value["standard_error"]


def unknowns_at(world: World, paths: Sequence[str]) -> tuple[Unknown, ...]:
    """Return one unknown for each parameter path, in the range that a fit searches."""
    return tuple(unknown_of(world, (path,), path) for path in dict.fromkeys(paths))


def unknown_of(
    world: World,
    paths: tuple[str, ...],
    name: str,
    lower: float | None = None,
    upper: float | None = None,
    error: float | None = None,
) -> Unknown:
    """Return an unknown that several paths share; bounds default to those a fit searches.

    error: a standard error that is known. Raises ValueError for initial states and for what the world leaves open.
    """
    if FRAME in paths:
        raise ValueError(f"{FRAME} is how frames are numbered; what the measured times may have wrong is {CLOCK}")
    spec = specification(world, paths[0])
    value = read_parameter(world, paths[0])
    if value is None:
        raise ValueError(f"{paths[0]} is left to the touching object: give it a value before it is fitted")
    if _is_state(paths[0]):
        raise ValueError(f"{paths[0]} is an initial state: those are always fitted, each run's own")
    low = spec.search[0] if lower is None else lower
    high = spec.search[1] if upper is None else upper
    low, high = max(min(low, value), spec.lower), min(max(high, value), spec.upper)
    wide = SHARE * max(high - low, 1e-12)
    typical = min(max(ERRORS * error, 1e-3 * wide), wide) if error else wide
    return Unknown(name, paths, spec.unit, value, low, high, typical)


def _is_state(path: str) -> bool:
    parts = path.split(".")
    return parts[0] == "objects" and len(parts) == 4 and ".".join(parts[2:3]) in STATES


def _readable(world: World, path: str) -> bool:
    try:
        return read_parameter(world, path) is not None
    except KeyError:
        return False
