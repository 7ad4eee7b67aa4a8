"""Say what a user would know about a clip."""

from typing import Any

import numpy as np
from numpy.random import Generator

from .bodies import Body, Fixture
from .clip import Clip
from .render import Film


def _size(thing: Body | Fixture) -> dict[str, Any]:
    if thing.shape == "sphere":
        return {"diameter": round(thing.size[0], 3)}
    if thing.shape == "cylinder":
        return {"diameter": round(thing.size[0], 3), "length": round(thing.size[2], 3)}
    return {"size": [round(float(c), 3) for c in thing.size]}


def pointed_at(rng: Generator, film: Film, name: str) -> dict[str, Any] | None:
    """Return a pixel on the body, as clicked in the first frame that shows most of it."""
    own = film.labels == film.names.index(name) + 1
    area = own.sum(axis=(1, 2))
    if area.max() == 0:
        return None
    frame = int(np.argmax(area >= 0.7 * area.max()))
    rows, columns = np.nonzero(own[frame])
    spread = 0.2 * np.sqrt(area[frame] / np.pi)
    aim = np.array([columns.mean(), rows.mean()]) + rng.normal(0, spread, 2)
    k = int(np.argmin((columns - aim[0]) ** 2 + (rows - aim[1]) ** 2))
    return {"frame": frame, "pixel": [int(columns[k]), int(rows[k])]}


def _moving(clip: Clip, film: Film, rng: Generator) -> list[dict[str, Any]]:
    bodies = clip.scene.bodies
    looks = [(b.shape, b.color) for b in bodies]
    out = []
    for b in bodies:
        entry: dict[str, Any] = {"name": b.name, "shape": b.shape, **_size(b), "color": b.color}
        if b.joint == "track":
            entry["guided"] = "a cart that can only move along the track (x); size is that of its box without wheels"
        if b.joint == "arm":
            entry["guided"] = "hangs on a thin rod from a pivot and swings in the plane y = 0"
            entry["pivot"] = [round(c, 3) for c in b.pivot]
        if b.joint == "rope":
            entry["guided"] = "fixed to the end of the rope"
        if looks.count((b.shape, b.color)) > 1:
            entry["pointed_at"] = pointed_at(rng, film, b.name)
        out.append(entry)
    return out


def _still(clip: Clip) -> list[dict[str, Any]]:
    out = []
    for f in clip.scene.fixtures:
        entry = {"name": f.name, "shape": f.shape, **_size(f), "color": f.color, "fixed": True}
        entry["position"] = [round(float(c), 3) for c in f.pos]
        if f.quat != (1.0, 0.0, 0.0, 0.0):
            entry["rotation_wxyz"] = [round(c, 4) for c in f.quat]
        out.append(entry)
    return out


def known(clip: Clip, film: Film, rng: Generator) -> dict[str, Any]:
    """Return what known.json holds: things, sizes, measured points, time and axes; nothing hidden."""
    scene, look = clip.scene, clip.look
    things = _moving(clip, film, rng)
    if scene.rope:
        r = scene.rope
        things.append(
            {
                "name": "rope",
                "shape": "rope",
                "length": round(r.length, 3),
                "diameter": round(r.diameter, 3),
                "color": r.color,
                "anchor": [round(c, 3) for c in r.anchor],
            }
        )
    if scene.cloth:
        c = scene.cloth
        things.append(
            {
                "name": "cloth",
                "shape": "cloth",
                "size": [round(c.width, 3), round(c.height, 3)],
                "color": c.color,
                "held": "at the upper corners" if c.corners else "along the upper edge",
                "upper_edge_middle": [round(x, 3) for x in c.top],
            }
        )
    return {
        "video": f"clip.{look.container}",
        "seconds_per_frame": 1.0 / look.fps,
        "frame_size": list(look.size),
        "units": "metres, seconds, pixels; the centre of the top-left pixel is (0, 0), v points down",
        "world_axes": "x and y along the floor, z up; the floor is z = 0",
        "gravity_direction": [0.0, 0.0, -1.0],
        "objects": [*things, *_still(clip)],
        "camera_points": {
            "frame": 0,
            "drawn": look.marks,
            "points": clip.points,
        },
        "camera_moves": "held by hand" if look.shake > 0 else "stands still",
    }
