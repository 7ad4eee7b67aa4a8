"""Draw where and how a clip is filmed: light, room, lens, and the look that the other generator shares."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

from tests.benchmarks.video_clips.bodies import Vec, vec
from tests.benchmarks.video_clips.looks import Look, draw_look

STYLES = (
    "window_light",
    "sun_patches",
    "ceiling_lights",
    "desk_lamp",
    "outdoors",
    "motion_blur",
    "shallow_focus",
    "hand",
    "mirror_floor",
    "carpet",
    "metal_bodies",
    "hand_held",
)
LIGHTS = ("window", "patches", "ceiling", "lamp", "outdoors")
SIZES = ((480, 270), (480, 360), (270, 480))
RATES = (24, 25, 30, 30, 30, 60)
FRAME_COUNTS = (40, 49)  # least, and one more than most
WALLS: tuple[Vec, ...] = (
    (0.88, 0.87, 0.84),
    (0.80, 0.77, 0.70),
    (0.72, 0.74, 0.75),
    (0.66, 0.72, 0.66),
    (0.62, 0.70, 0.78),
    (0.82, 0.70, 0.62),
    (0.50, 0.53, 0.56),
    (0.38, 0.45, 0.42),
)
FLOORS = ("wood", "tiles", "checker", "carpet", "concrete", "laminate")
BY_STYLE = {
    "window_light": "window",
    "sun_patches": "patches",
    "ceiling_lights": "ceiling",
    "desk_lamp": "lamp",
    "outdoors": "outdoors",
}


@dataclass(frozen=True)
class Lamp:
    """A rectangular light. side: direction from which it comes, degrees from the camera's; power relative."""

    side: float
    height: float
    away: float
    size: tuple[float, float]
    power: float
    rgb: Vec


@dataclass(frozen=True)
class Setting:
    """Draws beyond the other generator's look. Angles in degrees, lengths in m."""

    light: str
    lamps: tuple[Lamp, ...]
    sun: tuple[float, float, float, float]  # side from the camera, elevation, angular diameter, W/m^2 (0: none)
    sky: tuple[Vec, float]
    floor: str
    mirror: bool
    metal: bool
    hand: bool
    fstop: float  # 0 for everything sharp
    transform: str
    contrast: str
    brightness: float  # mean of the displayed picture that the exposure aims at
    wall_turn: float  # angle of the back wall to the picture's plane
    wall_gap: float  # from the farthest motion to the back wall
    wall_rgb: Vec
    rug: bool
    cable: bool
    pieces: int  # of furniture, at most


def _warmth(rng: Generator) -> Vec:
    return vec(((1.0, 0.80, 0.58), (1.0, 0.93, 0.84), (0.86, 0.93, 1.0))[int(rng.integers(3))])


def _lamps(rng: Generator, light: str) -> tuple[Lamp, ...]:
    if light == "window":
        side = float(rng.choice([-1, 1]) * rng.uniform(60, 115))
        main = Lamp(
            side, float(rng.uniform(1.2, 1.8)), 2.4, (float(rng.uniform(0.8, 1.4)), 1.4), 1.0, (0.88, 0.94, 1.0)
        )
        other = Lamp(float(rng.uniform(-60, 60)), 2.5, 1.0, (0.4, 0.4), float(rng.uniform(0.05, 0.3)), _warmth(rng))
        return (main, other) if rng.random() < 0.5 else (main,)
    if light == "ceiling":
        size = float(rng.uniform(0.15, 0.9))
        tint = _warmth(rng)
        return tuple(
            Lamp(float(rng.uniform(-180, 180)), 2.5, float(rng.uniform(0.2, 1.8)), (size, size), 1.0, tint)
            for _ in range(int(rng.integers(1, 4)))
        )
    if light == "lamp":
        size = float(rng.uniform(0.06, 0.2))
        side = float(rng.uniform(-130, 130))
        return (
            Lamp(side, float(rng.uniform(1.2, 2.0)), float(rng.uniform(0.5, 1.3)), (size, size), 1.0, _warmth(rng)),
        )
    return ()


def draw_style(rng: Generator, style: str, kind: str) -> tuple[Look, Setting]:
    """Draw the look and the setting around one leading style; others join now and then."""

    def also(name: str, chance: float) -> bool:
        return bool(rng.random() < chance) or style == name

    light = BY_STYLE.get(style, str(rng.choice(LIGHTS, p=[0.28, 0.14, 0.28, 0.15, 0.15])))
    size = SIZES[int(rng.choice(len(SIZES), p=[0.72, 0.16, 0.12]))]
    if size[0] < size[1] and kind in ("billiard", "cart", "ramp", "tossed"):
        size = SIZES[0]
    fps = int(rng.choice(RATES))
    seconds = (int(rng.integers(*FRAME_COUNTS)) - 1) / fps
    grey = bool(rng.random() < 0.08)
    level, tint = float(rng.uniform(0.3, 0.75)), np.zeros(3) if grey else rng.uniform(-0.12, 0.12, 3)
    bends = kind in ("rope", "cloth")
    look = replace(
        draw_look(rng, style),
        size=size,
        fps=fps,
        seconds=seconds,
        shadow="soft",
        floor="plain",
        floor_rgb=vec(np.clip(level + tint, 0.12, 0.9)),
        reflectance=0.0,
        grey=grey,
        light_swing=float(rng.uniform(0.1, 0.3)) if also("changing_light", 0.08) else 0.0,
        shake=float(rng.uniform(1.0, 3.0)) if also("hand_held", 0.1) else 0.0,
        shutter=0.0 if bends else float(rng.uniform(0.5, 0.95) if style == "motion_blur" else rng.uniform(0.1, 0.5)),
        small=bool(rng.random() < 0.06),
        occlude=bool(rng.random() < 0.12),
        noise=float(rng.uniform(3.0, 7.0) if rng.random() < 0.2 else rng.uniform(0.5, 2.0)),
        quality=int(rng.integers(25, 55)) if rng.random() < 0.25 else 0,
        caption="",
        marks=bool(rng.random() < 0.4),
    )
    floor = "carpet" if style == "carpet" else "concrete" if light == "outdoors" and rng.random() < 0.6 else ""
    mirror = also("mirror_floor", 0.05)
    choices = [f for f in FLOORS if not (grey and f == "wood") and not (mirror and f == "carpet")]
    floor = floor or str(rng.choice(choices))
    high = light == "outdoors" or light == "patches"
    sun = (float(rng.uniform(-100, 100)), float(rng.uniform(28, 60)), float(rng.choice([0.53, 1.0, 3.0, 6.0])), 3.5)
    fill = float(rng.uniform(0.5, 1.0) if light == "outdoors" else rng.uniform(0.2, 0.45))
    sky = (vec((0.55, 0.72, 1.0) if light == "outdoors" else (0.95, 0.96, 1.0)), fill)
    wall = np.asarray(WALLS[int(rng.integers(len(WALLS)))]) * float(rng.uniform(0.85, 1.05))
    transform, contrast = ("AgX", "AgX - Medium High Contrast") if rng.random() < 0.6 else ("Standard", "None")
    return look, Setting(
        light=light,
        lamps=_lamps(rng, light),
        sun=sun if high else (0.0, 45.0, 1.0, 0.0),
        sky=sky,
        floor="felt" if kind == "billiard" and not grey else floor,
        mirror=mirror,
        metal=also("metal_bodies", 0.06),
        hand=also("hand", 0.12),
        fstop=float(rng.uniform(0.5, 1.0)) if also("shallow_focus", 0.05) else 0.0,
        transform=transform,
        contrast=contrast,
        brightness=float(rng.uniform(0.36, 0.5)),
        wall_turn=float(rng.uniform(-25, 25)),
        wall_gap=float(rng.uniform(0.25, 1.2)),
        wall_rgb=vec(np.clip(np.full(3, wall.mean()) if grey else wall, 0.1, 0.95)),
        rug=bool(rng.random() < 0.2) and kind != "billiard",
        cable=bool(rng.random() < 0.2),
        pieces=int(rng.integers(2, 7)),
    )
