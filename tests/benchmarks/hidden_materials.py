"""Ropes, sheets, soft bodies and fluids with one number that is wrong: is the gap found, and called by its name?

    python -m tests.benchmarks.hidden_materials [--json] [--only NAME] [--seed S]

Data come from SciPy or closed forms that share no code with the engine: a chain of point masses on springs, a bar that
rings along its length (a sheet, a soft block), a flat sheet that falls through air, a box that fills. Of one row, the
hanging sheet that swings, a finer world of the engine makes the data, for want of other code; its row says so. What is
observed are markers on the bodies, or the centre of a fluid, with video-like noise.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.discrepancy.catalogue import catalogue
from polyworld.discrepancy.gap import GapSettings, find_gap
from polyworld.recording import Recording, Run
from polyworld.rollout import simulator
from polyworld.world import World

Array = NDArray[np.float64]

G = 9.81
FORCES = ("gravity_error", "tilt", "linear_drag", "quadratic_drag")
MATERIALS = ("material_damping", "air_drag", "bending_stiffness", "stretch_stiffness")
LIQUID = ("viscosity", "surface_tension", "source_rate", "gravity_error")


@dataclass(frozen=True)
class Case:
    """world: what the solver is told. truth: the hidden effect, or none. value: of its unknown. same: names that no
    observation of this scene tells from it. names of markers; paths (T, n, 3) without noise at times (T,); other: paths
    of the sealed run. code: what made the data.
    """

    name: str
    truth: str | None
    value: float
    same: frozenset[str]
    code: str
    world: World
    markers: tuple[str, ...]
    times: Array
    paths: Array
    other: Array
    candidates: tuple[str, ...]
    sigma: float

    def recordings(self, rng: np.random.Generator) -> tuple[Recording, Recording]:
        """The run to be explained, and the sealed one."""
        return tuple(  # type: ignore[return-value]
            Recording((self._run(name, paths, rng),)) for name, paths in (("run", self.paths), ("sealed", self.other))
        )

    def _run(self, name: str, paths: Array, rng: np.random.Generator) -> Run:
        seen = paths + rng.normal(0.0, self.sigma, paths.shape)
        return Run(name, self.markers, self.times, seen, np.full((*paths.shape[:2], 4), np.nan))


# A rope that swings: nodes on springs.

ROPE_LENGTH, ROPE_DENSITY, ROPE_STRETCH, SEGMENTS = 1.0, 0.1, 50.0, 10


def chain(angle: float, times: Array, *, stretch: float, damping: float, tau: float, bending: float = 0.0) -> Array:
    """Nodes (T, n + 1, 3) of a rope that is held at the origin and let go, straight, at an angle from the vertical.

    Lumped masses, tension EA (strain + tau strain rate), dv/dt = -c v; bending by its energy EI kappa^2 / (2 l) with
    kappa = 2 tan(theta / 2) (Bergou et al. 2008, ACM Trans. Graph. 27, 63).
    """
    link = ROPE_LENGTH / SEGMENTS
    mass = np.full(SEGMENTS, ROPE_DENSITY * link)
    mass[-1] /= 2.0

    def slope(_t: float, y: Array) -> Array:
        x = np.vstack([np.zeros(2), y[: 2 * SEGMENTS].reshape(-1, 2)])
        v = np.vstack([np.zeros(2), y[2 * SEGMENTS :].reshape(-1, 2)])
        along, speed = np.diff(x, axis=0), np.diff(v, axis=0)
        size = np.linalg.norm(along, axis=1, keepdims=True)
        unit = along / size
        rate = np.sum(speed * unit, axis=1, keepdims=True)
        tension = stretch * (size / link - 1.0 + tau * rate / link) * unit
        force = np.zeros_like(x)
        force[:-1] += tension
        force[1:] -= tension
        if bending:
            turn = np.arctan2(
                unit[:-1, 0] * unit[1:, 1] - unit[:-1, 1] * unit[1:, 0], np.sum(unit[:-1] * unit[1:], axis=1)
            )
            half = np.tan(turn / 2.0)
            moment = 2.0 * bending * half * (1.0 + half**2) / link
            normal = np.column_stack([-unit[:, 1], unit[:, 0]]) / size
            force[:-2] -= moment[:, None] * normal[:-1]
            force[1:-1] += moment[:, None] * (normal[:-1] + normal[1:])
            force[2:] -= moment[:, None] * normal[1:]
        acceleration = force[1:] / mass[:, None] - damping * v[1:] - np.array([0.0, G])
        return np.concatenate([v[1:].ravel(), acceleration.ravel()])

    start = np.linspace(0.0, ROPE_LENGTH, SEGMENTS + 1)[1:, None] * np.array([np.sin(angle), -np.cos(angle)])
    found = solve_ivp(
        slope,
        (0.0, times[-1]),
        np.concatenate([start.ravel(), np.zeros(2 * SEGMENTS)]),
        t_eval=times,
        method="LSODA",
        rtol=1e-8,
        atol=1e-9,
    )
    flat = found.y.T[:, : 2 * SEGMENTS].reshape(len(times), SEGMENTS, 2)
    nodes = np.zeros((len(times), SEGMENTS + 1, 3))
    nodes[:, 1:, 0], nodes[:, 1:, 2] = flat[..., 0], flat[..., 1]
    return nodes


def rope_case(rng: np.random.Generator, truth: str | None) -> Case:
    """A rope let go at 50 to 70 degrees from the vertical, two seconds, three markers."""
    angle = float(rng.uniform(np.radians(50.0), np.radians(70.0)))
    told = {"stretch": ROPE_STRETCH, "damping": 0.05, "tau": 0.01, "bending": 1e-4}
    field, value = {
        "air_drag": ("damping", float(rng.uniform(0.4, 0.8))),
        "stretch_stiffness": ("stretch", float(rng.uniform(18.0, 25.0))),
        "material_damping": ("tau", float(rng.uniform(0.06, 0.1))),
        "bending_stiffness": ("bending", float(rng.uniform(2e-3, 4e-3))),
        None: ("tau", told["tau"]),
    }[truth]
    times = np.arange(61) / 30.0
    nodes = chain(angle, times, **(told | {field: value}))
    rope = {
        "name": "rope",
        "representation": "rope",
        "points": [(0, 0, 0), (ROPE_LENGTH * np.sin(angle), 0, -ROPE_LENGTH * np.cos(angle))],
        "segments": SEGMENTS,
        "linear_density": ROPE_DENSITY,
        "stretch_stiffness": told["stretch"],
        "stretch_damping": told["tau"],
        "bending_stiffness": told["bending"],
        "linear_damping": told["damping"],
    }
    world = _world(deformables=[rope], attachments=[{"name": "held", "object": "rope", "end": "start"}])
    same = frozenset({"air_drag", "linear_drag"}) if truth == "air_drag" else frozenset({truth or ""})
    return Case(
        f"rope, {truth or 'nothing'}",
        truth,
        value,
        same,
        "SciPy: point masses on springs",
        world,
        ("rope#0", "rope#1", "rope#2"),
        times,
        nodes[:, [4, 7, 10]],
        nodes[:, [3, 6, 9]],
        (*MATERIALS, *FORCES),
        0.002,
    )


# A bar that hangs from a fixed end and is let go unstretched: modes of the wave equation.


def ringing(depth: Array, times: Array, *, length: float, speed: float, tau: float) -> Array:
    """Displacements (T, n) downwards at rest depths (n,) below the held end, from rest without stretch.

    u = sum over odd waves of the static sag g (L z - z^2 / 2) / c^2, each turning to it with its damping tau omega / 2
    (Kelvin and Voigt).
    """
    total = np.zeros((len(times), len(depth)))
    for k in range(200):
        wave = (k + 0.5) * np.pi / length
        sag = 2.0 * G / (speed**2 * length * wave**3)
        omega, rate = speed * wave, 0.5 * tau * (speed * wave) ** 2
        if rate < omega:
            turn = np.sqrt(omega**2 - rate**2)
            decay = np.exp(-rate * times) * (np.cos(turn * times) + rate / turn * np.sin(turn * times))
        else:
            root = np.sqrt(rate**2 - omega**2) + 1e-12
            slow, fast = omega**2 / (rate + root), rate + root
            decay = (fast * np.exp(-slow * times) - slow * np.exp(-fast * times)) / (fast - slow)
        total += sag * np.outer(1.0 - decay, np.sin(wave * depth))
    return total


def soft_case(rng: np.random.Generator, truth: str | None) -> Case:
    """A block of gelatine, 0.4 m long, that hangs from its top and rings along its length."""
    length, density, modulus, tau = 0.4, 1000.0, 8e4, 0.01
    value = {
        "stretch_stiffness": modulus * float(rng.uniform(1.4, 1.8)),
        "material_damping": float(rng.uniform(0.03, 0.05)),
        None: 0.0,
    }[truth]
    speed = np.sqrt((value if truth == "stretch_stiffness" else modulus) / density)
    times = np.arange(61) / 60.0
    world = _world(
        deformables=[
            {
                "name": "block",
                "representation": "soft_planar",
                "shape": {"kind": "box", "half_extents": [0.05, 0.05, length / 2]},
                "position": [0, 0, -length / 2],
                "thickness": 0.1,
                "resolution": 0.1,
                "density": density,
                "youngs_modulus": modulus,
                "poisson_ratio": 0.0,
                "damping": tau,
            }
        ],
        attachments=[{"name": "held", "object": "block", "region": _slab(0.0)}],
        environment={"motion_plane": {"normal": [0, -1, 0], "supports": False}, "gravity": [0, 0, -G]},
    )
    used = value if truth == "material_damping" else tau

    def paths(depth: Array) -> Array:
        moved = ringing(depth, times, length=length, speed=speed, tau=used)
        places = np.zeros((*moved.shape, 3))
        places[..., 2] = -depth - moved
        return places

    return Case(
        f"soft block, {truth or 'nothing'}",
        truth,
        value,
        frozenset({truth or ""}),
        "closed form: waves along a bar",
        world,
        ("block#0", "block#1", "block#2"),
        times,
        paths(np.array([0.2, 0.3, 0.4])),
        paths(np.array([0.1, 0.25, 0.35])),
        (*MATERIALS, *FORCES),
        0.001,
    )


def strip_case(rng: np.random.Generator, truth: str | None) -> Case:
    """A rubber sheet of 6 x 6 squares that hangs from one edge and rings along its length."""
    length, density, stiffness, tau = 0.6, 1.0, 60.0, 0.01
    value = {
        "stretch_stiffness": stiffness * float(rng.uniform(1.4, 1.8)),
        "material_damping": float(rng.uniform(0.03, 0.05)),
        None: 0.0,
    }[truth]
    speed = np.sqrt((value if truth == "stretch_stiffness" else stiffness) / density)
    times = np.arange(61) / 60.0
    world = _world(
        deformables=[
            {
                "name": "sheet",
                "representation": "cloth",
                "geometry": {
                    "kind": "sheet",
                    "corner": (0, 0, 0),
                    "edge_u": (0.6, 0, 0),
                    "edge_v": (0, 0, -length),
                    "divisions": (6, 6),
                },
                "areal_density": density,
                "stretch_stiffness": stiffness,
                "poisson_ratio": 0.0,
                "stretch_damping": tau,
                "drag_normal": 0.0,
                "drag_tangential": 0.0,
                "self_contact": False,
            }
        ],
        attachments=[{"name": "held", "object": "sheet", "region": _slab(0.0)}],
    )
    used = value if truth == "material_damping" else tau

    def paths(depth: Array) -> Array:
        moved = ringing(depth, times, length=length, speed=speed, tau=used)
        places = np.zeros((*moved.shape, 3))
        places[..., 0] = 0.3
        places[..., 2] = -depth - moved
        return places

    return Case(
        f"hanging sheet, {truth or 'nothing'}",
        truth,
        value,
        frozenset({truth or ""}),
        "closed form: waves along a strip",
        world,
        ("sheet#0", "sheet#1", "sheet#2"),
        times,
        paths(np.array([0.3, 0.4, 0.6])),
        paths(np.array([0.2, 0.35, 0.5])),
        (*MATERIALS, *FORCES),
        0.001,
    )


# A flat sheet that falls.


def falling_case(rng: np.random.Generator, truth: str | None) -> Case:
    """A sheet of 6 x 6 squares let go flat: m dv/dt = m g - rho C v^2 / 2 per area."""
    density, air, told = 0.1, 1.2, 0.6
    value = {"air_drag": told * float(rng.uniform(1.8, 2.6)), None: told}[truth]
    terminal = np.sqrt(2.0 * density * G / (air * value))
    times = np.arange(46) / 30.0
    world = _world(
        deformables=[
            {
                "name": "sheet",
                "representation": "cloth",
                "geometry": {
                    "kind": "sheet",
                    "corner": (-0.3, -0.3, 0),
                    "edge_u": (0.6, 0, 0),
                    "edge_v": (0, 0.6, 0),
                    "divisions": (6, 6),
                },
                "areal_density": density,
                "stretch_stiffness": 200.0,
                "drag_normal": told,
                "drag_tangential": 0.02,
                "self_contact": False,
            }
        ],
        environment={"gravity": [0, 0, -G], "air_density": air},
    )
    drop = terminal**2 / G * np.log(np.cosh(G * times / terminal))

    def paths(markers: Sequence[tuple[float, float]]) -> Array:
        places = np.zeros((len(times), len(markers), 3))
        places[..., :2] = np.array(markers)
        places[..., 2] = -drop[:, None]
        return places

    return Case(
        f"falling sheet, {truth or 'nothing'}",
        truth,
        value,
        frozenset({"air_drag", "quadratic_drag"} if truth else {""}),
        "closed form: quadratic drag",
        world,
        ("sheet#0", "sheet#1", "sheet#2"),
        times,
        paths([(0.0, 0.0), (-0.3, -0.3), (0.3, 0.1)]),
        paths([(0.1, 0.0), (0.3, -0.3), (-0.3, 0.1)]),
        (*MATERIALS, *FORCES),
        0.002,
    )


# A sheet that swings: data from a finer world.


def swinging_case(rng: np.random.Generator, truth: str | None) -> Case:
    """A stiff sheet, held along an edge and let go from 40 degrees; the data from one of 12 x 12 squares."""
    value = {"bending_stiffness": float(rng.uniform(3e-3, 6e-3)), "air_drag": float(rng.uniform(2.0, 3.0)), None: 0.0}[
        truth
    ]
    tilt = np.radians(40.0)
    times = np.arange(31) / 30.0

    def made(divisions: int, **changes: float) -> World:
        sheet: dict[str, Any] = {
            "name": "sheet",
            "representation": "cloth",
            "geometry": {
                "kind": "sheet",
                "corner": (0, -0.3, 0),
                "edge_u": (0, 0.6, 0),
                "edge_v": (0.6 * np.cos(tilt), 0, -0.6 * np.sin(tilt)),
                "divisions": (divisions, divisions),
            },
            "areal_density": 0.2,
            "stretch_stiffness": 200.0,
            "stretch_damping": 0.01,
            "bending_stiffness": 1e-4,
            "drag_normal": 1.0,
            "self_contact": False,
        }
        region = {"lower": [-0.001, -1, -0.001], "upper": [0.001, 1, 0.001]}
        return _world(
            deformables=[sheet | changes], attachments=[{"name": "held", "object": "sheet", "region": region}]
        )

    field = {"bending_stiffness": "bending_stiffness", "air_drag": "drag_normal", None: "drag_normal"}[truth]
    finer = made(12, **({field: value} if truth else {}))
    points = simulator(finer, times).run().deformables["sheet"].points[0]
    near = [
        int(np.argmin(np.linalg.norm(points[0] - [r * np.cos(tilt), y, -r * np.sin(tilt)], axis=1)))
        for r, y in ((0.3, 0.0), (0.6, -0.2), (0.6, 0.1), (0.2, 0.1), (0.4, -0.2), (0.5, 0.2))
    ]
    return Case(
        f"swinging sheet, {truth or 'nothing'}",
        truth,
        value,
        frozenset({truth or ""}),
        "the engine, 12 x 12 squares",
        made(6),
        ("sheet#0", "sheet#1", "sheet#2"),
        times,
        points[:, near[:3]],
        points[:, near[3:]],
        (*MATERIALS, *FORCES),
        0.003,
    )


# A box that fills.


def filling(times: Array, *, rate: float, width: float, depth: float, height: float, speed: float) -> Array:
    """Height (T,) of the centre of water that stands in a box, with a jet that falls into it from a mouth above."""
    centre = np.empty(len(times))
    for k, t in enumerate(times):
        level = depth
        for _ in range(50):  # what is in the air is not yet in the box
            aloft = min((np.sqrt(speed**2 + 2.0 * G * max(height - level, 0.0)) - speed) / G, t)
            level = depth + rate * (t - aloft) / width
        moment = 0.5 * width * level**2 + rate * (height * aloft - speed * aloft**2 / 2.0 - G * aloft**3 / 6.0)
        centre[k] = moment / (width * depth + rate * t)
    return centre


def filling_case(rng: np.random.Generator, truth: str | None) -> Case:
    """A box in which water stands, and a tap above adds to it."""
    width, depth, told, mouth, height = 0.3, 0.09, 0.02, 0.06, 0.25
    rate = {"source_rate": told * float(rng.uniform(1.4, 1.8)), None: told}[truth]
    times = np.arange(25) / 12.0
    world = _world(
        deformables=[
            {
                "name": "water",
                "representation": "fluid_planar",
                "volumes": [
                    {
                        "shape": {"kind": "box", "half_extents": [width / 2, 0.5, depth / 2]},
                        "position": [0, 0, depth / 2],
                    }
                ],
                "viscosity": 0.5,
            }
        ],
        emitters=[
            {
                "name": "tap",
                "fluid": "water",
                "position": [0, 0, height],
                "direction": [0, 0, -1],
                "radius": mouth / 2,
                "rate": told,
            }
        ],
        fluid_grid={"lower": [-width / 2, -0.5, 0], "upper": [width / 2, 0.5, 0.45], "cell": 0.03},
        environment={"motion_plane": {"normal": [0, -1, 0], "supports": False}, "gravity": [0, 0, -G]},
    )
    centre = np.full((len(times), 1, 3), np.nan)
    centre[:, 0, 2] = filling(times, rate=rate, width=width, depth=depth, height=height, speed=rate / mouth)
    return Case(
        f"filling box, {truth or 'nothing'}",
        truth,
        rate,
        frozenset({truth or ""}),
        "closed form: volume, and a jet in free fall",
        world,
        ("water",),
        times,
        centre,
        centre,
        LIQUID,
        0.003,
    )


def _slab(height: float) -> dict[str, Any]:
    return {"lower": [-1, -1, height - 0.001], "upper": [1, 1, height + 0.001]}


def _world(**parts: Any) -> World:
    return World.model_validate({"environment": {"gravity": [0, 0, -G]}} | parts)


CASES: tuple[tuple[Callable[[np.random.Generator, str | None], Case], str | None], ...] = (
    (rope_case, None),
    (rope_case, "air_drag"),
    (rope_case, "stretch_stiffness"),
    (rope_case, "material_damping"),
    (rope_case, "bending_stiffness"),
    (soft_case, None),
    (soft_case, "stretch_stiffness"),
    (soft_case, "material_damping"),
    (strip_case, None),
    (strip_case, "stretch_stiffness"),
    (strip_case, "material_damping"),
    (falling_case, None),
    (falling_case, "air_drag"),
    (swinging_case, "bending_stiffness"),
    (swinging_case, "air_drag"),
    (filling_case, None),
    (filling_case, "source_rate"),
)


def solved(case: Case, rng: np.random.Generator) -> dict[str, Any]:
    """The row of a case: its verdict, whether that is right, what it cost."""
    data, sealed = case.recordings(rng)
    offered = [catalogue()[n] for n in case.candidates]
    before, cpu = time.perf_counter(), time.process_time()
    settings = GapSettings(null_control=False, experiment=False)
    report = find_gap(case.world, data, sealed=sealed, candidates=offered, settings=settings)
    told = report.to_dict()
    sets = [frozenset(names) for names in told["credible_set"]]
    if case.truth is None:
        right = told["verdict"] == "nothing_missing"
    else:
        right = told["verdict"] in ("identified", "ambiguous") and any(s and s <= case.same for s in sets)
    return {
        "case": case.name,
        "code": case.code,
        "verdict": told["verdict"],
        "credible_set": [sorted(s) for s in sets],
        "truth": case.truth,
        "value": case.value,
        "found": {k: v["value"] for e in told["effects"] for k, v in e["unknowns"].items()},
        "right": right,
        "decisive_wrong": told["verdict"] == "identified" and not right,
        "sealed": told["sealed"],
        "seconds": time.perf_counter() - before,
        "cpu_seconds": time.process_time() - cpu,
    }


def rows(seed: int, only: str = "") -> list[dict[str, Any]]:
    """All rows whose names hold `only`, told on the standard error as they come."""
    found = []
    for index, (draw, truth) in enumerate(CASES):
        rng = np.random.default_rng([seed, index])
        if only not in f"{draw.__name__} {truth or 'nothing'}":
            continue
        row = solved(draw(rng, truth), rng)
        found.append(row)
        print(_line(row), file=sys.stderr, flush=True)
    return found


def _line(row: dict[str, Any]) -> str:
    closed = row["sealed"]["closed"] if row["sealed"] else None
    found = ", ".join(f"{k} {v:.3g}" for k, v in row["found"].items())
    told = " | ".join("+".join(s) or "nothing" for s in row["credible_set"])
    share = "-" if closed is None else f"{100 * closed:.0f}%"
    return (
        f"{'ok ' if row['right'] else 'NO '} {row['case']:<34} {row['verdict']:<16} {told} [{found}; true "
        f"{row['value']:.3g}] sealed gap closed {share}, {row['cpu_seconds']:.0f} s CPU"
    )


def main() -> None:
    """Run the cases and print their rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--only", default="", help="part of the name of a case")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    found = rows(chosen.seed, chosen.only)
    if chosen.json:
        print(json.dumps(found, indent=1))
    print(f"{sum(r['right'] for r in found)} of {len(found)} right", file=sys.stderr)


if __name__ == "__main__":
    main()
