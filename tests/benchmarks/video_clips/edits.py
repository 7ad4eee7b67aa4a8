"""Draw changes that a user might ask about and apply them to a scene."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.random import Generator

from .bodies import Body, Fixture, Scene, vec
from .physics import Run

WANTED = 10


@dataclass(frozen=True)
class Edit:
    """A change of the scene at the time of the first frame. factor: number that the operation takes."""

    op: str
    body: str
    factor: float
    text: str

    def record(self) -> dict[str, Any]:
        """Return the edit as a dictionary."""
        return asdict(self)


def _change(scene: Scene, name: str, change: Callable[[Body], Body]) -> Scene:
    return replace(scene, bodies=tuple(change(b) if b.name == name else b for b in scene.bodies))


def _scaled(body: Body, factor: float) -> Body:
    return replace(
        body,
        vel=vec(factor * v for v in body.vel),
        spin=vec(factor * w for w in body.spin),
        rate=factor * body.rate,
    )


def _turned(body: Body, degrees: float, upright: bool) -> Body:
    a = np.radians(degrees)
    c, s = float(np.cos(a)), float(np.sin(a))
    if upright:
        x, z = body.vel[0], body.vel[2]
        return replace(body, vel=(c * x - s * z, body.vel[1], s * x + c * z))
    (x, y, z), (p, q, r) = body.vel, body.spin
    return replace(body, vel=(c * x - s * y, s * x + c * y, z), spin=(c * p - s * q, s * p + c * q, r))


def apply(scene: Scene, edit: Edit) -> Scene:
    """Return the changed scene."""
    f = edit.factor
    if edit.op == "remove":
        return replace(scene, bodies=tuple(b for b in scene.bodies if b.name != edit.body))
    if edit.op == "speed":
        return _change(scene, edit.body, lambda b: _scaled(b, f))
    if edit.op == "turn":
        return _change(scene, edit.body, lambda b: _turned(b, f, scene.kind in ("tossed", "bouncing")))
    if edit.op == "mass" and edit.body not in ("rope", "cloth"):
        return _change(scene, edit.body, lambda b: replace(b, mass=f * b.mass))
    if edit.op == "shift":
        return _change(scene, edit.body, lambda b: replace(b, pos=(b.pos[0] + f, b.pos[1], b.pos[2])))
    if edit.op == "raise":
        return _change(scene, edit.body, lambda b: replace(b, pos=(b.pos[0], b.pos[1], b.pos[2] + f)))
    if edit.op == "restitution":
        return _change(scene, edit.body, lambda b: replace(b, restitution=f * b.restitution))
    if edit.op == "damping":
        return replace(
            scene,
            bodies=tuple(replace(b, damping=f * b.damping, resistance=f * b.resistance) for b in scene.bodies),
            rope=replace(scene.rope, damping=f * scene.rope.damping) if scene.rope else None,
        )
    if edit.op == "friction":
        return replace(
            scene, bodies=tuple(replace(b, friction=f * b.friction, rolling=f * b.rolling) for b in scene.bodies)
        )
    if edit.op == "mutual restitution":
        return replace(scene, mutual_restitution=f * scene.mutual_restitution)
    if edit.op == "gravity":
        return replace(scene, gravity=f * scene.gravity)
    if edit.op == "angle":
        if scene.rope:
            return replace(scene, rope=replace(scene.rope, angle=f * scene.rope.angle))
        if scene.cloth:
            return replace(scene, cloth=replace(scene.cloth, angle=f * scene.cloth.angle))
        return _change(scene, edit.body, lambda b: replace(b, angle=f * b.angle))
    if edit.op == "mass" and scene.rope and edit.body == "rope":
        return replace(scene, rope=replace(scene.rope, mass=f * scene.rope.mass))
    if edit.op == "mass" and scene.cloth:
        return replace(scene, cloth=replace(scene.cloth, mass=f * scene.cloth.mass))
    if edit.op == "wind" and scene.cloth:
        wind = vec(f * w for w in scene.cloth.wind)
        return replace(scene, cloth=replace(scene.cloth, wind=wind))
    raise ValueError(f"unknown edit {edit.op}")


def _candidates(rng: Generator, scene: Scene) -> list[Edit]:
    """List edits that make sense for the scene."""
    out: list[Edit] = []
    kind = scene.kind

    def number(*values: float) -> float:
        return float(rng.choice(values))

    for b in scene.bodies:
        n, moves = b.name, bool(np.linalg.norm(b.vel) > 0 or b.rate != 0)
        if len(scene.bodies) > 1 or b.joint == "rope":
            out.append(Edit("remove", n, 0.0, f"remove body {n}"))
            f = number(0.5, 2.0, 3.0)
            out.append(Edit("mass", n, f, f"body {n} is {f:g} times as heavy"))
        if moves:
            for f in rng.choice([0.5, 0.7, 0.8, 1.2, 1.4], 2, replace=False):
                out.append(Edit("speed", n, float(f), f"body {n} starts with its velocity (and spin) times {f:g}"))
            if kind in ("floor", "entering", "billiard", "tossed"):
                d = number(-20, -10, 10, 20)
                about = "in the vertical plane of x and z, from x towards z" if kind == "tossed" else "about the z axis"
                out.append(Edit("turn", n, d, f"body {n} starts with its velocity turned by {d:g} degrees {about}"))
        if kind in ("tossed", "bouncing"):
            f, h = number(0.6, 0.8, 1.1), number(0.1, 0.2, 0.3)
            out.append(Edit("restitution", n, f, f"body {n} keeps {f:g} times as much of its speed in a bounce"))
            if b.pos[2] > b.size[2]:
                out.append(Edit("raise", n, h, f"body {n} starts {h:g} m higher"))
        if kind in ("ramp", "cart") and b.joint in ("free", "track") and (n != "A" or kind == "cart"):
            d = number(-0.06, 0.06, 0.1)
            out.append(Edit("shift", n, d, f"body {n} starts {d:g} m further along x"))
        if b.joint == "arm":
            for f in (0.6, 0.8, 1.2):
                out.append(Edit("angle", n, f, f"body {n} starts at {f:g} times the angle from the vertical"))
    if any(b.joint == "free" for b in scene.bodies):
        for f in (0.5, 2.0):
            word = "doubled" if f > 1 else "halved"
            text = f"friction (and rolling resistance) of floor and fixtures is {word}"
            out.append(Edit("friction", "", f, text))
    if len(scene.bodies) > 1:
        f = number(0.5, 0.7)
        out.append(Edit("mutual restitution", "", f, f"bodies that meet keep {f:g} times as much speed of separation"))
    if kind in ("tossed", "bouncing", "ramp", "pendulum", "rope", "cloth"):
        for f in (0.5, 0.8, 1.25):
            out.append(Edit("gravity", "", f, f"gravity is {f:g} times as strong"))
    if kind in ("cart", "pendulum", "rope"):
        out.extend(
            Edit("damping", "", f, f"resistance at the joints is {f:g} times as strong") for f in (0.5, 2.0, 4.0)
        )
    if kind in ("rope", "cloth"):
        out.extend(
            Edit("angle", kind, f, f"the {kind} starts at {f:g} times the angle from the vertical") for f in (0.5, 0.8)
        )
        f = number(0.5, 2.0)
        out.append(Edit("mass", kind, f, f"the {kind} is {f:g} times as heavy"))
    if scene.cloth and np.linalg.norm(scene.cloth.wind) > 0:
        out.extend(Edit("wind", "", f, f"the wind is {f:g} times as fast") for f in (0.0, 0.5, 1.5))
    return out


def _overlaps(scene: Scene, before: Scene) -> bool:
    """Return whether an edit pushes a body into another one or a stop."""
    for i, a in enumerate(scene.bodies):
        others: list[Body | Fixture] = [*scene.bodies[:i], *scene.bodies[i + 1 :]]
        old = next(b for b in before.bodies if b.name == a.name)
        if a.pos == old.pos:
            continue
        others.extend(f for f in scene.fixtures if f.name.startswith("stop"))
        for o in others:
            if abs(a.pos[0] - o.pos[0]) < (a.size[0] + o.size[0]) / 2 + 0.01:
                return True
        if scene.kind == "ramp" and a.pos[0] - a.size[0] / 2 < 0.02:
            return True
    return False


def draw_edits(rng: Generator, scene: Scene, run: Run, wanted: int = WANTED) -> list[Edit]:
    """Draw up to the wanted number of different edits; a cloth gets at most four since it is slow."""
    options = [e for e in _candidates(rng, scene) if not _overlaps(apply(scene, e), scene)]
    acting = {n for a, b, *_ in run.touches for n in (a, b)} | {b.name for b in scene.bodies if b.rate or any(b.vel)}
    weights = np.array([1.0 if not e.body or e.body in acting else 0.3 for e in options])
    count = min(4 if scene.cloth else wanted, len(options))
    picked = rng.choice(len(options), count, replace=False, p=weights / weights.sum())
    return [options[int(k)] for k in picked]
