"""Ropes over pulleys of ContPhy's kind: loads that move up and down, simulated by MuJoCo's tendons.

x is to the right, z up, and the camera looks along y. Ropes are spatial tendons that wrap round the wheels; wheels
have no inertia. A group is two loads over one or two fixed wheels; a load that hangs from a fixed point over a wheel;
or a movable wheel with a load under it, in a loop between a fixed point and a fixed wheel with another load.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Floats = NDArray[np.float64]

RATE = 30.0  # frames per second
STEP = 1 / 1200  # s
HALF = 0.09  # m, of loads
BELOW = 0.28  # m from a movable wheel's axle to the middle of its load
CEILING = 2.2  # m, height of fixed wheels
MOVES = 0.01  # m in the clip from which a thing counts as moving
COLORS = {
    "red": (0.8, 0.1, 0.1),
    "blue": (0.1, 0.25, 0.9),
    "green": (0.1, 0.6, 0.15),
    "yellow": (0.95, 0.85, 0.1),
    "purple": (0.5, 0.15, 0.7),
    "cyan": (0.1, 0.8, 0.85),
    "orange": (0.95, 0.5, 0.05),
    "pink": (0.95, 0.55, 0.7),
    "brown": (0.45, 0.25, 0.08),
    "gray": (0.4, 0.4, 0.4),
    "white": (1.0, 1.0, 1.0),
    "black": (0.05, 0.05, 0.05),
}


@dataclass(frozen=True)
class Part:
    """What a rope passes. kind: cube, sphere, pulley (fixed), movable (a pulley with a load under it), or fixed point.

    place (x, z) [m]: of a load its middle, of a wheel its axle. load: name of what hangs under a movable wheel.
    """

    kind: str
    color: str
    place: tuple[float, float]
    radius: float = 0.0
    mass: float = 0.0
    load: str = ""

    @property
    def name(self) -> str:
        """Colour and shape, as questions name it."""
        shape = {"movable": "pulley", "fixed": "fixed point"}.get(self.kind, self.kind)
        return f"{self.color} {shape}"


@dataclass(frozen=True)
class Group:
    """A rope and what it passes, from end to end; loads that hang under movable wheels beside it."""

    rope: str
    parts: tuple[Part, ...]
    hung: tuple[Part, ...] = ()

    @property
    def loads(self) -> tuple[Part, ...]:
        """All things with a mass."""
        return tuple(p for p in (*self.parts, *self.hung) if p.kind in ("cube", "sphere"))


@dataclass(frozen=True)
class Run:
    """Heights (T,) [m] by name of what can move; turns [rad, clockwise positive] of each wheel at the last frame."""

    heights: dict[str, Floats]
    turns: dict[str, float]


def draw(rng: Generator) -> list[Group]:
    """Draw one or two groups side by side, at least one of which moves."""
    colors = [str(c) for c in rng.permutation(list(COLORS))]
    count = int(rng.integers(1, 3))
    kinds = [str(rng.choice(["pair", "pair", "movable"]))]
    if count == 2:
        kinds.append(str(rng.choice(["pair", "held", "movable"])))
    lefts = [-0.55] if count == 1 else [-1.25, 0.3]
    return [_group(rng, kind, left, colors) for kind, left in zip(kinds, lefts, strict=True)]


def _group(rng: Generator, kind: str, left: float, colors: list[str]) -> Group:
    radius = float(rng.choice([0.14, 0.18]))
    rope = colors.pop()
    mass = float(rng.uniform(0.3, 1.0))

    def load(x: float, share: float) -> Part:
        height = float(rng.uniform(0.8, 1.3))
        shape = str(rng.choice(["cube", "sphere"]))
        return Part(shape, colors.pop(), (x, height), mass=round(mass * share, 3))

    share = float(rng.choice([1.0, rng.uniform(1.08, 1.35), 1 / rng.uniform(1.08, 1.35)], p=[0.2, 0.4, 0.4]))
    if kind == "held":
        wheel = Part("pulley", colors.pop(), (left + radius, CEILING), radius)
        post = Part("fixed", colors.pop(), (left, CEILING - 0.6))
        return Group(rope, (post, wheel, load(left + 2 * radius, 1.0)))
    if kind == "movable":
        wheel = Part("movable", colors.pop(), (left + radius, 1.35), radius)
        under = Part(str(rng.choice(["cube", "sphere"])), colors.pop(), (left + radius, 1.35 - BELOW), mass=0.0)
        under = replace(under, mass=round(2 * mass * share, 3))
        wheel = replace(wheel, load=under.name)
        post = Part("fixed", colors.pop(), (left, CEILING))
        fixed = Part("pulley", colors.pop(), (left + 3 * radius, CEILING), radius)
        return Group(rope, (post, wheel, fixed, load(left + 4 * radius, 1.0)), (under,))
    wheels = [Part("pulley", colors.pop(), (left + radius, CEILING), radius)]
    if rng.random() < 0.4:
        wheels.append(Part("pulley", colors.pop(), (left + radius + 0.5, CEILING), radius))
    last = wheels[-1].place[0] + radius
    return Group(rope, (load(left, 1.0), *wheels, load(last, share)))


def model_text(groups: list[Group], extra: str = "", view: str = "") -> str:
    """Return the scene's MJCF; `extra` goes before the world, `view` into it (camera, lights, wall)."""
    world, tendons = "", ""
    for n, group in enumerate(groups):
        path = ""
        for k, part in enumerate(group.parts):
            x, z = part.place
            tag = f"{n}_{k}"
            before = group.parts[max(k - 1, 0)]
            if part.kind == "pulley" and before.radius > 0:  # MuJoCo wants a point of the rope between two wheels
                at = (
                    (x - part.radius, z - 0.3)
                    if before.kind == "movable"
                    else ((before.place[0] + x) / 2, z + part.radius)
                )
                world += f'<site name="{tag}_on" pos="{at[0]} 0 {at[1]}" size="0.001"/>'
                path += f'<site site="{tag}_on"/>'
            if part.kind == "fixed":
                world += f'<geom type="sphere" size="0.035" pos="{x} 0 {z}" material="{part.color}" {_FREE}/>'
                world += f'<site name="{tag}" pos="{x} 0 {z}"/>'
                path += f'<site site="{tag}"/>'
                continue
            if part.kind in ("pulley", "movable"):
                wheel = (
                    f'<geom name="{tag}" type="cylinder" size="{part.radius} 0.03" zaxis="0 1 0" mass="1e-6" '
                    f'material="{part.color}" {_FREE}/>'
                )
                below = part.kind == "movable"
                side = f'<site name="{tag}" pos="0 0 {(-1 if below else 1) * (part.radius + 0.05)}"/>'
                if below:
                    (under,) = group.hung
                    hung = f'<body pos="0 0 {-BELOW}">{_solid(under)}</body>'
                    world += f'<body pos="{x} 0 {z}">{_slide(part)}{wheel}{side}{hung}</body>'
                else:
                    world += f'<body pos="{x} 0 {z}">{wheel}{side}</body>'
                path += f'<geom geom="{tag}" sidesite="{tag}"/>'
                continue
            top = f'<site name="{tag}" pos="0 0 {HALF}"/>'
            world += f'<body pos="{x} 0 {z}">{_slide(part)}{_solid(part)}{top}</body>'
            path += f'<site site="{tag}"/>'
        tendons += (
            f'<spatial name="{n}" limited="true" range="0 LENGTH{n}" width="0.012" material="{group.rope}" '
            f'solreflimit="0.004 1" solimplimit="0.99 0.999 0.001">{path}</spatial>'
        )
    return (
        f'<mujoco><option timestep="{STEP}" integrator="implicitfast"/>{extra}<worldbody>{view}{world}</worldbody>'
        f"<tendon>{tendons}</tendon></mujoco>"
    )


_FREE = 'contype="0" conaffinity="0"'
PLAIN = "<asset>" + "".join(f'<material name="{c}"/>' for c in COLORS) + "</asset>"


def _slide(part: Part) -> str:
    return f'<joint name="{part.name}" type="slide" axis="0 0 1"/>'


def _solid(part: Part) -> str:
    size = f'type="box" size="{HALF} {HALF} {HALF}"' if part.kind == "cube" else f'type="sphere" size="{HALF}"'
    return f'<geom {size} mass="{part.mass}" material="{part.color}" {_FREE}/>'


def compiled(groups: list[Group], extra: str = PLAIN, view: str = "") -> mujoco.MjModel:
    """Compile, each rope as long as its way round the wheels at the start."""
    text = model_text(groups, extra, view)
    loose = text
    for n in range(len(groups)):
        loose = loose.replace(f"LENGTH{n}", "100")
    model = mujoco.MjModel.from_xml_string(loose)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for n in range(len(groups)):
        text = text.replace(f"LENGTH{n}", repr(float(data.ten_length[n])))
    return mujoco.MjModel.from_xml_string(text)


def simulate(groups: list[Group], frames: int) -> Run:
    """Let go at frame 0 and simulate."""
    model = compiled(groups)
    data = mujoco.MjData(model)
    names = [model.joint(k).name for k in range(model.njnt)]
    moved = np.zeros((frames, model.nq))
    for frame in range(frames):
        moved[frame] = data.qpos
        for _ in range(round(1 / (RATE * STEP))):
            mujoco.mj_step(model, data)
    start = {p.name: p.place[1] for g in groups for p in (*g.parts, *g.hung)}
    heights = {name: start[name] + moved[:, k] for k, name in enumerate(names)}
    turns: dict[str, float] = {}
    for group in groups:
        for part in group.hung:
            wheel = next(p for p in group.parts if p.load == part.name)
            heights[part.name] = heights[wheel.name] - BELOW
        last = group.parts[-1]
        paid = last.place[1] - heights[last.name][-1]  # rope that ran to the right end [m]
        for part in group.parts:
            if part.kind == "pulley":
                turns[part.name] = float(paid / part.radius)
            elif part.kind == "movable":  # its left strand is held, the right one runs up
                turns[part.name] = float(-paid / 2 / part.radius)
    return Run(heights, turns)


def clip_length(groups: list[Group], longest: int = 45, shortest: int = 12, way: float = 0.3) -> int:
    """Return frames until a thing has moved by `way` [m], within limits."""
    run = simulate(groups, longest)
    far = np.max([np.abs(h - h[0]) for h in run.heights.values()], axis=0)
    return int(np.clip(np.count_nonzero(far < way), shortest, longest))


def changed(groups: list[Group], name: str, factor: float) -> list[Group]:
    """Return the groups with one load's mass multiplied."""

    def other(part: Part) -> Part:
        return replace(part, mass=part.mass * factor) if part.name == name and part.mass else part

    return [replace(g, parts=tuple(map(other, g.parts)), hung=tuple(map(other, g.hung))) for g in groups]
