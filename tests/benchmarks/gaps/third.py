"""Cases of the third generator: the worlds that its statements describe, and its keys."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from polyworld.data.recording import Recording, Run
from polyworld.world import World
from tests.benchmarks.gaps.case import NOTHING, Array, Case, Names, ball, noncentrality, one_body
from tests.benchmarks.third_generator.generator import SPECS, case

Stated = dict[str, Any]
# Names of its effects in the catalogue.
NAMES = {
    "magnus": "magnus_lift", "table": "hidden_wall", "wall": "hidden_wall", "attraction": "central_force",
    "periodic_force": "periodic_forcing", "lens": "observer_distortion", "scale_error": "observer_scale",
    "clock_rate": "observer_clock", "restitution_slope": "restitution_speed", "restitution_power": "restitution_speed",
    "dry_friction": "joint_friction", "wrong_friction": "friction_error", "wrong_length": "length_error",
    "patch": "friction_patch",
    # In the pivot's frame, where angles are measured, its shaking is a uniform force: L th'' = -g sin th - a(t) cos th.
    "shaken_pivot": "periodic_forcing",
}  # fmt: skip
UNKNOWN = {"cubic_drag", "shear_wind", "decaying_push", "fading_spring", "stiffening_spring"}
# One law of one coordinate, of a body that slides on a level plane, or of bounces at one angle.
ALIKE = {"viscous_friction": "linear_drag", "joint_damping": "linear_drag"}
ALIKE_BALL = {"friction_error": "bounce_friction"}


def listed() -> list[str]:
    """Return kinds and effects."""
    return [f"{kind} {names.strip('-') or 'nothing'}" for _, kind, (names, _) in SPECS]


def drawn(index: int, level: float, seed: int) -> Case:
    """Return a case with noise of so much of the range of motion."""
    one = case(seed, index, 100.0 * level)
    kind, names = one.stated["kind"], list(one.key["effects"])
    outside = bool(UNKNOWN & set(names))
    runs = [_run(one.stated, one.data[one.data[:, 0] == k]) for k in np.unique(one.data[:, 0])]
    sizes = list(one.key["size_of"].values())
    return Case(
        listed()[index],
        WORLDS[kind](one.stated),
        Recording(tuple(runs)),
        () if outside else _truths(["+".join(names), *one.key["also_right"]]) if names else NOTHING,
        outside,
        level,
        alike=ALIKE | (ALIKE_BALL if kind == "ball" else {}),
        noncentrality=noncentrality(min(sizes, default=np.inf), one.key["samples"], one.key["noise"]["memory"]),
    )


def _truths(sets: list[str]) -> tuple[Names, ...]:
    """Return the right answers; the wind of the catalogue brings its own drag."""
    found = [Names(NAMES.get(n, n) for n in s.split("+")) for s in sets]
    return tuple(dict.fromkeys([*found, *(f - {"quadratic_drag"} for f in found if "wind" in f)]))


def _run(s: Stated, rows: Array) -> Run:
    """Return one run: what is measured of a ball; of a block and a cart x; of a pendulum its place on the arc."""
    places, spins = rows[:, 2:5].copy(), None
    if s["kind"] == "ball":
        spins = rows[:, 5:8] if s["spin_measured"] else None
    elif s["kind"] == "pendulum":
        place = [np.sin(rows[:, 2]), np.full(len(rows), np.nan), -np.cos(rows[:, 2])]
        places = s["length"] * np.stack(place, axis=1)
    else:
        places[:, 1:] = np.nan
    run = one_body(f"r{int(rows[0, 0])}", rows[:, 1], places, spins)
    return replace(run, arms=(s["length"],)) if s["kind"] == "pendulum" else run


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
    block = {"name": "ball", "representation": "rigid_planar", "shape": box, "mass": s["mass"]}
    block |= {"position": [0, 0, 0.05], "friction": s["friction"]}
    fields = {"objects": [block], "environment": {"motion_plane": {}}}
    return World.model_validate(fields | {"time": {"seconds_per_frame": 1 / s["rate_hz"]}})


WORLDS: dict[str, Callable[[Stated], World]] = {
    "ball": _ball_world, "block": _block_world, "pendulum": _pendulum_world, "cart": _cart_world,
}  # fmt: skip
