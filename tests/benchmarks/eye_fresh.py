"""Drawn clips unlike those that the eye was made on: `python -m tests.benchmarks.eye_fresh [--seed S] [--size W H]`.

OpenCV draws bodies on textured ground with shading, soft shadows, noise, and JPEG coding: a throw seen from the side, a
pendulum, a cart with a bumper, a body that stands for half the clip, grey on grey, and three balls that collide. Each
body is given by one outline that is a pixel off; errors of centres [px]; wrong: farther off than half a radius with a
confidence above 0.8.
--speed COUNT: frames of the three balls at the size alone.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import cv2
import numpy as np

from atw_mcp.perception.eye.bodies import Body
from atw_mcp.perception.eye.observe import observe
from atw_mcp.perception.eye.seeds import Seed, outline_body
from tests.benchmarks.eye import draw

Shape = tuple[np.ndarray, np.ndarray, tuple[float, float, float]]  # places (T, 2), outline (V, 2), BGR colour
FINE = 4  # subpixels of a drawn edge
ROUND = np.stack([np.cos(np.arange(48) * np.pi / 24), np.sin(np.arange(48) * np.pi / 24)], axis=1)


def film(shapes: list[Shape], ground: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Frames (T, H, W, 3) of shaded bodies with soft shadows below right of them, noise and coding."""
    height, width = ground.shape[:2]
    frames = []
    for k in range(len(shapes[0][0])):
        picture = ground.copy()
        for places, outline, _ in shapes:
            size = float(np.ptp(outline, axis=0).max())
            shadow = np.zeros((height, width), np.uint8)
            _fill(shadow, outline * [1.0, 0.7] + places[k] + 0.3 * size)
            dark = cv2.GaussianBlur(shadow.astype(np.float32) / 255, (0, 0), 0.12 * size)
            picture *= 1 - 0.45 * dark[..., None]
        for places, outline, colour in shapes:
            share = np.zeros((height, width), np.uint8)
            _fill(share, outline + places[k])
            v, u = np.mgrid[0:height, 0:width].astype(np.float32)
            size = float(np.ptp(outline, axis=0).max())
            light = np.clip(1.0 - 0.5 * ((u - places[k, 0]) + (v - places[k, 1])) / size, 0.45, 1.4)
            own = share[..., None].astype(np.float32) / 255
            picture = picture * (1 - own) + np.array(colour, np.float32) * light[..., None] * own
        picture = cv2.GaussianBlur(picture, (0, 0), 0.6) + random.normal(0, 2.0, picture.shape)
        coded = cv2.imencode(".jpg", np.clip(picture, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 80])[1]
        frames.append(cv2.imdecode(coded, cv2.IMREAD_COLOR))
    return np.stack(frames)


def _fill(mask: np.ndarray, outline: np.ndarray) -> None:
    low = np.floor(outline.min(axis=0)).astype(int) - 2
    size = np.ceil(outline.max(axis=0)).astype(int) + 3 - low
    fine = np.zeros((size[1] * FINE, size[0] * FINE), np.uint8)
    cv2.fillPoly(fine, [np.round(((outline - low + 0.5) * FINE - 0.5) * 16).astype(np.int32)], 255, shift=4)
    part = cv2.resize(fine, (int(size[0]), int(size[1])), interpolation=cv2.INTER_AREA)
    a, b = np.maximum(low, 0), np.minimum(low + size, mask.shape[::-1])
    if (b > a).all():
        mask[a[1] : b[1], a[0] : b[0]] = part[a[1] - low[1] : b[1] - low[1], a[0] - low[0] : b[0] - low[0]]


def ground(width: int, height: int, texture: float, random: np.random.Generator) -> np.ndarray:
    """A lit ground with coarse and fine texture."""
    picture = np.full((height, width, 3), random.uniform(90, 170), np.float32) + random.uniform(-12, 12, 3)
    for scale in (2.0, 12.0):
        picture += texture * scale * cv2.GaussianBlur(random.normal(0, 1, (height, width)), (0, 0), scale)[..., None]
    return np.asarray(picture * np.linspace(1.1, 0.85, width, dtype=np.float32)[None, :, None], dtype=np.float32)


def clips(width: int, height: int, random: np.random.Generator) -> dict[str, tuple[list[Shape], np.ndarray]]:
    """Shapes and ground of each kind of clip."""
    t, unit = np.arange(40.0), np.array([width, height], float)
    r = 0.028 * width
    disc, box = ROUND * r, np.array([(-1.6, -0.8), (1.6, -0.8), (1.6, 0.8), (-1.6, 0.8)]) * r
    throw = np.c_[0.06 + 0.022 * t, 0.75 - 0.055 * t + 0.0014 * t**2] * unit
    angle = 0.9 * np.cos(0.17 * t)
    swing = np.c_[0.5 + 0.34 * np.sin(angle) * height / width * 1.2, 0.1 + 0.55 * np.cos(angle)] * unit
    along = 0.15 + 0.028 * t - 2 * np.maximum(0.15 + 0.028 * t - 0.85, 0)
    stand = np.c_[0.3 + 0.025 * np.maximum(t - 20, 0), np.full(40, 0.6)] * unit
    grey = np.c_[0.2 + 0.015 * t, 0.4 + 0.004 * t] * unit
    colours = [(40, 50, 200), (190, 90, 30), (40, 180, 210), (60, 150, 60)]
    return {
        "throw": ([(throw, disc, colours[2])], ground(width, height, 1.0, random)),
        "pendulum": ([(swing, disc, colours[0])], ground(width, height, 1.5, random)),
        "cart": ([(np.c_[along, np.full(40, 0.55)] * unit, box, colours[1])], ground(width, height, 1.0, random)),
        "stands": ([(stand, disc, colours[3])], ground(width, height, 1.5, random)),
        "grey": ([(grey, disc, (105, 105, 105))], ground(width, height, 0.2, random)),
        "balls": (balls(width, height, 40), ground(width, height, 1.0, random)),
    }


def balls(width: int, height: int, count: int) -> list[Shape]:
    """Two balls that hit a third one and rebound."""
    t, unit, disc = np.linspace(0, 40, count), np.array([width, height], float), ROUND * 0.028 * width
    one = np.c_[0.1 + 0.02 * np.minimum(t, 18), np.full(count, 0.5)]
    hit = np.c_[0.515 + 0.014 * np.maximum(t - 18, 0), 0.5 + 0.004 * np.maximum(t - 18, 0)]
    third = np.c_[0.9 - 0.01 * t, 0.2 + 0.004 * t]
    return [(p * unit, disc, c) for p, c in ((one, (40, 50, 200)), (hit, (190, 90, 30)), (third, (40, 180, 210)))]


def judge(name: str, shapes: list[Shape], frames: np.ndarray, random: np.random.Generator, sheet: Path | None) -> None:
    """Print figures of one clip."""
    seeds = []
    for i, (places, outline, _) in enumerate(shapes):
        inside = ((places > 0) & (places < frames.shape[2:0:-1])).all(axis=1)
        k = int(random.choice(np.flatnonzero(inside)))
        seeds.append(Seed.outlined(f"body{i}", k, outline + places[k] + random.normal(0, 0.7, 2)))
    began = time.process_time()
    bodies: list[Body] = [outline_body(s.object, s) for s in seeds]
    tracks, _ = observe(frames, bodies, seeds)
    seconds = time.process_time() - began
    errors, wrong, lost = [], 0, 0
    for (places, outline, _), track in zip(shapes, tracks, strict=True):
        reach = np.ptp(outline, axis=0) / 2
        shown = ((places > reach) & (places < np.array(frames.shape[2:0:-1]) - reach)).all(axis=1)
        error = np.linalg.norm(track.centres - places, axis=1)[shown]
        errors.append(error[np.isfinite(error)])
        lost += int(np.isnan(error).sum())
        wrong += int((np.nan_to_num(error) > 0.5 * track.body.radius(np.zeros(4)))[track.confidence[shown] > 0.8].sum())
    every = np.concatenate(errors)
    text = (
        f"{np.median(every):.2f} / {np.percentile(every, 90):.2f} / {every.max():.2f} px" if len(every) else "nowhere"
    )
    print(f"{name:<9} {text}  lost {lost}  wrong {wrong}  {seconds:.1f} s")
    if sheet:
        draw(sheet / f"{name}.png", tracks, frames)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--size", type=int, nargs=2, default=(480, 320))
    parser.add_argument("--speed", type=int)
    parser.add_argument("--pictures", type=Path)
    asked = parser.parse_args()
    random = np.random.default_rng(asked.seed)
    width, height = asked.size
    if asked.speed:
        shapes = balls(width, height, asked.speed)
        judge("speed", shapes, film(shapes, ground(width, height, 1.0, random), random), random, asked.pictures)
        return
    for name, (shapes, under) in clips(width, height, random).items():
        judge(name, shapes, film(shapes, under, random), random, asked.pictures)


if __name__ == "__main__":
    main()
