"""Draw how a clip looks: light, floor, camera faults, frame rate, frame size, colours."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

from .bodies import Body, Scene, Vec, vec

STYLES = (
    "hard_shadow",
    "soft_shadow",
    "no_shadow",
    "grey",
    "textured_floor",
    "reflecting_floor",
    "changing_light",
    "camera_shake",
    "motion_blur",
    "small_bodies",
    "occlusion",
    "sensor_noise",
    "compression",
    "caption",
)
RATES = (12, 15, 20, 24, 25, 30, 50, 60)
FRAMES = ((320, 240), (400, 300), (480, 360), (640, 480), (360, 640))
PALETTE: dict[str, Vec] = {
    "red": (0.80, 0.12, 0.10),
    "green": (0.12, 0.60, 0.18),
    "blue": (0.12, 0.25, 0.80),
    "yellow": (0.90, 0.78, 0.10),
    "orange": (0.92, 0.45, 0.08),
    "purple": (0.48, 0.15, 0.60),
    "cyan": (0.10, 0.65, 0.70),
    "pink": (0.90, 0.50, 0.62),
    "brown": (0.42, 0.26, 0.14),
    "white": (0.92, 0.92, 0.90),
    "black": (0.08, 0.08, 0.09),
}


@dataclass(frozen=True)
class Look:
    """All choices about looks. Lengths in pixels, shares of 1, angles in degrees."""

    style: str
    size: tuple[int, int]
    fps: int
    seconds: float
    shadow: str  # hard, soft or none
    floor: str  # plain, noise, checker or wood
    floor_rgb: Vec
    reflectance: float
    grey: bool
    alike: bool  # some bodies of similar colour
    light_swing: float  # share by which the light changes
    shake: float  # pixels
    shutter: float  # share of the frame time, 0 without blur
    small: bool
    occlude: bool
    noise: float  # grey levels
    quality: int  # 0 without extra compression, else 5..40
    caption: str
    container: str  # mp4 or avi
    marks: bool  # whether the marks are drawn
    brightness: float
    sun: tuple[float, float]  # azimuth, elevation of the key light
    fovy: float

    @property
    def frames(self) -> int:
        """Return the number of frames."""
        return round(self.seconds * self.fps) + 1


def draw_look(rng: Generator, style: str) -> Look:
    """Draw looks around one leading style; other styles join now and then."""

    def also(name: str, chance: float) -> bool:
        return bool(rng.random() < chance) or style == name

    size = FRAMES[int(rng.choice(len(FRAMES), p=[0.3, 0.2, 0.2, 0.18, 0.12]))]
    fps = int(rng.choice(RATES, p=[0.1, 0.12, 0.1, 0.13, 0.15, 0.25, 0.08, 0.07]))
    shadow = str(rng.choice(["hard", "soft", "none"], p=[0.55, 0.1, 0.35]))
    shadow = {"hard_shadow": "hard", "soft_shadow": "soft", "no_shadow": "none"}.get(style, shadow)
    if style in ("reflecting_floor", "motion_blur") and shadow == "soft":
        shadow = "hard"
    if size == (640, 480) and (shadow == "soft" or style == "motion_blur"):
        size = (480, 360)  # several renders a frame
    longest = 1.6 if fps >= 50 or size[0] >= 640 else 2.2 if shadow == "soft" or style == "motion_blur" else 3.0
    seconds = round(float(rng.uniform(1.0, longest)) * fps) / fps
    floor = str(rng.choice(["plain", "noise", "checker", "wood"], p=[0.55, 0.15, 0.15, 0.15]))
    if style == "textured_floor":
        floor = str(rng.choice(["noise", "checker", "wood"]))
    grey = also("grey", 0.05)
    level = float(rng.uniform(0.35, 0.62))
    tint = np.zeros(3) if grey else rng.uniform(-0.1, 0.1, 3)
    caption = str(rng.choice(["timer", "title", "both"])) if also("caption", 0.12) else ""
    return Look(
        style=style,
        size=size,
        fps=fps,
        seconds=seconds,
        shadow=shadow,
        floor="plain" if grey and floor == "wood" else floor,
        floor_rgb=vec(np.clip(level + tint, 0.15, 0.85)),
        reflectance=float(rng.uniform(0.12, 0.35)) if also("reflecting_floor", 0.06) else 0.0,
        grey=grey,
        alike=bool(rng.random() < 0.3),
        light_swing=float(rng.uniform(0.2, 0.4)) if also("changing_light", 0.08) else 0.0,
        shake=float(rng.uniform(1.0, 3.0)) if also("camera_shake", 0.1) else 0.0,
        shutter=float(rng.uniform(0.4, 0.9)) if also("motion_blur", 0.05) else 0.0,
        small=also("small_bodies", 0.05),
        occlude=also("occlusion", 0.1),
        noise=float(rng.uniform(4.0, 10.0)) if also("sensor_noise", 0.15) else float(rng.uniform(0.0, 1.5)),
        quality=int(rng.integers(8, 26)) if also("compression", 0.1) else 0,
        caption=caption,
        container="avi" if rng.random() < 0.2 else "mp4",
        marks=bool(rng.random() < 0.6),
        brightness=float(rng.uniform(0.85, 1.1)),
        sun=(float(rng.uniform(-180, 180)), float(rng.uniform(40, 70))),
        fovy=float(rng.uniform(28, 50)),
    )


def _shade(rng: Generator, rgb: Vec, spread: float) -> Vec:
    return vec(np.clip(np.asarray(rgb) + rng.normal(0.0, spread, 3), 0.02, 0.97))


def _grey(rng: Generator) -> tuple[str, Vec]:
    level = float(rng.choice([rng.uniform(0.18, 0.3), rng.uniform(0.4, 0.6), rng.uniform(0.68, 0.85)]))
    name = "dark grey" if level < 0.35 else "light grey" if level > 0.64 else "grey"
    return name, (level, level, level)


def paint(rng: Generator, scene: Scene, look: Look) -> Scene:
    """Give every body and hung thing its colour."""
    names = [str(x) for x in rng.permutation(list(PALETTE))]
    if look.alike and len(scene.bodies) > 1:
        names[1] = names[0]
    bodies: list[Body] = []
    for i, b in enumerate(scene.bodies):
        name = names[i % len(names)]
        rgb = _shade(rng, PALETTE[name], 0.03)
        if look.grey:
            name, rgb = _grey(rng)
        bodies.append(replace(b, color=name, rgb=rgb))
    fixtures = scene.fixtures
    if look.grey:
        fixtures = tuple(replace(f, color="grey", rgb=vec([sum(f.rgb) / 3] * 3)) for f in fixtures)
    spare = names[-1]
    soft_name, soft_rgb = _grey(rng) if look.grey else (spare, _shade(rng, PALETTE[spare], 0.03))
    rope, cloth = scene.rope, scene.cloth
    return replace(
        scene,
        bodies=tuple(bodies),
        fixtures=fixtures,
        rope=replace(rope, color=soft_name, rgb=soft_rgb) if rope else None,
        cloth=replace(cloth, color=soft_name, rgb=soft_rgb) if cloth else None,
    )
