"""Draw furniture as pieces in the plane of a wall: x along it, y away from it (negative: into the room), z up."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

from tests.benchmarks.video_clips.bodies import Vec, vec

from .surfaces import Surface, any_surface, muted_rgb, shifted, wood


@dataclass(frozen=True)
class Piece:
    """A part of a piece of furniture; size: full extents in m. shape: box, sphere or cylinder."""

    shape: str
    size: Vec
    pos: Vec
    surface: Surface
    bevel: float = 0.006


@dataclass(frozen=True)
class Furniture:
    """Pieces around an origin on the floor (or, if hung, on the wall). size: full extents in m."""

    name: str
    size: Vec
    pieces: tuple[Piece, ...]
    hung: bool = False


def shelf(rng: Generator, grey: bool) -> Furniture:
    """Draw shelves with books."""
    w, d, h, levels = float(rng.uniform(0.6, 1.1)), 0.28, float(rng.uniform(0.8, 1.9)), int(rng.integers(3, 5))
    body = any_surface(rng, grey) if rng.random() < 0.5 or grey else wood(rng)
    parts = [Piece("box", (w, 0.015, h), (0, d / 2 - 0.008, h / 2), body)]
    parts.extend(Piece("box", (0.025, d, h), (s * w / 2, 0, h / 2), body, 0.003) for s in (-1, 1))
    for k in range(levels + 1):
        z = 0.02 + k * (h - 0.04) / levels
        parts.append(Piece("box", (w, d, 0.022), (0, 0, z), body, 0.003))
        x = -w / 2 + 0.04
        while k < levels and x < w / 2 * float(rng.uniform(-0.2, 0.95)):
            thick, tall = float(rng.uniform(0.02, 0.05)), float(rng.uniform(0.5, 0.85)) * (h / levels)
            rgb = muted_rgb(rng, grey)
            book = Surface("plain", rgb, rgb, 0.6)
            parts.append(Piece("box", (thick, 0.17, tall), (x, 0.02, z + 0.011 + tall / 2), book, 0.002))
            x += thick + 0.003
    return Furniture("shelf", (w, d, h), tuple(parts))


def sofa(rng: Generator, grey: bool) -> Furniture:
    """Draw a sofa of cushions."""
    w = float(rng.uniform(1.0, 1.7))
    s = replace(any_surface(rng, grey), roughness=0.95, metallic=0.0)
    parts = [Piece("box", (w, 0.7, 0.25), (0, 0, 0.2), s, 0.05), Piece("box", (w, 0.2, 0.5), (0, 0.27, 0.55), s, 0.08)]
    parts.extend(Piece("box", (0.18, 0.7, 0.55), (k * w / 2, 0, 0.3), s, 0.07) for k in (-1, 1))
    parts.extend(Piece("box", (w / 2 - 0.1, 0.55, 0.15), (k * w / 4, -0.06, 0.4), s, 0.06) for k in (-1, 1))
    rgb = muted_rgb(rng, grey)
    parts.append(Piece("box", (0.4, 0.14, 0.38), (w * 0.25, 0.1, 0.6), Surface("plain", rgb, rgb, 0.95), 0.06))
    return Furniture("sofa", (w + 0.2, 0.75, 0.85), tuple(parts))


def cabinet(rng: Generator, grey: bool) -> Furniture:
    """Draw a chest of drawers with knobs."""
    w, h, n = float(rng.uniform(0.5, 1.0)), float(rng.uniform(0.45, 0.95)), int(rng.integers(2, 5))
    body, steel = any_surface(rng, grey), Surface("plain", (0.75, 0.75, 0.75), (0.7, 0.7, 0.7), 0.25, 1.0)
    parts = [Piece("box", (w, 0.4, h), (0, 0, h / 2 + 0.03), body)]
    for k in range(n):
        z = 0.03 + (k + 0.5) * h / n
        parts.append(Piece("box", (w - 0.05, 0.02, h / n - 0.03), (0, -0.205, z), body, 0.005))
        parts.extend(Piece("sphere", (0.03,) * 3, (s * w / 4, -0.225, z), steel, 0.0) for s in (-1, 1))
    return Furniture("cabinet", (w, 0.46, h + 0.03), tuple(parts))


def plant(rng: Generator, grey: bool) -> Furniture:
    """Draw a bush in a pot."""
    clay, size = Surface("noise", (0.62, 0.36, 0.25), (0.5, 0.3, 0.2), 0.8), float(rng.uniform(0.7, 1.2))
    if grey:
        clay = replace(clay, rgb=(0.5, 0.5, 0.5), second=(0.4, 0.4, 0.4))
    green: Vec = (0.35, 0.35, 0.35) if grey else (0.16, 0.36, 0.13)
    leaf = Surface("speckle", green, shifted(green, 0.3), 0.6, scale=60.0)
    parts = [Piece("cylinder", (0.26 * size, 0.26 * size, 0.26 * size), (0, 0, 0.13 * size), clay)]
    for _ in range(26):
        at = rng.normal(0, 0.11, 3) * size + np.array([0, 0, 0.55 * size])
        long = float(rng.uniform(0.05, 0.16)) * size
        parts.append(Piece("sphere", vec((long, 0.4 * long, 1.3 * long)), vec(at), leaf, 0.0))
    return Furniture("plant", (0.6 * size, 0.6 * size, 0.95 * size), tuple(parts))


def crates(rng: Generator, grey: bool) -> Furniture:
    """Draw cardboard boxes piled up."""
    card: Vec = (0.5, 0.5, 0.5) if grey else (0.64, 0.48, 0.32)
    parts, z = [], 0.0
    for _ in range(int(rng.integers(1, 4))):
        s = rng.uniform(0.2, 0.4, 3)
        face = Surface("noise", card, shifted(card, -0.12), 0.85, scale=3.0)
        parts.append(Piece("box", vec(s), (float(rng.normal(0, 0.03)), 0.0, z + float(s[2]) / 2), face, 0.004))
        tape = Surface("plain", shifted(card, 0.35), card, 0.2)
        parts.append(
            Piece("box", vec((0.05, s[1] + 0.002, s[2] + 0.002)), (0.0, 0.0, z + float(s[2]) / 2), tape, 0.001)
        )
        z += float(s[2])
    return Furniture("crates", (0.45, 0.42, z), tuple(parts))


def chair(rng: Generator, grey: bool) -> Furniture:
    """Draw a chair with four legs."""
    s = any_surface(rng, grey)
    parts = [
        Piece("box", (0.42, 0.42, 0.04), (0, 0, 0.45), s, 0.012),
        Piece("box", (0.42, 0.03, 0.3), (0, 0.2, 0.75), s),
    ]
    parts.extend(Piece("cylinder", (0.035, 0.035, 0.45), (x, -0.18, 0.225), s) for x in (-0.18, 0.18))
    parts.extend(Piece("cylinder", (0.035, 0.035, 0.9), (x, 0.2, 0.45), s) for x in (-0.18, 0.18))
    return Furniture("chair", (0.45, 0.45, 0.9), tuple(parts))


def picture(rng: Generator, grey: bool) -> Furniture:
    """Draw a framed picture on the wall."""
    w, h, z = float(rng.uniform(0.25, 0.7)), float(rng.uniform(0.25, 0.6)), float(rng.uniform(0.7, 1.5))
    inner = Surface(
        "marble", muted_rgb(rng, grey), muted_rgb(rng, grey), 0.4, scale=float(rng.uniform(3, 9)), upright=True
    )
    rim = any_surface(rng, grey)
    parts = (
        Piece("box", (w, 0.02, h), (0, -0.012, z), rim, 0.004),
        Piece("box", (w - 0.06, 0.012, h - 0.06), (0, -0.019, z), inner, 0.001),
    )
    return Furniture("picture", (w, 0.04, h), parts, hung=True)


def socket(_rng: Generator, _grey: bool) -> Furniture:
    """Draw a power outlet on the wall."""
    white = Surface("plain", (0.9, 0.9, 0.88), (0.9, 0.9, 0.88), 0.3)
    dark = Surface("plain", (0.2, 0.2, 0.2), (0.2, 0.2, 0.2), 0.5)
    holes = tuple(Piece("sphere", (0.008, 0.008, 0.008), (x, -0.012, 0.25), dark, 0.0) for x in (-0.01, 0.01))
    return Furniture(
        "socket", (0.08, 0.02, 0.08), (Piece("box", (0.08, 0.014, 0.08), (0, -0.007, 0.25), white), *holes), True
    )


INDOORS: tuple[Callable[[Generator, bool], Furniture], ...] = (
    shelf, sofa, cabinet, plant, crates, chair, picture, picture, socket,
)  # fmt: skip
OUTDOORS: tuple[Callable[[Generator, bool], Furniture], ...] = (plant, plant, crates, chair)
