"""Numbers of a world that are refitted together with every effect."""

from __future__ import annotations

from collections.abc import Sequence

from atw_mcp.calls.app import App
from atw_mcp.worlds.last_fit import last_fit
from polyworld.estimation.unknown import Unknown
from polyworld.world import World
from polyworld.world.parameter_tables import STATE_PARAMETERS
from polyworld.world.parameters import parameter_paths, read_parameter, specification

FRAME = "time.seconds_per_frame"  # measured times follow the world's frames
STATES = {path.rpartition(".")[0] for path in STATE_PARAMETERS} | {"shift"}
ERRORS = 5.0  # standard errors that make an ordinary change of a fitted number
SHARE = 0.05  # of its range, where no standard error is known


def base_unknowns(app: App, world: World, paths: Sequence[str] | None) -> tuple[Unknown, ...]:
    """Return the numbers refitted in every hypothesis: those given by path, else those FitWorld fitted in this world.

    Initial states are always free and not among them. Raises KeyError or ValueError for a path that cannot be fitted.
    """
    if paths is not None:
        return unknowns_at(world, paths)
    fit = last_fit(app, world)
    known, found, taken = parameter_paths(world), list[Unknown](), set[str]()
    # A friction that several constants make up is refitted as its own: those of single objects come first. Restitution
    # is refitted in common, since few bodies are seen to collide often.
    for value in sorted([] if fit is None else fit.values, key=lambda v: len(v["paths"])):
        departs = " over " in value["name"]
        if departs and value["name"].startswith("restitution of "):
            continue
        powers = value.get("powers") or [1.0] * len(value["paths"])
        own = [p for p, power in zip(value["paths"], powers, strict=True) if power > 0.0]  # the others divide by it
        free = [p for p in own if p in known and p not in taken and p != FRAME and not _is_state(p)]
        free = [p for p in free if read_parameter(world, p) is not None]
        taken |= set(free)
        if not free:
            continue
        plain = not departs and all(power == 1.0 for power in powers)  # it is the parameter itself
        ranges = (value["lower"], value["upper"], value["standard_error"]) if plain else ()
        found.append(unknown_of(world, tuple(free), value["name"], *ranges))
    return tuple(found)


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
        raise ValueError(f"{FRAME} is how frames are numbered; what measured times may have wrong is observer.clock")
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
