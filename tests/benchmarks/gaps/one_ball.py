"""Cases of the one-ball generator of the prototypes: each effect by itself, and nothing."""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np

from polyworld.data.recording import Recording
from tests.benchmarks.gaps.case import NOTHING, Array, Case, Names, ball, noncentrality, one_body

SOURCE = Path(__file__).resolve().parents[4] / "shared" / "prototypes" / "one_ball_generator.py"
RADIUS, RATE, RESTITUTION = 0.05, 60.0, 0.75
TIMES = np.arange(0.0, 1.6, 1.0 / RATE)
RUNS = 6
NUDGE = 1e-5  # [m], [m/s]
# Effects by their names there, with those of the catalogue; none of what no law there is.
EFFECTS = {
    "": "", "quad_drag": "quadratic_drag", "lin_drag": "linear_drag", "magnus": "magnus_lift", "wall": "hidden_wall",
    "b_fric": "bounce_friction", "e_const": "restitution_error", "spring": "spring", "periodic": "periodic_forcing",
    "fan": "fan", "uniform_xy": "tilt", "grav_z": "gravity_error", "lens": "observer_distortion",
    "central": "central_force", "e_vel": "restitution_speed", "coriolis": "coriolis", "wind": "wind",
    "b_spin": "spin_coupling", "OOC_cubic_drag": None, "OOC_decay": None, "OOC_aniso_drag": None,
}  # fmt: skip
ALIKE = {"friction_error": "bounce_friction"}  # of bounces at one angle, in a world without friction
# Also right: wind brings its drag; the law there keeps e at 3 m/s, that of the catalogue at rest.
MORE = {
    "wind": Names(("wind", "quadratic_drag")),
    "restitution_speed": Names(("restitution_speed", "restitution_error")),
}
# Coulomb friction of bounces that spin does not act on is none of the catalogue's two, and nearly either; neither is a
# kick by spin alone, whatever the speed along the floor, the grip of a superball.
NEARLY = {"b_fric", "b_spin"}


def listed() -> list[str]:
    """Return the effects."""
    return [name or "nothing" for name in EFFECTS]


def drawn(index: int, level: float, seed: int) -> Case:
    """Return a case: runs of 1.6 s at 60 Hz with noise of so much of the range of motion."""
    gen, name = _generator(), list(EFFECTS)[index]
    rng = np.random.default_rng(100 + index + 1000 * seed)
    effects = [(name, gen.sample(rng, name)[0])] if name else []
    begin, spins = gen.launches(rng, RUNS)
    places = np.stack([gen.traj(b, w, effects, TIMES) for b, w in zip(begin, spins, strict=True)])
    sigma = level * float(np.ptp(places.reshape(-1, 3), axis=0).max())
    size = np.inf
    if name:
        left = [_left(gen, b, w, effects) for b, w in zip(begin, spins, strict=True)]
        size = float(np.sqrt(3.0 * np.mean(np.square(left)))) / sigma
    places = places + rng.normal(size=places.shape) * sigma + [0.0, 0.0, RADIUS]  # it gives a ball's lowest point
    runs = []
    for k, w in enumerate(spins):
        spin = np.full((len(TIMES), 3), np.nan)
        spin[0] = w
        runs.append(one_body(f"r{k}", TIMES, places[k], spin))
    law = EFFECTS[name]
    truths = () if law is None else NOTHING if not law else (Names((law,)), *([MORE[law]] if law in MORE else []))
    return Case(
        name or "nothing",
        ball(RADIUS, 0.1, RATE, RESTITUTION),
        Recording(tuple(runs)),
        truths,
        law is None or name in NEARLY,
        level,
        alike=ALIKE,
        noncentrality=noncentrality(size, RUNS * len(TIMES)),
    )


def _left(gen: ModuleType, begin: Array, spin: Array, effects: list[tuple[str, list[float]]]) -> Array:
    """Return what an effect does to a run beyond what a small change of its start does."""
    base = gen.traj(begin, spin, [], TIMES)
    slopes = [(gen.traj(begin + NUDGE * e, spin, [], TIMES) - base).ravel() / NUDGE for e in np.eye(6)]
    moved = (gen.traj(begin, spin, effects, TIMES) - base).ravel()
    matrix = np.array(slopes).T
    left: Array = moved - matrix @ np.linalg.lstsq(matrix, moved)[0]
    return left


@cache
def _generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location(SOURCE.stem, SOURCE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
