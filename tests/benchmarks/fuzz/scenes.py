"""Random worlds of all materials, each the function of a seed alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from polyworld.effects import CATALOGUE

Parts = dict[str, Any]
G = 9.81
SIDE = {"motion_plane": {"normal": [0.0, -1.0, 0.0], "supports": False}, "gravity": [0.0, 0.0, -G]}
FLOOR = {"name": "floor", "shape": {"kind": "plane"}}


@dataclass(frozen=True)
class Fuzz:
    """A world as described, not yet checked. overlaps: whether things may start inside each other."""

    parts: Parts
    horizon: float
    overlaps: bool = False
    overrides: bool = False
    edits: tuple[Parts, ...] = ()


class Draw:
    """Random numbers of one world, by what they are for."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def between(self, low: float, high: float) -> float:
        """Uniformly."""
        return float(self.rng.uniform(low, high))

    def scale(self, low: float, high: float) -> float:
        """Uniformly in the logarithm."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def whole(self, low: int, high: int) -> int:
        """A whole number, both ends included."""
        return int(self.rng.integers(low, high + 1))

    def chance(self, share: float) -> bool:
        """True with this probability."""
        return bool(self.rng.random() < share)

    def one_of(self, *choices: Any) -> Any:
        """One of some."""
        return choices[int(self.rng.integers(len(choices)))]

    def vector(self, size: float) -> list[float]:
        """A vector with normal components."""
        return [float(x) for x in self.rng.normal(0.0, size, 3)]

    def turn(self) -> list[float]:
        """A unit quaternion."""
        q = self.rng.normal(size=4)
        return [float(x) for x in q / np.linalg.norm(q)]


def shape(d: Draw, size: float, *, compound: bool = False) -> Parts:
    """A convex or compound body about as large as a ball of radius `size` [m]."""
    kind = d.one_of("sphere", "box", "cylinder", "capsule", "convex_mesh", *(["compound"] if compound else []))
    if kind == "sphere":
        return {"kind": kind, "radius": size}
    if kind == "box":
        return {"kind": kind, "half_extents": [size * d.between(0.4, 1.0) for _ in range(3)]}
    if kind in ("cylinder", "capsule"):
        return {"kind": kind, "radius": size * d.between(0.3, 0.8), "half_height": size * d.between(0.2, 0.7)}
    if kind == "convex_mesh":
        points = d.rng.normal(size=(d.whole(4, 12), 3))
        points *= size / np.linalg.norm(points, axis=1, keepdims=True)
        return {"kind": kind, "vertices": points.tolist()}
    ends = [{"shape": {"kind": "sphere", "radius": 0.3 * size}, "position": [s * 0.7 * size, 0, 0]} for s in (-1, 1)]
    rod = {"shape": {"kind": "box", "half_extents": [0.4 * size, 0.15 * size, 0.15 * size]}}
    return {"kind": "compound", "parts": [*ends, rod]}


def surface(d: Draw) -> Parts:
    """Contact coefficients of a rigid body."""
    return {
        "friction": d.one_of(0.0, d.between(0.0, 1.0), 2.0),
        "restitution": d.one_of(0.0, d.between(0.0, 1.0), 0.9, 1.0),
        "rolling_resistance": d.one_of(0.0, 0.0, d.scale(1e-5, 1e-2)),
        "density": d.scale(50.0, 8000.0),
    }


def grid(d: Draw, count: int, spacing: float, *, planar: bool, tight: bool = False) -> list[list[float]]:
    """Places (count, 3) a spacing apart, from the floor up; in a plane: of x and y.

    tight: exactly so; else each is off by up to a tenth of it.
    """
    side = max(1, int(np.ceil(count ** (1 / 2 if planar else 1 / 3))))
    places = []
    for k in range(count):
        i, j, layer = k % side, (k // side) % side, k // (side * side)
        shift = [0.0, 0.0, 0.0] if tight else [0.1 * spacing * float(x) for x in d.rng.uniform(-1, 1, 3)]
        up = 0.0 if planar else (layer + 0.7) * spacing
        places.append([i * spacing + shift[0], j * spacing + shift[1], up + (0.0 if planar else abs(shift[2]))])
    return places


def planar_rigid(d: Draw) -> Fuzz:
    """Bodies that slide and hit each other on a table, some with walls and hinges."""
    count, size = d.whole(2, 9), d.scale(0.02, 0.3)
    speed = d.scale(0.1, 10.0)
    objects = [
        {
            "name": f"b{k}",
            "representation": "rigid_planar",
            "shape": shape(d, size * d.between(0.5, 1.0)),
            "position": place,
            "velocity": [speed * float(x) for x in d.rng.normal(size=2)] + [0.0],
            "angular_velocity": [0, 0, d.between(-10, 10)],
            "start_time": 0.0 if d.chance(0.9) else d.between(0.05, 0.3),
            **surface(d),
        }
        for k, place in enumerate(grid(d, count, 2.3 * size, planar=True))
    ]
    wide = 2.3 * size * (np.sqrt(count) + 1)
    walls = [
        {"name": f"w{k}", "shape": {"kind": "wall", "start": a, "end": b, "thickness": 0.2 * size}}
        for k, (a, b) in enumerate(_square(-2 * size, wide))
    ]
    joints = []
    if d.chance(0.3):
        free = [o["name"] for o in objects if o["start_time"] == 0.0]
        if len(free) > 1:
            other = d.one_of(None, free[1])
            at = next(o for o in objects if o["name"] == free[0])["position"]
            joints.append({"name": "pin", "kind": "hinge", "object": free[0], "other": other, "anchor": at})
    return Fuzz({"objects": objects, "statics": walls if d.chance(0.8) else [], "joints": joints}, d.between(0.3, 1.0))


def _square(low: float, high: float) -> list[tuple[list[float], list[float]]]:
    corners = [[low, low, 0.0], [high, low, 0.0], [high, high, 0.0], [low, high, 0.0]]
    return [(corners[k], corners[(k + 1) % 4]) for k in range(4)]


def spatial_rigid(d: Draw) -> Fuzz:
    """Bodies that fall and fly above a floor, a ramp or a mesh."""
    count, size = d.whole(1, 8), d.scale(0.02, 0.3)
    objects = [
        _falling(d, f"b{k}", size * d.between(0.5, 1.0), place, speed=d.scale(0.1, 5.0))
        for k, place in enumerate(grid(d, count, 2.4 * size, planar=False))
    ]
    return Fuzz({"objects": objects, "statics": _ground(d, size)}, d.between(0.3, 1.0))


def _falling(d: Draw, name: str, size: float, place: list[float], *, speed: float, **more: Any) -> Parts:
    return {
        "name": name,
        "shape": shape(d, size, compound=True),
        "position": place,
        "orientation": d.turn(),
        "velocity": d.vector(speed),
        "angular_velocity": d.vector(5.0),
        **surface(d),
        **more,
    }


def _ground(d: Draw, size: float) -> list[Parts]:
    choice = d.whole(0, 3)
    if choice == 0:
        slope = d.between(0.0, 0.5)
        return [{"name": "ramp", "shape": {"kind": "plane", "normal": [float(np.sin(slope)), 0, float(np.cos(slope))]}}]
    if choice == 1:
        n, wide = 6, 12 * size
        axis = np.linspace(-wide, wide, n)
        height = d.rng.uniform(-0.3 * size, 0.0, (n, n))
        vertices = [[float(x), float(y), float(height[i, j])] for i, x in enumerate(axis) for j, y in enumerate(axis)]
        faces = []
        for i in range(n - 1):
            for j in range(n - 1):
                a, b, c, e = i * n + j, (i + 1) * n + j, (i + 1) * n + j + 1, i * n + j + 1
                faces += [[a, b, c], [a, c, e]]
        return [{"name": "ground", "shape": {"kind": "triangle_mesh", "vertices": vertices, "faces": faces}}]
    if choice == 2:
        post = {"name": "post", "shape": shape(d, size), "position": [size, size, 0.0]}
        return [FLOOR, post]
    return [FLOOR]


def piles(d: Draw) -> Fuzz:
    """Many equal bodies close together, some with nearly elastic contacts."""
    planar = d.chance(0.4)
    count, size = d.whole(10, 36), 0.05
    e = d.one_of(0.0, 0.5, 0.9, 1.0)
    form = d.one_of({"kind": "sphere", "radius": size}, {"kind": "box", "half_extents": [size] * 3})
    places = grid(d, count, 2.3 * size, planar=planar, tight=d.chance(0.5))
    lean = d.one_of(0.0, 0.3 * size)  # of every layer against the one below
    objects = []
    for k, (x, y, z) in enumerate(places):
        up = y + 1.1 * size if planar else z
        at = [x + lean * round(up / (2.3 * size)), 0.0 if planar else y, up]
        body = {"name": f"b{k}", "shape": form, "position": at, "restitution": e, "friction": d.one_of(0.0, 0.5)}
        objects.append(body | {"representation": "rigid_planar" if planar else "rigid_spatial"})
    parts: Parts = {"objects": objects, "statics": [FLOOR]}
    if planar:
        parts["environment"] = SIDE
    return Fuzz(parts, 0.5)


def jointed(d: Draw) -> Fuzz:
    """Chains and trees of joints with motors, stops, springs and friction."""
    count, size = d.whole(2, 7), d.scale(0.03, 0.3)
    objects, joints = [], []
    for k in range(count):
        at = [k * 2.5 * size, 0.0, 3.0 * size * count]
        objects.append(_falling(d, f"b{k}", size, at, speed=d.one_of(0.0, 0.0, 1.0)))
        below = None if k == 0 else f"b{d.whole(0, k - 1)}" if d.chance(0.3) else f"b{k - 1}"
        if k == 0 and d.chance(0.3):
            continue
        kind = d.one_of("hinge", "hinge", "slider", "ball", "fixed", "spring")
        joint: Parts = {"name": f"j{k}", "kind": kind, "object": f"b{k}", "other": below}
        joint["anchor"] = [at[0] - 1.25 * size, 0.0, at[2]]
        if kind in ("hinge", "slider"):
            joint["axis"] = d.one_of([0, 1, 0], [0, 0, 1], [1, 0, 0], d.vector(1.0))
            joint["damping"] = d.one_of(0.0, d.scale(1e-4, 1.0))
            joint["friction"] = d.one_of(0.0, d.scale(1e-3, 1.0))
            if d.chance(0.3):
                joint |= {"lower": -d.scale(0.01, 1.0), "upper": d.scale(0.01, 1.0)}
            if d.chance(0.3):
                target = d.one_of(None, d.between(-20, 20))
                joint["motor"] = {"target_speed": target, "limit": d.scale(0.01, 10.0), "start": d.one_of(0.0, 0.1)}
        elif kind == "spring":
            other = [0.0, 0.0, at[2] + size] if below is None else [at[0] - 2.5 * size, 0.0, at[2]]
            joint |= {"other_anchor": other, "stiffness": d.scale(1.0, 1e5), "damping": d.one_of(0.0, 1.0)}
        joints.append(joint)
    return Fuzz({"objects": objects, "joints": joints, "statics": [FLOOR]}, d.between(0.3, 1.0))


def with_effects(d: Draw) -> Fuzz:
    """A rigid world with some laws of the catalogue."""
    base = d.one_of(planar_rigid, spatial_rigid)(d)
    effects = []
    for k in range(d.whole(1, 3)):
        kind = d.one_of(*CATALOGUE)
        law = CATALOGUE[kind]
        values = {p: d.between(*spec.search) for p, spec in law.parameters.items()}
        effects.append({"name": f"e{k}", "kind": kind, "parameters": values})
    if d.chance(0.2):
        effects.append(
            {"name": "law", "kind": "expression", "expression": "-k*speed*v", "parameters": {"k": d.scale(0.01, 2.0)}}
            | {"parameter_units": {"k": "1/m"}, "parameter_bounds": {"k": [0.0, 10.0]}}
        )
    return Fuzz(base.parts | {"effects": effects}, base.horizon)


def extremes(d: Draw) -> Fuzz:
    """Rigid bodies of far apart masses, sizes and speeds."""
    base = d.one_of(planar_rigid, spatial_rigid, piles)(d)
    way = d.whole(0, 4)
    objects = [dict(o) for o in base.parts["objects"]]
    horizon = base.horizon
    if way == 0:
        for body in objects:
            body["mass"] = d.scale(1e-6, 1e6)
    elif way == 1:  # everything a thousand times smaller or larger
        factor = d.one_of(1e-3, 1e3)
        return Fuzz(_scaled(base.parts, factor), 0.3 * float(np.sqrt(factor)) if factor < 1 else 1.0)
    elif way == 2:
        for body in objects:
            body["velocity"] = [float(x) * d.scale(10.0, 1000.0) for x in body.get("velocity", [0, 0, 0])]
        horizon = 0.2
    elif way == 3:
        for body in objects:
            spin = d.scale(10.0, 1000.0)
            body["angular_velocity"] = [0, 0, spin] if body.get("representation") == "rigid_planar" else d.vector(spin)
        horizon = 0.2
    else:
        base.parts["time"] = {"substep": d.one_of(2e-4, 0.01, 0.02)}
    return Fuzz(base.parts | {"objects": objects}, horizon)


def _scaled(value: Any, factor: float) -> Any:
    """A description with all lengths times `factor`, its velocities with the root, so that it moves alike."""
    if isinstance(value, list):
        return [_scaled(v, factor) for v in value]
    if not isinstance(value, dict):
        return value
    out = {}
    lengths = {"position", "radius", "half_extents", "half_height", "vertices", "start", "end", "thickness"}
    lengths |= {"rolling_resistance", "anchor"}
    for key, item in value.items():
        if key in lengths:
            out[key] = (factor * np.asarray(item)).tolist()
        elif key in ("velocity", "angular_velocity"):
            power = 0.5 if key == "velocity" else -0.5
            out[key] = (factor**power * np.asarray(item)).tolist()
        elif key == "start_time":
            out[key] = item * factor**0.5
        else:
            out[key] = _scaled(item, factor)
    return out


def overlapping(d: Draw) -> Fuzz:
    """Bodies that start inside each other, the floor or a wall."""
    base = d.one_of(planar_rigid, spatial_rigid, piles)(d)
    objects = [dict(o) for o in base.parts["objects"]]
    shrink = d.between(0.3, 0.95)
    for body in objects:
        body["position"] = [shrink * x for x in body["position"]]
    return Fuzz(base.parts | {"objects": objects, "joints": []}, base.horizon, overlaps=True)


def ropes(d: Draw) -> Fuzz:
    """Ropes, rods and strings that hang, swing or fall."""
    planar = d.chance(0.25)
    count = d.whole(1, 2)
    items, held = [], []
    for k in range(count):
        rope = _rope(d, f"r{k}", [0.0, 0.0 if planar else 0.3 * k, 1.0], planar=planar)
        items.append(rope)
        for end in ("start", "end"):
            if d.chance(0.5):
                fastening = {"name": f"{end}{k}", "object": f"r{k}", "end": end, "clamped": d.chance(0.3)}
                fastening |= {"release": 0.1} if d.chance(0.1) else {}
                held.append(fastening)
    statics = [FLOOR] if d.chance(0.7) else []
    if d.chance(0.3):
        shape_of = {"kind": "cylinder", "radius": 0.05, "half_height": 0.5}
        peg = {"name": "peg", "shape": shape_of, "position": [0.3, 0, 0.6]}
        statics.append(peg | {"orientation": [0.7071067811865476, 0.7071067811865476, 0, 0]})
    parts: Parts = {"deformables": items, "attachments": held, "statics": statics}
    if planar:
        parts["environment"] = SIDE
    return Fuzz(parts, d.between(0.1, 0.3), overlaps=planar and count > 1)  # in a plane they cross


def _rope(d: Draw, name: str, at: list[float], *, planar: bool = False, stiff: float = 1e-2) -> Parts:
    length, bends = d.between(0.3, 1.2), d.whole(1, 3)
    step = d.rng.normal(size=(bends, 3)) * [1.0, 0.0 if planar else 0.4, 0.4]
    step = step / np.linalg.norm(step, axis=1, keepdims=True) * length / bends
    points = np.concatenate([[at], np.asarray(at) + np.cumsum(step, axis=0)])
    return {
        "name": name,
        "representation": "rope_planar" if planar else "rope",
        "points": points.tolist(),
        "segments": d.whole(2, 24),
        "radius": d.scale(0.002, 0.01),
        "length": length * d.one_of(1.0, 1.0, 1.3, 0.99) if d.chance(0.5) else None,
        "linear_density": d.scale(0.005, 1.0),
        "stretch_stiffness": d.scale(10.0, 1e6),
        "bending_stiffness": d.one_of(0.0, d.scale(1e-6, stiff)),
        "twist_stiffness": 0.0 if planar else d.one_of(0.0, d.scale(1e-6, stiff)),
        "curved_at_rest": d.chance(0.2),
        "stretch_damping": d.one_of(0.0, 0.005),
        "bending_damping": d.one_of(0.0, 0.01),
        "velocity": [d.between(-1, 1), 0.0, d.between(-1, 1)],
    }


def pulleys(d: Draw) -> Fuzz:
    """Loads on ropes over one to three wheels, placed by eye."""
    wheels = d.whole(1, 3)
    spacing, radius = d.between(0.25, 0.6), d.between(0.04, 0.11)
    points, made = [[-spacing, 0.0, d.between(0.4, 0.8)]], []
    for k in range(wheels):
        up = k % 2 == 0
        centre = [k * spacing, 0.0, 1.5 if up else d.between(0.6, 1.2)]
        wheel = {"name": f"p{k}", "rope": "cable", "centre": centre, "radius": d.one_of(radius, radius, 0.0)}
        wheel |= {"after": k, "turns_positive": up if d.chance(0.9) else not up, "inertia": d.one_of(0.0, 1e-3)}
        wheel |= {"bearing_friction": d.one_of(0.0, 0.05), "fixed_wheel": d.chance(0.2), "friction": 0.2}
        made.append(wheel)
        last = k + 1 == wheels
        points.append([(k + (1 if last else 0.5)) * spacing, 0.0, d.between(0.4, 0.8) if last else d.between(0.9, 1.3)])
    rope = _rope(d, "cable", [0, 0, 0], stiff=1e-3) | {"points": points, "velocity": [0, 0, 0], "length": None}
    rope |= {"segments": d.whole(10, 41), "twist_stiffness": 0.0, "curved_at_rest": False}
    objects, held = [], []
    for end, point in (("start", points[0]), ("end", points[-1])):
        if d.chance(0.8):
            body = {"name": f"load_{end}", "shape": {"kind": "sphere", "radius": 0.08}, "mass": d.scale(0.05, 5.0)}
            objects.append(body | {"position": [point[0], 0.0, point[2] - 0.08]})
            held.append({"name": end, "object": "cable", "end": end, "to": f"load_{end}"})
        else:
            held.append({"name": end, "object": "cable", "end": end})
    parts = {"objects": objects, "deformables": [rope], "pulleys": made, "attachments": held, "statics": [FLOOR]}
    return Fuzz(parts, d.between(0.1, 0.2))


def tied(d: Draw) -> Fuzz:
    """Rigid bodies on ropes, away from their centres, some jointed to the world."""
    objects, items, held, joints = [], [], [], []
    for k in range(d.whole(1, 2)):
        x = 0.8 * k
        long = d.one_of(0.1, 0.1, 0.5)
        form = {"kind": "box", "half_extents": [long, 0.08, 0.08]}
        body = {"name": f"b{k}", "shape": form, "position": [x, 0.0, 0.9], "density": d.scale(20.0, 5000.0)}
        objects.append(body)
        rope = _rope(d, f"r{k}", [0, 0, 0]) | {"points": [[x, 0.0, 1.8], [x + 0.9 * long, 0.0, 0.98]]}
        items.append(rope | {"curved_at_rest": False, "length": None})
        held.append({"name": f"top{k}", "object": f"r{k}", "end": "start"})
        held.append({"name": f"tie{k}", "object": f"r{k}", "end": "end", "to": f"b{k}", "clamped": d.chance(0.2)})
        if d.chance(0.4):
            joint = {"name": f"j{k}", "object": f"b{k}", "anchor": [x - 0.9 * long, 0.0, 0.9]}
            joints.append(joint | {"kind": d.one_of("hinge", "ball", "fixed", "hinge"), "axis": [0, 1, 0]})
            if joints[-1]["kind"] in ("ball", "fixed"):
                del joints[-1]["axis"]
    parts = {"objects": objects, "deformables": items, "attachments": held, "joints": joints, "statics": [FLOOR]}
    return Fuzz(parts, d.between(0.1, 0.3))


def cloths(d: Draw) -> Fuzz:
    """A sheet that falls, hangs or catches a ball."""
    n, m = d.whole(2, 9), d.whole(2, 9)
    sheet = {
        "name": "sheet",
        "representation": "cloth",
        "geometry": {
            "kind": "sheet",
            "corner": [-0.3, -0.3, 0.5],
            "edge_u": [0.6, 0, 0],
            "edge_v": [0.0, 0.6, d.one_of(0.0, 0.3)],
            "divisions": [n, m],
        },
        "areal_density": d.scale(0.05, 1.0),
        "stretch_stiffness": d.scale(20.0, 5000.0),
        "bending_stiffness": d.one_of(0.0, d.scale(1e-6, 1e-3)),
        "poisson_ratio": d.between(0.0, 0.45),
        "stretch_damping": d.one_of(0.0, 0.01),
        "self_contact": d.chance(0.7),
        "thickness": d.scale(0.001, 0.01),
    }
    held = []
    for k, x in enumerate((-0.3, 0.3)):
        if d.chance(0.7):
            box = {"lower": [x - 0.01, -0.31, 0.4], "upper": [x + 0.01, -0.29, 0.9]}
            held.append({"name": f"corner{k}", "object": "sheet", "region": box})
    ball = {"name": "ball", "shape": shape(d, 0.1), "position": [0.02, 0.03, 0.9], "density": d.scale(50.0, 3000.0)}
    ball["velocity"] = [0, 0, -d.scale(0.1, 5.0)]
    parts: Parts = {"deformables": [sheet], "attachments": held, "statics": [FLOOR]}
    if d.chance(0.7):
        parts["objects"] = [ball]
    if d.chance(0.3):
        parts["environment"] = {"wind": d.vector(3.0)}
    return Fuzz(parts, d.between(0.1, 0.3))


def softs(d: Draw) -> Fuzz:
    """Soft bodies that fall on each other, on bodies and on the floor."""
    planar = d.chance(0.3)
    items = []
    for k in range(d.whole(1, 2)):
        form = d.one_of(
            {"kind": "sphere", "radius": 0.1},
            {"kind": "box", "half_extents": [0.1, 0.08, 0.06]},
            {"kind": "cylinder", "radius": 0.08, "half_height": 0.06},
        )
        body = {"name": f"s{k}", "representation": "soft_planar" if planar else "soft", "shape": form}
        body |= {"position": [0.03 * k, 0.0, 0.15 + 0.3 * k], "resolution": d.between(0.06, 0.12)}
        body |= {"youngs_modulus": d.scale(1e3, 1e6), "poisson_ratio": d.between(0.0, 0.49), "density": 700.0}
        body |= {"damping": d.one_of(0.0, 0.01), "yield_stress": d.one_of(None, None, d.scale(1e2, 1e4))}
        body |= {"velocity": [0.0, 0.0, -d.scale(0.01, 4.0)], "restitution": d.one_of(0.0, 0.5)}
        items.append(body)
    parts: Parts = {"deformables": items, "statics": [FLOOR]}
    if planar:
        parts["environment"] = SIDE
    if d.chance(0.4):
        kind = "rigid_planar" if planar else "rigid_spatial"
        ball = {"name": "ball", "representation": kind, "shape": shape(d, 0.08), "position": [0, 0, 0.9]}
        parts["objects"] = [ball | {"density": d.scale(50.0, 5000.0), "velocity": [0, 0, -1.0]}]
    return Fuzz(parts, d.between(0.1, 0.25))


def fluids(d: Draw) -> Fuzz:
    """Liquids in a box, with bodies, taps and drains."""
    planar = d.chance(0.6)
    cell = d.between(0.04, 0.06) if planar else d.between(0.07, 0.1)
    deep = d.between(0.1, 0.3)
    pool = {"shape": {"kind": "box", "half_extents": [0.2, 0.3, deep / 2]}, "position": [-0.1, 0, deep / 2]}
    water = {"name": "water", "representation": "fluid_planar" if planar else "fluid", "volumes": [pool]}
    water |= {"viscosity": d.one_of(0.001, d.scale(0.01, 10.0)), "surface_tension": d.one_of(0.0, 0.0, 0.07)}
    parts: Parts = {
        "deformables": [water],
        "fluid_grid": {"lower": [-0.3, -0.3, 0.0], "upper": [0.3, 0.3, 0.7], "cell": cell, "closed": d.chance(0.8)},
        "statics": [FLOOR],
    }
    if planar:
        parts["environment"] = SIDE
    if d.chance(0.6):
        ball = {"name": "ball", "shape": shape(d, d.between(0.05, 0.12)), "position": [0, 0, 0.5]}
        ball["representation"] = "rigid_planar" if planar else "rigid_spatial"
        parts["objects"] = [ball | {"density": d.scale(20.0, 5000.0), "velocity": [0, 0, -d.scale(0.1, 5.0)]}]
    if d.chance(0.3):
        tap = {"name": "tap", "fluid": "water", "position": [0.1, 0, 0.6], "radius": 0.05}
        parts["emitters"] = [tap | {"rate": d.scale(1e-3, 5e-2) if planar else d.scale(1e-4, 5e-3)}]
    if d.chance(0.2):
        parts["drains"] = [{"name": "drain", "lower": [-0.3, -0.3, 0], "upper": [-0.1, 0.3, 0.05]}]
    return Fuzz(parts, d.between(0.1, 0.25))


def mixes(d: Draw) -> Fuzz:
    """Two kinds of deformable objects together."""
    pairs = ((ropes, softs), (cloths, softs), (fluids, softs), (fluids, ropes), (cloths, ropes), (fluids, cloths))
    first, second = d.one_of(*pairs)
    a, b = first(d), second(d)
    while any("planar" in str(x["representation"]) for f in (a, b) for x in f.parts["deformables"]):
        a, b = first(d), second(d)
    parts = dict(a.parts)
    for name, value in b.parts.items():
        if name in ("deformables", "attachments"):
            parts[name] = [*parts.get(name, []), *value]
        else:
            parts.setdefault(name, value)
    return Fuzz(parts, 0.1, overlaps=True)


def batches(d: Draw) -> Fuzz:
    """A world of any kind, in variants that differ in some parameters."""
    base = d.one_of(planar_rigid, spatial_rigid, piles, jointed, with_effects, ropes, tied, cloths, softs, fluids)(d)
    return Fuzz(base.parts, min(base.horizon, 0.4), overlaps=base.overlaps, overrides=True)


def edited(d: Draw) -> Fuzz:
    """A world of any kind after some interventions."""
    base = d.one_of(planar_rigid, spatial_rigid, piles, jointed, ropes, tied, cloths, softs, fluids)(d)
    names = [o["name"] for o in (*base.parts.get("objects", []), *base.parts.get("deformables", []))]
    edits: list[Parts] = []
    for _ in range(d.whole(1, 3)):
        name = d.one_of(*names)
        edits.append(
            d.one_of(
                {"action": "remove", "object": name},
                {"action": "move", "object": name, "shift": d.vector(0.1)},
                {"action": "move", "object": name, "turn": d.vector(0.5)},
                {"action": "set_velocity", "object": name, "velocity": d.vector(2.0)},
                {"action": "scale_velocity", "object": name, "factor": d.between(-2, 2)},
                {"action": "scale_parameter", "path": f"objects.{name}.friction", "factor": d.between(0, 2)},
                {"action": "environment", "gravity_factor": d.between(-1.0, 3.0)},
            )
        )
    return Fuzz(base.parts, base.horizon, overlaps=True, edits=tuple(edits))


KINDS: dict[str, Callable[[Draw], Fuzz]] = {
    f.__name__: f
    for f in (
        planar_rigid,
        spatial_rigid,
        piles,
        jointed,
        with_effects,
        extremes,
        overlapping,
        ropes,
        pulleys,
        tied,
        cloths,
        softs,
        fluids,
        mixes,
        batches,
        edited,
    )
}


def fuzz(seed: int) -> tuple[str, Fuzz]:
    """Return the kind of a seed's world and the world."""
    kind = list(KINDS)[seed % len(KINDS)]
    return kind, KINDS[kind](Draw(seed))
