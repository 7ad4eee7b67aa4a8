"""Scenes of fluids of which the centre is seen, and its path in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np

from polyworld.world import World
from tests.scenes.materials import Array, Case, G, scene

LIQUID = ("viscosity", "surface_tension", "source_rate", "gravity_error", "tilt")


def planar(
    fluid: dict[str, Any],
    *,
    size: tuple[float, float],
    cell: float,
    gravity: tuple[float, float, float] = (0.0, 0.0, -G),
    **parts: Any,
) -> World:
    """A fluid in a box (x, z) of a vertical plane, x from -size / 2, z from 0."""
    return scene(
        deformables=[fluid | {"representation": "fluid_planar"}],
        fluid_grid={"lower": [-size[0] / 2, -0.5, 0], "upper": [size[0] / 2, 0.5, size[1]], "cell": cell},
        environment={"motion_plane": {"normal": [0, -1, 0], "supports": False}, "gravity": gravity},
        **parts,
    )


def block(width: float, bottom: float, top: float) -> list[dict[str, Any]]:
    """The volume of a rectangle of liquid."""
    return [
        {
            "shape": {"kind": "box", "half_extents": [width / 2, 0.5, (top - bottom) / 2]},
            "position": [0, 0, (top + bottom) / 2],
        }
    ]


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
    world = scene(
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


# A column of honey between plates that it sticks to.


def sinking(times: Array, *, width: float, nu: float) -> Array:
    """How far (T,) a long column has sunk: plane Poiseuille flow from rest, sum over odd modes of its decay to
    g width^2 / 12 nu (Batchelor 1967, An Introduction to Fluid Dynamics, 4.3)."""
    total = np.zeros(len(times))
    for n in range(1, 40, 2):
        rate = nu * (n * np.pi / width) ** 2
        total += 8.0 * G / (n * np.pi) ** 2 / rate * (times - (1.0 - np.exp(-rate * times)) / rate)
    return total


def sinking_case(rng: np.random.Generator, truth: str | None) -> Case:
    """A column of honey sinks between two plates, a fifth of a second, the height of its centre."""
    width, bottom, top, told = 0.1, 0.35, 0.95, 20.0
    value = {"viscosity": told * float(rng.uniform(0.5, 0.7)), None: told}[truth]
    times = np.arange(21) / 100.0
    honey = {"name": "honey", "volumes": block(width, bottom, top), "viscosity": told, "slip": False}
    centre = np.full((len(times), 1, 3), np.nan)
    centre[:, 0, 2] = (bottom + top) / 2.0 - sinking(times, width=width, nu=value / 1000.0)
    return Case(
        f"sinking honey, {truth or 'nothing'}",
        truth,
        value,
        frozenset({truth or ""}),
        "closed form: plane Poiseuille flow from rest",
        planar(honey, size=(width, top + 0.05), cell=0.0125),
        ("honey",),
        times,
        centre,
        centre,
        LIQUID,
        0.003,
    )


# Water that sways on another body than Earth, where surface tension is a good part of what brings it back.


def swaying(
    times: Array, *, length: float, depth: float, tension: float, nu: float, weight: float, push: float
) -> Array:
    """The centre (T,) along a box of liquid, level at first, that is accelerated along it from then on.

    Odd standing waves, omega^2 = (g k + tension k^3 / rho) tanh(k h), each with the share 8 tanh(k h) L / (n^3 pi^3 h)
    of the mass, dying as exp(-2 nu k^2 t) (Lamb 1932, Hydrodynamics, 267 and 348; Ibrahim 2005, Liquid Sloshing
    Dynamics, 5.2). The surface meets the walls at a right angle.
    """
    total = np.zeros(len(times))
    for n in range(1, 12, 2):
        k = n * np.pi / length
        deep = np.tanh(k * depth)
        omega, decay = np.sqrt((weight * k + tension * k**3 / 1000.0) * deep), 2.0 * nu * k**2
        share = 8.0 * deep / ((n * np.pi) ** 3 * depth / length)
        total += share * push / omega**2 * (1.0 - np.exp(-decay * times) * np.cos(omega * times))
    return total


def swaying_case(rng: np.random.Generator, truth: str | None) -> Case:
    """Water in a small box under a twentieth of Earth's gravity, 1.4 seconds, its centre along the box.

    A grid of 12 x 6 cells of water is some 0.2 mm off the 1.5 mm that the centre sways: the noise is twice that.
    Weight and tension bring the water back together; in the first wave, nearly all of the motion, they are almost one.
    """
    length, depth, told, viscosity, weight, push = 0.06, 0.03, 0.02, 0.02, 0.5, 0.05
    value = {"surface_tension": float(rng.uniform(0.15, 0.25)), None: told}[truth]
    times = np.arange(22) / 15.0
    water = {"name": "water", "volumes": block(length, 0.0, depth), "viscosity": viscosity, "surface_tension": told}
    centre = np.full((len(times), 1, 3), np.nan)
    centre[:, 0, 0] = swaying(
        times, length=length, depth=depth, tension=value, nu=viscosity / 1000.0, weight=weight, push=push
    )
    return Case(
        f"swaying water, {truth or 'nothing'}",
        truth,
        value,
        frozenset({truth or ""}),
        "closed form: standing waves",
        planar(water, size=(length, 1.5 * depth), cell=0.005, gravity=(push, 0.0, -weight)),
        ("water",),
        times,
        centre,
        centre,
        LIQUID,
        4e-4,
    )
