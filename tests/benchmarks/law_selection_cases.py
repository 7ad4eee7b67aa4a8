"""Data with keys for `law_selection`: real sets, and the one-ball generator of the prototypes."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from polyworld.data.recording import Recording, Run
from polyworld.data.recording_csv import read_recording
from polyworld.estimation.unknown import Unknown
from polyworld.world import World
from tests.benchmarks.real_gap import CASES

SHARED = Path(__file__).resolve().parents[3] / "shared"
DATA, PROTOTYPES = SHARED / "data", SHARED / "prototypes"

# Names of the generators' effects in the catalogue.
NAMES = {
    "grav_z": "gravity_error", "uniform_xy": "tilt", "lin_drag": "linear_drag", "quad_drag": "quadratic_drag",
    "magnus": "magnus_lift", "central": "central_force", "periodic": "periodic_forcing", "patch": "friction_patch",
    "e_const": "restitution_error", "e_vel": "restitution_speed", "b_fric": "bounce_friction",
    "b_spin": "spin_coupling", "wall": "hidden_wall", "lens": "observer_distortion", "table": "hidden_wall",
    "attraction": "central_force", "periodic_force": "periodic_forcing", "scale_error": "observer_scale",
    "clock_rate": "observer_clock", "restitution_slope": "restitution_speed", "dry_friction": "joint_friction",
    "restitution_power": "restitution_speed", "wrong_friction": "friction_error", "wrong_length": "length_error",
    "stiffening_spring": "outside",
}  # fmt: skip
# Laws that are the same of one coordinate, of a body that slides on a level plane, or of bounces at one angle.
ALIKE = {"viscous_friction": "linear_drag", "joint_damping": "linear_drag", "friction_error": "bounce_friction"}
DRAG, LINEAR = "quadratic_drag", "linear_drag"
# What real sets hold, "" where nothing; several where each answer would do, none where no law of the catalogue would.
REAL: dict[str, tuple[str, ...]] = {
    "tt16": (f"{DRAG}+hidden_wall", f"{DRAG}+hidden_wall+magnus_lift"),
    "tt16arc": (DRAG, f"{DRAG}+magnus_lift"), "tt8spin": (DRAG, f"{DRAG}+magnus_lift"),
    "tt8spinarc": (DRAG, f"{DRAG}+magnus_lift"), "ttg8spin": (DRAG, f"{DRAG}+magnus_lift"),
    "balls": (DRAG,), "ball_golf": (), "pendulum": (LINEAR, DRAG), "cube": (), "air": (LINEAR,), "phone": (DRAG,),
    "cube_heights": ("gravity_error", "observer_scale", "observer_clock"),
    "clevrer": (LINEAR, DRAG, f"{LINEAR}+{DRAG}"), "lipson": (f"length_error+{LINEAR}", f"length_error+{DRAG}"),
}  # fmt: skip
PHONE = {"name": "phone", "shape": {"kind": "box", "half_extents": [0.035, 0.07, 0.004]}, "mass": 0.165}
TENNIS = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.02}, "mass": 0.0027, "position": [0, 0, 0.3]}


@dataclass(frozen=True)
class Keyed:
    """Data with their key. right: sets of laws, each of which answers it; none: no law of the catalogue does."""

    name: str
    world: World
    recording: Recording
    right: tuple[frozenset[str], ...]
    key: str = ""
    held_out: Recording | None = None
    base: tuple[Unknown, ...] = ()


def laws(*sets: str) -> tuple[frozenset[str], ...]:
    """Return sets of laws written as effects joined by "+"; none of those that hold one outside the catalogue."""
    found = [frozenset(ALIKE.get(n, n) for n in (NAMES.get(e, e) for e in s.split("+") if e)) for s in sets]
    wind = [s - {DRAG} for s in found if {"wind", DRAG} <= s]
    return tuple(s for s in [*wind, *found] if not any(n == "outside" or n.startswith("OOC") for n in s))


def real(name: str) -> Keyed:
    """Return a real set by name: of `real_gap`, or of the shared folder."""
    if name in CASES:
        m = CASES[name].read()
        return Keyed(name, m.world, m.recording, laws(*REAL.get(name, ())), CASES[name].published, m.held_out, m.base)
    places = {"air": "air_track/oscillator", "lipson": "pendulum/schmidt_lipson", "phone": "phone_fall/ten_falls"}
    worlds = {"air": "air_track/world.json", "lipson": "pendulum/schmidt_lipson_world.json"}
    if name in worlds:
        world = World.model_validate_json((DATA / worlds[name]).read_text())
    else:
        body, rate = (PHONE | {"position": [0, 0, 2]}, 200) if name == "phone" else (TENNIS, 143)
        world = World.model_validate({"objects": [body], "time": {"seconds_per_frame": 1 / rate}})
    path = DATA / f"{places.get(name, f'flights/{name}')}.csv"
    return Keyed(name, world, read_recording(path, world=world), laws(*REAL.get(name, ())))


def ball(radius: float, mass: float, rate: float, restitution: float | None) -> World:
    """Return a world of one ball that knows no friction, with a level floor through the origin where it bounces."""
    body = {"name": "ball", "shape": {"kind": "sphere", "radius": radius}, "mass": mass, "position": [0, 0, 1]}
    bounce = {"restitution": restitution or 0.0}
    floors = [] if restitution is None else [{"name": "floor", "shape": {"kind": "plane"}} | bounce]
    fields = {"objects": [body | bounce | {"friction": 0.0}], "statics": floors}
    return World.model_validate(fields | {"time": {"seconds_per_frame": 1 / rate}})


def one_ball(noise: float, only: Sequence[str]) -> Iterator[Keyed]:
    """Return cases of the one-ball generator: each effect by itself and nothing, six runs of 1.6 s at 60 Hz."""
    gen, times = _prototype("one_ball_generator"), np.arange(0, 1.6, 1 / 60)
    singles = "quad_drag lin_drag magnus wall b_fric e_const spring periodic fan uniform_xy grav_z lens central e_vel"
    for number, names in enumerate(only or ["null", *singles.split()]):
        rng = np.random.default_rng(100 + number)
        effects = [(n, gen.sample(rng, n)[0]) for n in names.split("+") if n != "null"]
        begin, spins = gen.launches(rng, 6)
        places = np.stack([gen.traj(b, w, effects, times) for b, w in zip(begin, spins, strict=True)])
        places = places + rng.normal(size=places.shape) * noise * np.ptp(places.reshape(-1, 3), axis=0).max()
        runs = []
        for k, w in enumerate(spins):
            spin = np.full((len(times), 1, 3), np.nan)
            spin[0, 0] = w
            lifted = places[k] + [0.0, 0.0, 0.05]  # the generator gives heights of the ball's lowest point
            runs.append(run_of(f"r{k}", times, lifted, spin))
        key = " ".join(f"{n} {np.round(p, 3).tolist()}" for n, p in effects)
        yield Keyed(names, ball(0.05, 0.1, 60.0, 0.75), Recording(tuple(runs)), laws(names.replace("null", "")), key)


def run_of(name: str, times: Any, places: Any, spins: Any) -> Run:
    turns = np.full((len(times), 1, 4), np.nan)
    return Run(name, ("ball",), times, places[:, None], turns, angular_velocities=spins)


def _prototype(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, PROTOTYPES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
