"""A forearm with a hand that lets go of a body at the start of a clip and withdraws; it has no part in the physics."""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from tests.benchmarks.video_clips.bodies import Array, Body
from tests.benchmarks.video_clips.clip import Clip

from .optics import quaternion
from .solids import Faces, Solid, capsule, sphere

FLESH = 0.075  # m from the origin (between the finger tips) back to the palm


@dataclass(frozen=True)
class Withdrawal:
    """Where the hand is. times: in frames; poses: (n, 7), x of its axes toward the body that it let go of."""

    times: Array
    poses: Array


def _moved(solid: Solid, start: Array, end: Array) -> Solid:
    """Turn a solid along z so that it lies between two points."""
    way = (end - start) / np.linalg.norm(end - start)
    side = np.cross(way, [0.0, 1.0, 0.0] if abs(way[1]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    turn = np.column_stack([side, np.cross(way, side), way])
    return Solid(solid.vertices @ turn.T + (start + end) / 2, solid.faces)


def joined(solids: list[Solid]) -> Solid:
    """Return the solids as one mesh."""
    vertices, faces, count = [], Faces(), 0
    for s in solids:
        vertices.append(s.vertices)
        faces.extend(tuple(i + count for i in f) for f in s.faces)
        count += len(s.vertices)
    return Solid(np.vstack(vertices), faces)


def _bone(a: tuple[float, float, float], b: tuple[float, float, float], diameter: float) -> Solid:
    start, end = np.array(a), np.array(b)
    return _moved(capsule(diameter, float(np.linalg.norm(end - start))), start, end)


def hand_solid() -> Solid:
    """Return palm, fingers, thumb and wrist as overlapping solids; the finger tips end near the origin."""
    parts = []
    for k, (y, length) in enumerate(((-0.030, 0.9), (-0.010, 1.0), (0.010, 0.95), (0.030, 0.8))):
        knuckle = (-FLESH, y, 0.02)
        middle = (-FLESH + 0.045 * length, 1.1 * y, 0.018 + 0.002 * k)
        tip = (-FLESH + 0.074 * length, 1.05 * y, -0.006)
        parts.extend([_bone(knuckle, middle, 0.019), _bone(middle, tip, 0.017)])
    parts.extend([_bone((-0.135, -0.025, 0.0), (-0.09, -0.058, -0.01), 0.024)])
    parts.append(_bone((-0.09, -0.058, -0.01), (-0.05, -0.055, -0.015), 0.019))
    palm = sphere(1.0)
    parts.append(Solid(palm.vertices * np.array([0.105, 0.088, 0.034]) + np.array([-0.115, 0.0, 0.012]), palm.faces))
    parts.append(_bone((-0.15, 0.0, 0.01), (-0.30, 0.0, 0.03), 0.055))
    return joined(parts)


def sleeve_solid() -> Solid:
    """Return the sleeve around the forearm."""
    return joined([_bone((-0.25, 0.0, 0.025), (-0.60, 0.0, 0.06), 0.085), _bone((-0.6, 0, 0.06), (-1.1, 0, 0.2), 0.11)])


def _pushed(clip: Clip) -> tuple[Body, Array] | None:
    """Return the fastest body seen at the start and its horizontal direction."""
    best: tuple[Body, Array] | None = None
    fastest = 0.25
    for body in clip.scene.bodies:
        way = np.array([body.vel[0], body.vel[1], 0.0])
        speed = float(np.linalg.norm(way))
        seen = clip.cameras[0].inside(np.array([body.pos]), 0.0)[0]
        if body.joint in ("free", "track") and seen and speed > fastest:
            best, fastest = (body, way / speed), speed
    return best


def withdrawal(rng: Generator, clip: Clip) -> Withdrawal | None:
    """Return the hand's motion: behind the body when the clip starts, then back and up; None if nothing is pushed."""
    pushed = _pushed(clip)
    if pushed is None:
        return None
    body, way = pushed
    reach = body.size[0] / 2 if body.shape != "box" else max(body.size[:2]) / 2
    start = np.array(body.pos) - (reach + 0.012) * way
    start[2] = max(start[2], 0.03) + 0.01
    tilt = float(rng.uniform(0.35, 0.7))
    x = np.cos(tilt) * way - np.sin(tilt) * np.array([0.0, 0.0, 1.0])
    y = np.cross([0.0, 0.0, 1.0], way)
    turn = quaternion(np.column_stack([x, y, np.cross(x, y)]))
    rise = -way * float(rng.uniform(0.5, 1.0)) + np.array([0.0, 0.0, float(rng.uniform(0.3, 0.8))])
    speed, ease, rate = float(rng.uniform(0.5, 1.3)), 0.25, clip.look.fps
    times = np.arange(-1.0, clip.look.frames + 1.0)
    t = np.maximum(times, 0.0) / rate
    gone = speed * np.where(t < ease, t**2 / (2 * ease), t - ease / 2)
    poses = np.column_stack([start + np.outer(gone, rise), np.tile(turn, (len(times), 1))])
    return Withdrawal(times, poses)
