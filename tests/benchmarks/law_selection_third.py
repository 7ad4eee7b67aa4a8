"""Cases of the third generator for `law_selection`: the worlds that its statements describe, and the keys."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from polyworld.data.recording import Recording, Run
from polyworld.world import World
from tests.benchmarks.law_selection_cases import Keyed, ball, laws, run_of
from tests.benchmarks.third_generator.generator import SPECS, Case, case

Stated = dict[str, Any]


def third(noise: float, seeds: range, kinds: Sequence[str], only: Sequence[str]) -> Iterator[Keyed]:
    """Return cases of the third generator, of some kinds; only: effects joined by +, or numbers."""
    for seed in seeds:
        for i, (_, kind, (names, option)) in enumerate(SPECS):
            if kind in kinds and (not only or names in only or str(i) in only):
                one = case(seed, i, noise)
                runs = [_of_third(one, k) for k in np.unique(one.data[:, 0])]
                key = f"{option} {one.key['effects']} size {one.key['size']:.2f} of {one.key['samples']}"
                sets = () if one.key["group"] == "outside" else (names.strip("-"), *one.key["also_right"])
                key += f" {one.key['noise']['kind']}"
                yield Keyed(f"{i} {kind} {names}", KINDS[kind](one.stated), Recording(tuple(runs)), laws(*sets), key)


def _of_third(one: Case, number: float) -> Run:
    """Return one run: what is measured of a ball; of a block and a cart x; of a pendulum its place on the arc."""
    s, rows = one.stated, one.data[one.data[:, 0] == number]
    places, spins = rows[:, 2:5], np.full((len(rows), 3), np.nan)
    if s["kind"] == "ball":
        spins = rows[:, 5:8] if s["spin_measured"] else spins
    elif s["kind"] == "pendulum":
        place = [np.sin(rows[:, 2]), np.full(len(rows), np.nan), -np.cos(rows[:, 2])]
        places = s["length"] * np.stack(place, axis=1)
    else:
        places = places.copy()
        places[:, 1:] = np.nan
    return run_of(f"r{int(number)}", rows[:, 1], places, spins[:, None])


def _ball_world(s: Stated) -> World:
    return ball(s["radius"], s["mass"], s["rate_hz"], s.get("restitution"))


def _pendulum_world(s: Stated) -> World:
    shape = {"kind": "sphere", "radius": 0.01 * s["length"]}
    bob = {"name": "ball", "shape": shape, "mass": s["mass"], "position": [0, 0, -s["length"]]}
    hinge = {"kind": "hinge", "name": "hinge", "object": "ball", "anchor": [0, 0, 0], "axis": [0, 1, 0]}
    return World.model_validate({"objects": [bob], "joints": [hinge], "time": {"seconds_per_frame": 1 / s["rate_hz"]}})


def _cart_world(s: Stated) -> World:
    box = {"kind": "box", "half_extents": [0.05, 0.05, 0.05]}
    cart = {"name": "ball", "shape": box, "mass": s["mass"], "position": [0, 0, 0]}
    track = {"kind": "slider", "name": "track", "object": "ball", "anchor": [0, 0, 0], "axis": [1, 0, 0]}
    spring = {"kind": "spring", "name": "spring", "object": "ball", "anchor": [0, 0, 0], "other_anchor": [-1, 0, 0]}
    joints = [track, spring | {"stiffness": s["stiffness"], "rest_length": 1.0}]
    return World.model_validate({"objects": [cart], "joints": joints, "time": {"seconds_per_frame": 1 / s["rate_hz"]}})


def _block_world(s: Stated) -> World:
    box = {"kind": "box", "half_extents": [0.05, 0.05, 0.05]}
    block = {
        "name": "ball",
        "representation": "rigid_planar",
        "shape": box,
        "mass": s["mass"],
        "position": [0, 0, 0.05],
    }
    fields = {"objects": [block | {"friction": s["friction"]}], "environment": {"motion_plane": {}}}
    return World.model_validate(fields | {"time": {"seconds_per_frame": 1 / s["rate_hz"]}})


KINDS: dict[str, Callable[[Stated], World]] = {
    "ball": _ball_world, "block": _block_world, "pendulum": _pendulum_world, "cart": _cart_world,
}  # fmt: skip
