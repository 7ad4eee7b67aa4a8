"""Describe surfaces: pattern, colours, gloss. Colours are as displayed (sRGB, 0 to 1)."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

from tests.benchmarks.video_clips.bodies import Vec, vec


@dataclass(frozen=True)
class Surface:
    """A surface. scale: features per m; bump: height of the relief in m; coat: weight of a clear gloss coat."""

    pattern: str  # plain, noise, grain, planks, checker, tiles, carpet, stripes, marble, brick, speckle, patches, weave
    rgb: Vec
    second: Vec
    roughness: float = 0.5
    metallic: float = 0.0
    coat: float = 0.0
    bump: float = 0.0
    scale: float = 10.0
    skin: bool = False
    uv: bool = False  # pattern fixed to the uv map of a thing that bends
    upright: bool = False  # pattern in the plane of x and z


WOODS: tuple[tuple[Vec, Vec], ...] = (
    ((0.72, 0.53, 0.34), (0.56, 0.37, 0.21)),
    ((0.50, 0.33, 0.20), (0.34, 0.20, 0.11)),
    ((0.83, 0.71, 0.53), (0.70, 0.55, 0.37)),
    ((0.62, 0.57, 0.50), (0.48, 0.43, 0.37)),
)
SKINS: tuple[Vec, ...] = ((0.87, 0.67, 0.55), (0.70, 0.49, 0.36), (0.45, 0.29, 0.20), (0.93, 0.76, 0.66))


def shifted(rgb: Vec, by: float) -> Vec:
    """Return a lighter (by > 0) or darker colour of the same hue."""
    c = np.asarray(rgb)
    return vec(np.clip(c + by * (1 - c) if by > 0 else c * (1 + by), 0.01, 0.98))


def wood(rng: Generator, pattern: str = "grain") -> Surface:
    """Draw a wood."""
    light, dark = WOODS[int(rng.integers(len(WOODS)))]
    return Surface(pattern, light, dark, float(rng.uniform(0.25, 0.6)), bump=2e-4, scale=float(rng.uniform(5, 9)))


def body_surface(rng: Generator, rgb: Vec, size: float, grey: bool, metal: bool) -> Surface:
    """Draw the surface of a body of a colour; size: its extent in m. A pattern keeps most of the colour."""
    plain = Surface("plain", rgb, rgb, float(rng.uniform(0.15, 0.7)), coat=float(rng.choice([0.0, 0.0, 0.7])))
    if metal:
        return replace(plain, metallic=1.0, roughness=float(rng.uniform(0.12, 0.4)), coat=0.0)
    pattern = str(
        rng.choice(
            ["plain", "grain", "stripes", "speckle", "patches", "marble", "noise"],
            p=[0.32, 0.12, 0.16, 0.1, 0.1, 0.08, 0.12],
        )
    )
    other = shifted(rgb, float(rng.choice([-0.55, 0.5])))
    if pattern in ("stripes", "patches") and not grey and rng.random() < 0.5:
        other = (0.93, 0.92, 0.88)
    across = {"stripes": 1.6, "patches": 2.5, "speckle": 14.0, "marble": 3.0, "noise": 12.0, "grain": 1.5}
    bump = float(rng.uniform(0.005, 0.02)) * size if pattern == "noise" else 0.0
    return replace(plain, pattern=pattern, second=other, bump=bump, scale=across.get(pattern, 5.0) / size)


def floor_surface(rng: Generator, kind: str, rgb: Vec, mirror: bool) -> Surface:
    """Draw a floor: wood, tiles, carpet, concrete, laminate (plain) or felt."""
    rough = float(rng.uniform(0.05, 0.14)) if mirror else float(rng.uniform(0.3, 0.6))
    if kind == "wood":
        return replace(wood(rng, "planks"), roughness=rough, scale=float(rng.uniform(6, 11)))
    if kind == "tiles":
        return Surface("tiles", rgb, shifted(rgb, -0.35), rough, bump=1e-3, scale=float(rng.uniform(2.5, 6)))
    if kind == "checker":
        return Surface(
            "checker", rgb, shifted(rgb, -float(rng.uniform(0.3, 0.7))), rough, scale=float(rng.uniform(3, 7))
        )
    if kind == "carpet":
        return Surface("carpet", rgb, shifted(rgb, -0.5), 0.95, bump=4e-3, scale=float(rng.uniform(120, 220)))
    if kind == "concrete":
        level = float(np.mean(rgb))
        pale = vec(np.array([1.0, 0.99, 0.96]) * (0.7 * level + 0.1) + 0.1 * np.asarray(rgb))
        return Surface(
            "noise", pale, shifted(pale, -0.16), rough, bump=0.0 if mirror else 5e-4, scale=float(rng.uniform(5, 12))
        )
    if kind == "felt":
        return Surface("carpet", rgb, shifted(rgb, -0.2), 0.95, bump=6e-4, scale=700.0)
    return Surface("plain", rgb, rgb, rough)


def wall_surface(rng: Generator, rgb: Vec, grey: bool) -> Surface:
    """Draw a wall: plaster, wallpaper, brick, wood panels or tiles."""
    return replace(_wall(rng, rgb, grey), upright=True)


def _wall(rng: Generator, rgb: Vec, grey: bool) -> Surface:
    kind = str(rng.choice(["plaster", "wallpaper", "brick", "panels", "tiles"], p=[0.45, 0.2, 0.12, 0.13, 0.1]))
    if kind == "wallpaper":
        return Surface(
            "stripes", rgb, shifted(rgb, -float(rng.uniform(0.05, 0.2))), 0.8, scale=float(rng.uniform(6, 14))
        )
    if kind == "brick":
        warm: Vec = rgb if grey else (0.62, 0.36, 0.27)
        return Surface("brick", warm, (0.75, 0.72, 0.68), 0.9, bump=4e-3, scale=float(rng.uniform(3.5, 5)))
    if kind == "panels" and not grey:
        return replace(wood(rng, "planks"), scale=float(rng.uniform(4, 8)))
    if kind == "tiles":
        return Surface("tiles", rgb, shifted(rgb, -0.25), 0.15, bump=1e-3, scale=float(rng.uniform(5, 8)))
    return Surface("noise", rgb, shifted(rgb, -0.06), 0.9, bump=6e-4, scale=30.0)


def muted_rgb(rng: Generator, grey: bool) -> Vec:
    """Draw a colour of things in rooms: mostly little saturated."""
    level = float(rng.uniform(0.12, 0.88))
    if grey:
        return (level, level, level)
    free = rng.uniform(0.1, 0.85, 3)
    share = 0.8 if rng.random() < 0.2 else float(rng.uniform(0.1, 0.4))
    return vec(np.clip((1 - share) * level * np.array([1.03, 1.0, 0.95]) + share * free, 0.03, 0.92))


def any_surface(rng: Generator, grey: bool) -> Surface:
    """Draw the surface of a piece of furniture."""
    if rng.random() < 0.4 and not grey:
        return wood(rng)
    rgb = muted_rgb(rng, grey)
    pattern = str(rng.choice(["plain", "noise", "weave"]))
    return Surface(pattern, rgb, shifted(rgb, -0.3), float(rng.uniform(0.3, 0.9)), scale=float(rng.uniform(40, 150)))
