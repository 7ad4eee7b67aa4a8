"""Simulate a scene: with MuJoCo bodies, fixed things, strings, ropes, cloths; with `water.py` what moves in a tank."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.examination_scenes.solids import Solid, touching
from tests.benchmarks.examination_scenes.water import Tank

Array = NDArray[np.float64]
Edit = dict[str, Any]
GRAVITY = 9.81  # [m/s^2]
STEP, BOUNCE_STEP = 2e-4, 1e-4  # [s] without, with bounces on the floor; half of it must give the same
SAMPLE = 1e-3  # [s] between two stored states
STIFFNESS = 1200.0  # [rad/s] angular frequency of a contact that bounces: it lasts 2.6 ms
CELL = 0.02  # [m] of the water's grid, two particles along it; half of it must give the same
FIRM = "0.004 1"  # solref of contacts and strings that do not bounce: time constant [s], damping ratio


@dataclass(frozen=True)
class Body:
    """Describe a rigid body that moves freely; `half` is (radius,), (radius, half height) or half extents [m]."""

    name: str
    kind: str  # sphere, box or cylinder
    half: tuple[float, ...]
    mass: float
    position: tuple[float, float, float]
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [rad/s], world axes
    yaw: float = 0.0
    lies: bool = False  # a cylinder whose axis is y

    @property
    def shape(self) -> dict[str, Any]:
        """Return the shape as scene.json writes it."""
        if self.kind == "sphere":
            return {"kind": "sphere", "radius": self.half[0]}
        if self.kind == "cylinder":
            return {"kind": "cylinder", "radius": self.half[0], "half_height": self.half[1]}
        return {"kind": "box", "half_extents": list(self.half)}


@dataclass(frozen=True)
class Fixed:
    """Describe a thing that does not move: `slope` turns it about y [rad]; a pulley's axis is y."""

    name: str
    kind: str  # box (wall, ramp), pivot or pulley
    half: tuple[float, ...]
    position: tuple[float, float, float]
    slope: float = 0.0


@dataclass(frozen=True)
class String:
    """Describe a massless string or rod: from a pivot to a body, or from body to body over a pulley."""

    over: str  # pivot or pulley
    bodies: tuple[str, ...]
    length: float  # [m] pivot to body centre, or of the whole string between both tops
    rigid: bool = False


@dataclass(frozen=True)
class Soft:
    """Describe a rope (chain of links with a bead at its end) or a square cloth hung by its upper edge."""

    name: str  # rope or cloth
    top: tuple[float, float, float]
    length: float
    mass: float
    bead: Body | None = None


@dataclass(frozen=True)
class Water:
    """Describe a tank with its inner corner at x = z = 0, as deep along y as its bodies, and its water at first."""

    size: tuple[float, float, float]  # inner length, depth and height [m]
    block: tuple[float, float, float, float]  # x low, z low, x high, z high [m]


@dataclass(frozen=True)
class Scene:
    """Describe all that is simulated; friction is that of the material in a body's name."""

    bodies: tuple[Body, ...]
    fixed: tuple[Fixed, ...] = ()
    strings: tuple[String, ...] = ()
    soft: Soft | None = None
    water: Water | None = None  # without one, but in a tank: a block of no size
    friction: dict[str, float] = field(default_factory=dict)  # against floor and fixed things
    mutual_friction: float = 0.15
    restitution: float = 0.6  # between bodies
    floor_restitution: float = 0.0
    rolling: float = 0.0  # [m] rolling resistance

    @property
    def step(self) -> float:
        """Return the longest time step [s]."""
        return BOUNCE_STEP if self.floor_restitution > 0.0 else STEP

    @property
    def named(self) -> tuple[Body, ...]:
        """Return all bodies that questions may name."""
        return (*self.bodies, *((self.soft.bead,) if self.soft and self.soft.bead else ()))


@dataclass(frozen=True)
class Run:
    """Hold a simulated motion at multiples of SAMPLE."""

    places: dict[str, Array]  # (samples, 3)
    gaps: dict[frozenset[str], Array]  # (samples,) between surfaces [m]
    states: Array  # (samples, nq)
    energy: Array  # (samples,) kinetic and potential [J]
    filled: list[Array] = field(default_factory=list)  # (samples,) of (nx, nz): parts of the rest density of water

    def place(self, name: str, at: float) -> Array:
        """Return a centre at a time [s]."""
        low = min(int(at / SAMPLE), len(self.states) - 2)
        path = self.places[name]
        return np.asarray(path[low] + (at / SAMPLE - low) * (path[low + 1] - path[low]))

    def speed(self, name: str, at: float) -> float:
        """Return a speed at a time [m/s], over 10 ms."""
        return float(np.linalg.norm(self.place(name, at + 0.005) - self.place(name, at - 0.005)) / 0.01)


def edited(scene: Scene, edits: list[Edit]) -> Scene:
    """Return the scene after removals and scalings of initial velocities (spins alike)."""
    for edit in edits:
        name = edit["object"]
        if edit["action"] == "remove":
            if name == "water" and scene.water is not None:
                scene = replace(scene, water=replace(scene.water, block=(0.0, 0.0, 0.0, 0.0)))
            soft = None if scene.soft is not None and scene.soft.name == name else scene.soft
            strings = tuple(s for s in scene.strings if name not in s.bodies)
            scene = replace(scene, bodies=tuple(b for b in scene.bodies if b.name != name), soft=soft, strings=strings)
        else:
            bodies = [moved(b, edit["factor"]) if b.name == name else b for b in scene.bodies]
            scene = replace(scene, bodies=tuple(bodies))
    return scene


def moved(body: Body, factor: float) -> Body:
    """Return the body with its velocity and spin times a factor."""
    velocity, spin = ((x * factor, y * factor, z * factor) for x, y, z in (body.velocity, body.spin))
    return replace(body, velocity=velocity, spin=spin)


def bounce(restitution: float) -> str:
    """Return the solref of a contact that bounces: of a damped oscillator, exp(-pi z / sqrt(1 - z^2)) = restitution."""
    if restitution <= 0.0:
        return FIRM
    log = math.log(restitution)
    damping = -log / math.hypot(math.pi, log)
    return f"{-(STIFFNESS**2)} {-2.0 * damping * STIFFNESS}"


def row(values: Any) -> str:
    """Return numbers as MJCF writes them."""
    return " ".join(repr(float(v)) for v in values)


def contacts(scene: Scene) -> str:
    """Return the contact pairs of a scene."""
    lines = []

    def pair(a: str, b: str, friction: float, restitution: float, rolling: float = 0.0) -> None:
        lines.append(
            f'<pair geom1="{a}" geom2="{b}" condim="{6 if rolling else 3}" solimp=".99 .99 .001" '
            f'solref="{bounce(restitution)}" friction="{friction} {friction} 1e-6 {rolling} {rolling}"/>'
        )

    for body in scene.named:
        grip = next((f for word, f in scene.friction.items() if word in body.name), 0.3)
        for other in ("floor", *(f.name for f in scene.fixed if f.kind == "box")):
            rolling = scene.rolling if body.kind == "sphere" else 0.0
            pair(body.name, other, grip, scene.floor_restitution, rolling)
    for a, b in itertools.combinations(scene.named, 2):
        pair(a.name, b.name, scene.mutual_friction, scene.restitution)
    if scene.soft is not None and scene.soft.name == "rope":
        for body, link in itertools.product(scene.bodies, range(LINKS)):
            pair(body.name, f"link{link}", scene.mutual_friction, 0.0)
    return "".join(lines)


LINKS = 20


def soft_xml(soft: Soft, looks: dict[str, str]) -> str:
    """Return the elements of a rope or a cloth."""
    look = looks.get(soft.name, "")
    if soft.name == "cloth":
        count, spacing = 13, soft.length / 12
        centre = (soft.top[0], soft.top[1], soft.top[2] - soft.length / 2)
        return (
            f'<flexcomp name="cloth" type="grid" dim="2" count="{count} {count} 1" spacing="{row([spacing] * 3)}" '
            f'pos="{row(centre)}" quat=".5 .5 .5 .5" mass="{soft.mass}" radius="0.008" {look}>'
            f'<edge equality="true" damping="0.02"/><pin gridrange="0 {count - 1} {count - 1} {count - 1}"/>'
            f'<contact selfcollide="none" condim="3" friction="0.3 0 0" solref="{FIRM}" contype="2" '
            'conaffinity="2"/></flexcomp>'
        )
    link = soft.length / LINKS
    text, close = "", ""
    for i in range(LINKS):
        at = soft.top if i == 0 else (0.0, 0.0, -link)
        text += f'<body pos="{row(at)}"><joint type="ball" damping="2e-5"/><geom name="link{i}" type="capsule" '
        text += f'size="0.008" fromto="0 0 0 0 0 {-link}" mass="{soft.mass / LINKS}" {look}/>'
        close += "</body>"
    if soft.bead is not None:
        text += f'<body name="{soft.bead.name}" pos="0 0 {-link}">{geom(soft.bead, looks)}</body>'
    return text + close


def geom(body: Body, looks: dict[str, str]) -> str:
    """Return the geom of a body."""
    return (
        f'<geom name="{body.name}" type="{body.kind}" size="{row(body.half)}" mass="{body.mass}" '
        f"{looks.get(body.name, '')}/>"
    )


def xml(scene: Scene, step: float, looks: dict[str, str], setting: str = "", assets: str = "") -> str:
    """Return a scene as MJCF. looks: attributes of geoms; setting: lights and cameras; assets: textures."""
    parts, tendons, equal = [], "", ""
    for fixed in scene.fixed:
        kind = {"box": "box", "pivot": "sphere", "pulley": "cylinder"}[fixed.kind]
        turn = math.degrees(fixed.slope)
        euler = "90 0 0" if fixed.kind == "pulley" else f"0 {turn} 0"
        parts.append(
            f'<geom name="{fixed.name}" type="{kind}" size="{row(fixed.half)}" pos="{row(fixed.position)}" '
            f'euler="{euler}" {looks.get(fixed.name, "")}/><site name="{fixed.name}_site" size="0.001" '
            f'pos="{row((*fixed.position[:2], fixed.position[2] + (0.3 if fixed.kind == "pulley" else 0.0)))}"/>'
        )
    pulleys = {f.name for f in scene.fixed if f.kind == "pulley"}
    tops = {name for s in scene.strings if s.over in pulleys for name in s.bodies}
    for body in scene.bodies:
        half = math.cos(body.yaw / 2), math.sin(body.yaw / 2)
        top = body.half[-1] if body.name in tops else 0.0
        soft = 'contype="2" conaffinity="2"' if scene.soft is not None and scene.soft.name == "cloth" else ""
        parts.append(
            f'<body name="{body.name}" pos="{row(body.position)}" quat="{half[0]} 0 0 {half[1]}"><freejoint/>'
            f'{geom(body, looks).replace("/>", soft + "/>")}<site name="{body.name}_site" pos="0 0 {top}" '
            'size="0.001"/></body>'
        )
    for number, string in enumerate(scene.strings):
        ends = [f'<site site="{b}_site"/>' for b in string.bodies]
        wrap = string.over in pulleys
        middle = f'<geom geom="{string.over}" sidesite="{string.over}_site"/>' if wrap else ""
        start = "" if wrap else f'<site site="{string.over}_site"/>'
        limit = "" if string.rigid else f'limited="true" range="0 {string.length}"'
        tendons += (
            f'<spatial name="string{number}" width="{0.006 if string.rigid else 0.003}" rgba=".15 .13 .12 1" '
            f'solreflimit="{FIRM}" solimplimit=".99 .99 .001" {limit}>{start}{middle.join(ends)}</spatial>'
        )
        if string.rigid:
            equal += f'<tendon tendon1="string{number}" solref="{FIRM}" solimp=".99 .99 .001"/>'
    if scene.soft is not None:
        parts.append(soft_xml(scene.soft, looks))
    return (
        f'<mujoco><option timestep="{step}" gravity="0 0 {-GRAVITY}" cone="elliptic" impratio="20" '
        'integrator="implicitfast"><flag energy="enable"/></option>'
        '<default><geom contype="0" conaffinity="0"/></default>'
        f'{assets}<worldbody>{setting}<geom name="floor" type="plane" size="20 20 1" {looks.get("floor", "")}/>'
        f"{''.join(parts)}</worldbody><contact>{contacts(scene)}</contact><tendon>{tendons}</tendon>"
        f"<equality>{equal}</equality></mujoco>"
    )


def start(scene: Scene, model: mujoco.MjModel) -> mujoco.MjData:
    """Return the initial state of a scene."""
    data = mujoco.MjData(model)
    for body in scene.bodies:
        at = model.jnt_dofadr[model.body(body.name).jntadr[0]]
        turn = np.array([[math.cos(body.yaw), math.sin(body.yaw), 0], [-math.sin(body.yaw), math.cos(body.yaw), 0]])
        data.qvel[at : at + 3] = body.velocity
        data.qvel[at + 3 : at + 6] = *(turn @ body.spin), body.spin[2]
    mujoco.mj_forward(model, data)
    return data


def simulate(scene: Scene, duration: float, part: int = 2) -> Run:
    """Simulate a scene from its first frame on for a duration [s], its time step divided by part."""
    if scene.water is not None:
        return pour(scene, scene.water, duration, part)
    step = scene.step / part
    model = mujoco.MjModel.from_xml_string(xml(scene, step, {}))
    data = start(scene, model)
    names = [b.name for b in scene.named]
    pairs = list(itertools.combinations(names, 2))
    many, count = round(SAMPLE / step), int(duration / SAMPLE) + 12
    ids = {n: model.body(n).id for n in names}
    geoms = {n: model.geom(n).id for n in names}
    places, gaps, states, energy = [], [], [], []
    for _ in range(count):
        places.append([data.xpos[ids[n]].copy() for n in names])
        gaps.append([mujoco.mj_geomDistance(model, data, geoms[a], geoms[b], 2.0, None) for a, b in pairs])
        states.append(data.qpos.copy())
        energy.append(float(data.energy.sum()))
        mujoco.mj_step(model, data, many)
        mujoco.mj_forward(model, data)
    path, gap = np.array(places), np.array(gaps).reshape(count, len(pairs))
    return Run(
        {n: path[:, i] for i, n in enumerate(names)},
        {frozenset(p): gap[:, i] for i, p in enumerate(pairs)},
        np.array(states),
        np.array(energy),
    )


def pour(scene: Scene, water: Water, duration: float, part: int) -> Run:
    """Simulate bodies and water in a tank, cells and time step divided by part."""
    cell = CELL / part
    solids = []
    for body in scene.bodies:
        half = body.half[:1] if body.kind == "cylinder" else body.half[::2]
        motion = np.array([body.velocity[0], body.velocity[2], -body.spin[1]])
        place = np.array(body.position)[[0, 2]]
        friction = scene.friction[body.name.split("_")[1]]
        solids.append(Solid(half, body.mass / water.size[1], place, motion, friction))
    tank = Tank(water.size[::2], cell, (water.block,), solids, scene.restitution)
    step, pairs = cell / 5, list(itertools.combinations(range(len(solids)), 2))
    states, gaps, energy, filled = [], [], [], []
    for _ in range(int(duration / step) + 12):
        states.append([[*s.place, s.angle] for s in solids])
        gaps.append([touching(solids[i], solids[j])[0] for i, j in pairs])
        energy.append(tank.energy * water.size[1])
        filled.append(tank.filled.astype(np.float32))
        tank.step(step)
    count = int(duration / SAMPLE) + 12
    low, rest = np.divmod(np.arange(count) * SAMPLE / step, 1.0)
    low = low.astype(int)

    def sampled(values: Array) -> Array:
        share = rest.reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray((1 - share) * values[low] + share * values[low + 1])

    state, gap = sampled(np.array(states)), sampled(np.array(gaps).reshape(len(states), -1))
    zero = np.zeros(count)
    turns = [
        np.stack([np.cos(a / 2), zero, -np.sin(a / 2), zero], axis=-1)
        if body.kind == "box"
        else np.stack([np.cos(a / 2), np.cos(a / 2), -np.sin(a / 2), np.sin(a / 2)], axis=-1) * math.sqrt(0.5)
        for body, a in zip(scene.bodies, state[..., 2].T, strict=True)
    ]
    places = {
        b.name: np.stack([s[:, 0], zero, s[:, 1]], axis=-1)
        for b, s in zip(scene.bodies, state.swapaxes(0, 1), strict=True)
    }
    poses = [x for b, turn in zip(scene.bodies, turns, strict=True) for x in (places[b.name], turn)]
    return Run(
        places,
        {frozenset(scene.bodies[k].name for k in pair): gap[:, i] for i, pair in enumerate(pairs)},
        np.concatenate(poses, axis=1),
        sampled(np.array(energy)),
        [filled[i] for i in low],
    )
