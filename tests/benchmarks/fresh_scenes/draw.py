"""Families of scenes, drawn by seed, and the checks that a scene passes."""

import math
import zlib
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from .engines import ENGINES, RULES, Array, Body, World

SHAPES = ("sphere", "box", "cylinder")
KINDS = {"floor": SHAPES, "ramp": SHAPES, "rolling": SHAPES[:1], "throws": ("sphere", "sphere", "box")}
FAMILIES = [f"{kind}_{engine}" for kind in KINDS for engine in ENGINES if kind == "floor" or engine != "planar"]
DENSITY = {"rubber": 120.0, "metal": 300.0, "wood": 60.0}  # of hollow bodies, kg/m³
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Scene:
    family: str
    seed: int
    world: World
    rate: int  # frames a second
    frames: int  # of the clip; the motion goes on for 2 s
    poses: Array  # frame, body, xyz and wxyz
    contacts: list[tuple[float, str, str]]  # beginnings of touching, some later
    sensitive: tuple[str, ...]


def _body(rng: np.random.Generator, i: int, kind: str, material: str) -> Body:
    s, h = rng.uniform(0.1, 0.3), rng.uniform(0.6, 1.1)
    size = {"sphere": (s,), "box": (s, s, s), "cylinder": (s, s * h)}[kind]
    mass = {"sphere": 4 / 3 * math.pi, "box": 8.0, "cylinder": 2 * math.pi * h}[kind] * s**3 * DENSITY[material]
    drag = {"sphere": 0.47 * math.pi, "box": 1.05 * 6, "cylinder": 0.9 * math.pi * (0.5 + h)}[kind] * s * s
    turned = Rotation.from_rotvec(UP * rng.uniform(0, math.pi)).as_quat(scalar_first=True)
    return Body(f"{material}_{kind}_{i}", material, kind, size, mass, UP * size[-1], 0 * UP, 0 * UP, turned, UP, drag)


def _level(rng: np.random.Generator, bodies: list[Body], spin: Array, thrown: bool) -> list[Body]:
    """Bodies on a ring, moving inwards; half of the level scenes have a target at rest."""
    turn, rest = rng.uniform(0, 2 * math.pi), rng.random() < 0.5 and not thrown
    for i, b in enumerate(bodies):
        angle = turn + (i + rng.uniform(-0.25, 0.25)) * 2 * math.pi / len(bodies)
        start = rng.uniform(1.0, 2.4) * np.array([math.cos(angle), math.sin(angle), 0.0])
        way = rng.uniform(-0.4, 0.4, 3) * (1 - UP) - start
        v = rng.uniform(2.0, 6.0) * way / np.linalg.norm(way)
        start, v = (0.2 * start, 0 * v) if i == 0 and rest else (start, v)
        if thrown:
            start, v = start + UP * rng.uniform(0.5, 1.8), 0.7 * v + UP * rng.uniform(-1, 3.5)
        turning = spin * rng.uniform(-5, 5, 3) * v.any()
        bodies[i] = replace(b, position=start + b.position, velocity=v, spin=turning, support=UP * (not thrown))
    return bodies


def _downhill(rng: np.random.Generator, bodies: list[Body], material: str) -> tuple[list[Body], Body]:
    """A ramp whose upper face meets the floor at the origin; bodies on it, and one or two at its foot."""
    yaw, half = Rotation.from_rotvec(UP * rng.uniform(0, 2 * math.pi)), np.array([rng.uniform(1.2, 2), 1.5, 0.1])
    tilt = yaw * Rotation.from_euler("y", rng.uniform(10, 25), degrees=True)
    for i, b in enumerate(bodies):
        low, y = i < len(bodies) // 2, rng.uniform(-0.5, 0.5)
        slope, along = (yaw, rng.uniform(0.8, 2.2)) if low else (tilt, -rng.uniform(0.45, 2 * half[0] - 0.3))
        v, normal = (not low) * slope.apply([rng.uniform(0.5, 3.0), -0.5 * y, 0.0]), slope.apply(UP)
        spin = np.cross(normal, v) / b.size[0] * (b.kind == "sphere")
        turned = (slope * Rotation.from_quat(b.orientation, scalar_first=True)).as_quat(scalar_first=True)
        place = slope.apply([along, y, b.size[-1]])
        bodies[i] = replace(b, position=place, velocity=v, spin=spin, support=normal, orientation=turned)
    place, turned = -tilt.apply(half * [1, 0, 1]), tilt.as_quat(scalar_first=True)
    return bodies, Body("ramp", material, "box", tuple(half.tolist()), 0, place, orientation=turned)


def _world(rng: np.random.Generator, kind: str, engine: str) -> World:
    names = [str(m) for m in rng.permutation(list(DENSITY))[:2]]
    surfaces = {m: (rng.uniform(0.15, 0.6), rng.uniform(0.4, 0.95)) for m in names}
    surfaces["floor"] = (rng.uniform(0.3, 0.9), rng.uniform(0.6, 0.95))
    friction, restitution = rng.choice(list(RULES), 2).tolist() if engine != "bullet" else ("product", "product")
    kinds = SHAPES[1:] if engine == "planar" else KINDS[kind]
    number = int(rng.integers(3, 7 if kind == "floor" else 6))
    bodies, ramp = [_body(rng, i, str(rng.choice(kinds)), names[rng.integers(2)]) for i in range(number)], None
    if kind == "ramp":
        bodies, ramp = _downhill(rng, bodies, str(rng.choice([*names, "floor"])))
    else:
        bodies = _level(rng, bodies, UP if kind == "floor" else np.ones(3), kind == "throws")
    dense = kind == "throws" or (engine == "planar" and rng.random() < 0.5)
    medium, linear = dense * rng.uniform(1.2, 8.0), (engine == "planar" and not dense) * rng.uniform(5.0, 40.0)
    return World(tuple(bodies), surfaces, (friction, restitution), ramp, linear, medium, rng.uniform(5e-4, 4e-3))


def _clip(rng: np.random.Generator, poses: Array, hits: list[float], rate: int) -> int:
    """Frames of a clip that ends about the first hit; 0 where the motion will not do."""
    frames = int(np.clip(round((min(hits, default=9.0) + rng.uniform(-0.1, 0.3)) * rate) + 1, 12, 40))
    end, path = (frames - 1) / rate, np.linalg.norm(np.diff(poses[..., :3], axis=0), axis=2)
    moved, moves = path[: frames - 1].sum(0) > 0.3, path[frames - 1 : frames - 1 + rate].sum(0) > 0.3
    lively = np.mean(moved) >= 0.5 and moves.any() and any(0 < t - end < 1 for t in hits) and hits[0] > end - 0.35
    return frames if lively and np.abs(poses).max() < 30 and poses[..., 2].min() > 0.04 else 0


def _nudged(rng: np.random.Generator, b: Body) -> Body:
    """Start moved by 1 mm and 1 cm/s, along what the body stands on."""
    way = rng.normal(size=(2, 3))
    way -= np.outer(way @ b.support, b.support)
    way *= np.array([[1e-3], [1e-2]]) / np.linalg.norm(way, axis=1, keepdims=True)
    return replace(b, position=b.position + way[0], velocity=b.velocity + way[1])


def scenes(family: str, seed: int) -> Scene:
    """Draw until a scene passes: lively, sound, and no more than half of its bodies sensitive."""
    kind, engine = family.split("_")
    for attempt in range(300):
        rng = np.random.default_rng([zlib.crc32(family.encode()), seed, attempt])
        world, rate = _world(rng, kind, engine), int(rng.choice([24, 30, 48, 50, 60]))
        poses, contacts, depth = ENGINES[engine](world, rate, 40 + 2 * rate)
        calm = "ramp" if kind in ("ramp", "throws") else "floor"  # whose touch is no hit
        hits = [t for t, *who in contacts if t > 0.05 and calm not in who]
        early = any(t < 0.05 and not {"floor", "ramp"} & {*who} for t, *who in contacts)  # overlap at the start
        if early or depth > 0.04 or not (n := _clip(rng, poses, hits, rate)):
            continue
        others = [replace(world, bodies=tuple(_nudged(rng, b) for b in world.bodies)) for _ in range(2)]
        again = [ENGINES[engine](w, rate, n + rate) for w in others]
        again.append(ENGINES[engine](world, rate, n + rate, 2.5e-4))  # steps as well may decide what happens
        off = np.array([other[-1, :, :3] - poses[n + rate - 1, :, :3] for other, *_ in again])
        wild = tuple(world.bodies[i].name for i in np.flatnonzero(np.linalg.norm(off, axis=2).max(axis=0) > 0.25))
        if len(wild) <= len(world.bodies) / 2:
            return Scene(family, seed, world, rate, n, poses[: n + 2 * rate], contacts, wild)
    raise RuntimeError(f"no scene of {family} for seed {seed}")
