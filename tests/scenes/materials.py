"""Scenes of ropes, sheets and soft blocks, and what is seen of them by code that shares nothing with the engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.data.recording import Recording, Run
from polyworld.world import World

Array = NDArray[np.float64]

G = 9.81
AIR = 1.2  # density [kg/m^3]
TAU = 0.01  # [s] of the strain rate, in bodies that ring
SURVEY = 100  # frames of the body at rest, before it is let go, whose mean is the first sample
FORCES = ("gravity_error", "tilt", "linear_drag", "quadratic_drag")
MATERIALS = ("material_damping", "air_drag", "bending_stiffness", "stretch_stiffness")


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
        told = Recording((self._run("run", self.paths, rng),))
        return told, Recording((self._run("sealed", self.other, rng),))

    def _run(self, name: str, paths: Array, rng: np.random.Generator) -> Run:
        seen = paths + rng.normal(0.0, self.sigma, paths.shape)
        seen[0] = paths[0] + (seen[0] - paths[0]) / np.sqrt(SURVEY)
        return Run(name, self.markers, self.times, seen, np.full((*paths.shape[:2], 4), np.nan))


# Chains of point masses: a rope that swings, and a sheet that does.


@dataclass(frozen=True)
class Chain:
    """A rope, or a sheet of unit flexure along its width, as n point masses on springs.

    length [m], density [kg/m], stretch: EA [N], tau: of the strain rate [s], damping: dv/dt = -c v [1/s], bending: EI
    [N m^2], drag: force per length and squared speed across it, rho C width / 2 [kg/m^2].
    """

    length: float
    links: int
    density: float
    stretch: float
    tau: float
    damping: float = 0.0
    bending: float = 0.0
    drag: float = 0.0

    def swing(self, angle: float, times: Array) -> Array:
        """Nodes (T, n + 1, 3), held at the origin and let go, straight, at an angle from the vertical."""
        along = np.linspace(0.0, self.length, self.links + 1)[1:, None]
        start = along * np.array([np.sin(angle), -np.cos(angle)])
        found = solve_ivp(
            lambda _t, y: self._slope(y),
            (0.0, times[-1]),
            np.concatenate([start.ravel(), np.zeros(2 * self.links)]),
            t_eval=times,
            method="LSODA",
            rtol=1e-8,
            atol=1e-9,
        )
        nodes = np.zeros((len(times), self.links + 1, 3))
        nodes[:, 1:, ::2] = found.y.T[:, : 2 * self.links].reshape(len(times), self.links, 2)
        return nodes

    def _slope(self, y: Array) -> Array:
        """Tension EA (strain + tau strain rate); bending by its energy EI kappa^2 / (2 l) with kappa = 2 tan(theta / 2)
        (Bergou et al. 2008, ACM Trans. Graph. 27, 63)."""
        link = self.length / self.links
        mass = np.full(self.links, self.density * link)
        mass[-1] /= 2.0
        x = np.vstack([np.zeros(2), y[: 2 * self.links].reshape(-1, 2)])
        v = np.vstack([np.zeros(2), y[2 * self.links :].reshape(-1, 2)])
        along, speed = np.diff(x, axis=0), np.diff(v, axis=0)
        size = np.linalg.norm(along, axis=1, keepdims=True)
        unit = along / size
        normal = np.column_stack([-unit[:, 1], unit[:, 0]])
        rate = np.sum(speed * unit, axis=1, keepdims=True)
        tension = self.stretch * (size / link - 1.0 + self.tau * rate / link) * unit
        across = np.sum(0.5 * (v[1:] + v[:-1]) * normal, axis=1, keepdims=True)
        air = -0.5 * self.drag * size * np.abs(across) * across * normal
        force = np.zeros_like(x)
        force[:-1] += tension + air
        force[1:] += air - tension
        if self.bending:
            turn = np.arctan2(
                unit[:-1, 0] * unit[1:, 1] - unit[:-1, 1] * unit[1:, 0], np.sum(unit[:-1] * unit[1:], axis=1)
            )
            half = np.tan(turn / 2.0)
            moment = 2.0 * self.bending * half * (1.0 + half**2) / link
            lever = normal / size
            force[:-2] -= moment[:, None] * lever[:-1]
            force[1:-1] += moment[:, None] * (lever[:-1] + lever[1:])
            force[2:] -= moment[:, None] * lever[1:]
        acceleration = force[1:] / mass[:, None] - self.damping * v[1:] - np.array([0.0, G])
        return np.concatenate([v[1:].ravel(), acceleration.ravel()])


ROPE = Chain(length=1.0, links=10, density=0.1, stretch=50.0, tau=0.01, damping=0.05, bending=1e-4)


def rope_case(rng: np.random.Generator, truth: str | None) -> Case:
    """A rope let go at 50 to 70 degrees from the vertical, 1.2 seconds, three markers."""
    angle = float(rng.uniform(np.radians(50.0), np.radians(70.0)))
    field, value = {
        "air_drag": ("damping", float(rng.uniform(0.4, 0.8))),
        "stretch_stiffness": ("stretch", float(rng.uniform(18.0, 25.0))),
        "material_damping": ("tau", float(rng.uniform(0.06, 0.1))),
        "bending_stiffness": ("bending", float(rng.uniform(2e-3, 4e-3))),
        None: ("tau", ROPE.tau),
    }[truth]
    times = np.arange(37) / 30.0
    nodes = replace(ROPE, **{field: value}).swing(angle, times)
    rope = {
        "name": "rope",
        "representation": "rope",
        "points": [(0, 0, 0), (ROPE.length * np.sin(angle), 0, -ROPE.length * np.cos(angle))],
        "segments": ROPE.links,
        "linear_density": ROPE.density,
        "stretch_stiffness": ROPE.stretch,
        "stretch_damping": ROPE.tau,
        "bending_stiffness": ROPE.bending,
        "linear_damping": ROPE.damping,
    }
    world = scene(deformables=[rope], attachments=[{"name": "held", "object": "rope", "end": "start"}])
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


def hung(depth: Array, moved: Array, x: float) -> Array:
    """Places (T, n, 3) at rest depths (n,) below the held end, moved (T, n) downwards, at x."""
    places = np.zeros((*moved.shape, 3))
    places[..., 0] = x
    places[..., 2] = -depth - moved
    return places


def ringing_case(
    rng: np.random.Generator,
    truth: str | None,
    *,
    name: str,
    code: str,
    stiffness: float,
    density: float,
    length: float,
    times: Array,
    parts: dict[str, Any],
    x: float,
    markers: Sequence[float],
) -> Case:
    """A body that hangs from its top and rings along its length.

    stiffness over density: squared speed of its waves. parts: of its world, where its damping takes TAU. x [m] of the
    markers; their depths [m]: three that are seen and three that are sealed.
    """
    value = {
        "stretch_stiffness": stiffness * float(rng.uniform(1.4, 1.8)),
        "material_damping": float(rng.uniform(0.03, 0.05)),
        None: 0.0,
    }[truth]
    speed = np.sqrt((value if truth == "stretch_stiffness" else stiffness) / density)
    depth = np.array(markers)
    moved = ringing(depth, times, length=length, speed=speed, tau=value if truth == "material_damping" else TAU)
    paths = hung(depth, moved, x)
    body = parts["deformables"][0]["name"]
    return Case(
        f"{name}, {truth or 'nothing'}",
        truth,
        value,
        frozenset({truth or ""}),
        f"closed form: {code}",
        scene(attachments=[{"name": "held", "object": body, "region": slab(0.0)}], **parts),
        tuple(f"{body}#{k}" for k in range(3)),
        times,
        paths[:, :3],
        paths[:, 3:],
        (*MATERIALS, *FORCES),
        0.001,
    )


def soft_case(rng: np.random.Generator, truth: str | None) -> Case:
    """A block of gelatine, 0.4 m long."""
    length, density, modulus = 0.4, 1000.0, 8e4
    block = {
        "name": "block",
        "representation": "soft_planar",
        "shape": {"kind": "box", "half_extents": [0.05, 0.05, length / 2]},
        "position": [0, 0, -length / 2],
        "thickness": 0.1,
        "resolution": 0.1,
        "density": density,
        "youngs_modulus": modulus,
        "poisson_ratio": 0.0,
        "damping": TAU,
    }
    return ringing_case(
        rng,
        truth,
        name="soft block",
        code="waves along a bar",
        stiffness=modulus,
        density=density,
        length=length,
        times=np.arange(31) / 60.0,
        parts={
            "deformables": [block],
            "environment": {"motion_plane": {"normal": [0, -1, 0], "supports": False}, "gravity": [0, 0, -G]},
        },
        x=0.0,
        markers=(0.2, 0.3, 0.4, 0.1, 0.25, 0.35),
    )


def sheet(corner: Sequence[float], edge_u: Sequence[float], edge_v: Sequence[float], **more: Any) -> dict[str, Any]:
    """A sheet of 6 x 6 squares."""
    geometry = {"kind": "sheet", "corner": corner, "edge_u": edge_u, "edge_v": edge_v, "divisions": (6, 6)}
    return {"name": "sheet", "representation": "cloth", "geometry": geometry, "self_contact": False, **more}


def strip_case(rng: np.random.Generator, truth: str | None) -> Case:
    """A rubber sheet."""
    length, density, stiffness = 0.6, 1.0, 60.0
    rubber = {
        "areal_density": density,
        "stretch_stiffness": stiffness,
        "poisson_ratio": 0.0,
        "stretch_damping": TAU,
        "drag_normal": 0.0,
        "drag_tangential": 0.0,
    }
    return ringing_case(
        rng,
        truth,
        name="hanging sheet",
        code="waves along a strip",
        stiffness=stiffness,
        density=density,
        length=length,
        times=np.arange(37) / 60.0,
        parts={"deformables": [sheet((0, 0, 0), (0.6, 0, 0), (0, 0, -length), **rubber)]},
        x=0.3,
        markers=(0.3, 0.4, 0.6, 0.2, 0.35, 0.5),
    )


# A flat sheet that falls.


def falling_case(rng: np.random.Generator, truth: str | None) -> Case:
    """A sheet of 6 x 6 squares let go flat: m dv/dt = m g - rho C v^2 / 2 per area."""
    density, air, stated = 0.1, AIR, 0.6
    value = {"air_drag": stated * float(rng.uniform(1.8, 2.6)), None: stated}[truth]
    terminal = np.sqrt(2.0 * density * G / (air * value))
    cloth = {"areal_density": density, "stretch_stiffness": 200.0, "drag_normal": stated, "drag_tangential": 0.02}
    times = np.arange(31) / 30.0
    world = scene(
        deformables=[sheet((-0.3, -0.3, 0), (0.6, 0, 0), (0, 0.6, 0), **cloth)],
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


# A sheet that swings.

SHEET = Chain(length=0.6, links=6, density=0.12, stretch=120.0, tau=0.01, bending=6e-4, drag=0.5 * AIR * 0.6)


def swinging_case(rng: np.random.Generator, truth: str | None) -> Case:
    """A stiff sheet of 6 x 6 squares, held along an edge and let go from 40 degrees below the horizontal.

    A sheet's rows across it move alike, so that a chain of its width's mass, stiffness and drag is its counterpart. The
    engine's few triangles, which divide every square the same way, are up to 4 mm off: as much as the noise.
    """
    width, angle = 0.6, np.radians(50.0)
    field, value, actual = {
        "bending_stiffness": ("bending", d := float(rng.uniform(4e-3, 8e-3)), width * d),
        "air_drag": ("drag", c := float(rng.uniform(2.0, 3.0)), 0.5 * AIR * width * c),
        None: ("drag", 1.0, SHEET.drag),
    }[truth]
    times = np.arange(31) / 30.0
    nodes = replace(SHEET, **{field: actual}).swing(angle, times)
    end = SHEET.length * np.array([np.sin(angle), -np.cos(angle)])
    cloth = {
        "areal_density": SHEET.density / width,
        "stretch_stiffness": SHEET.stretch / width,
        "poisson_ratio": 0.0,
        "stretch_damping": SHEET.tau,
        "bending_stiffness": SHEET.bending / width,
        "drag_normal": 1.0,
        "drag_tangential": 0.0,
    }
    world = scene(
        deformables=[sheet((0, -width / 2, 0), (0, width, 0), (end[0], 0, end[1]), **cloth)],
        attachments=[
            {
                "name": "held",
                "object": "sheet",
                "region": {"lower": [-0.001, -1, -0.001], "upper": [0.001, 1, 0.001]},
            }
        ],
        environment={"gravity": [0, 0, -G], "air_density": AIR},
    )

    def paths(markers: Sequence[tuple[int, float]]) -> Array:
        places = nodes[:, [k for k, _ in markers]].copy()
        places[..., 1] = [y for _, y in markers]
        return places

    return Case(
        f"swinging sheet, {truth or 'nothing'}",
        truth,
        value,
        frozenset({truth or ""}),
        "SciPy: point masses on springs",
        world,
        ("sheet#0", "sheet#1", "sheet#2"),
        times,
        paths([(3, 0.0), (6, -0.2), (6, 0.1)]),
        paths([(2, 0.1), (4, -0.2), (5, 0.2)]),
        (*MATERIALS, *FORCES),
        0.004,
    )


def slab(height: float) -> dict[str, Any]:
    """The region of all points at one height."""
    return {"lower": [-1, -1, height - 0.001], "upper": [1, 1, height + 0.001]}


def scene(**parts: Any) -> World:
    """A world with gravity, and these parts."""
    return World.model_validate({"environment": {"gravity": [0, 0, -G]}} | parts)
