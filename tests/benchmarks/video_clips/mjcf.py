"""Write a scene as a simulator model (MJCF)."""

from itertools import combinations

import mujoco
import numpy as np

from .bodies import DT, Body, Cloth, Fixture, Rope, Scene
from .contact import solref
from .looks import Look

VISUAL_ONLY = 'contype="0" conaffinity="0"'


def _n(*values: float) -> str:
    return " ".join(f"{v:.7g}" for v in values)


def shape_text(thing: Body | Fixture) -> str:
    """Return the type and size attributes of a geom."""
    x, y, z = thing.size
    if thing.shape == "sphere":
        return f'type="sphere" size="{_n(x / 2)}"'
    if thing.shape == "cylinder":
        return f'type="cylinder" size="{_n(x / 2, z / 2)}"'
    return f'type="box" size="{_n(x / 2, y / 2, z / 2)}"'


def _body(body: Body) -> str:
    paint = f'rgba="{_n(*body.rgb, 1)}" material="paint"'
    geom = f'<geom name="{body.name}" {shape_text(body)} mass="{_n(body.mass)}" {paint} {VISUAL_ONLY}'
    if body.joint == "track":
        across, down = body.size[1] / 2 + 0.005, -0.45 * body.size[2]
        wheels = "".join(
            f'<geom type="cylinder" size="{_n(0.3 * body.size[2], 0.01)}" zaxis="0 1 0" mass="0" rgba=".1 .1 .1 1" '
            f'{VISUAL_ONLY} pos="{_n(sx * 0.32 * body.size[0], sy * across, down)}"/>'
            for sx in (-1, 1)
            for sy in (-1, 1)
        )
        loss = body.resistance * body.mass * 9.81
        return (
            f'<body pos="{_n(*body.pos)}"><joint type="slide" axis="1 0 0" damping="{_n(body.damping)}" '
            f'frictionloss="{_n(loss)}"/>{geom}/>{wheels}</body>'
        )
    if body.joint == "arm":
        length = body.pivot[2] - body.pos[2]
        return (
            f'<body pos="{_n(*body.pivot)}"><joint type="hinge" axis="0 -1 0" damping="{_n(body.damping)}"/>'
            f'<geom type="capsule" fromto="0 0 0 0 0 {_n(-length)}" size="0.006" mass="{_n(0.02)}" '
            f'rgba=".25 .25 .25 1" {VISUAL_ONLY}/>{geom} pos="0 0 {_n(-length)}"/></body>'
        )
    return f'<body pos="{_n(*body.pos)}" quat="{_n(*body.quat)}"><freejoint/>{geom}/></body>'


def _rope(rope: Rope, weight: Body | None) -> str:
    link = rope.length / rope.links
    text = ""
    for k in reversed(range(rope.links)):
        if k == rope.links - 1 and weight is not None:
            text = (
                f'<geom name="{weight.name}" {shape_text(weight)} mass="{_n(weight.mass)}" material="paint" '
                f'rgba="{_n(*weight.rgb, 1)}" pos="0 0 {_n(-link - weight.size[2] / 2)}" {VISUAL_ONLY}/>'
            )
        start = f'pos="{_n(*rope.anchor)}" quat="{_n(np.cos(rope.angle / 2), 0, -np.sin(rope.angle / 2), 0)}"'
        place = start if k == 0 else f'pos="0 0 {_n(-link)}"'
        text = (
            f'<body {place}><joint type="ball" damping="{_n(rope.damping)}"/>'
            f'<geom name="rope_{k}" type="capsule" fromto="0 0 0 0 0 {_n(-link)}" size="{_n(rope.diameter / 2)}" '
            f'mass="{_n(rope.mass / rope.links)}" rgba="{_n(*rope.rgb, 1)}" {VISUAL_ONLY}/>{text}</body>'
        )
    return text


def _cloth(cloth: Cloth) -> str:
    nx, nz = cloth.cells
    held = [i * nz + nz - 1 for i in range(nx)]
    held = [held[0], held[-1]] if cloth.corners else held
    # The sheet is made in its own x-y plane with y upward, centred; tilt it about x, held edge in place.
    tilt = np.pi / 2 + cloth.angle
    down = np.array([0.0, -np.cos(tilt), -np.sin(tilt)]) * cloth.height / 2
    return (
        f'<flexcomp name="cloth" type="grid" dim="2" count="{nx} {nz} 1" '
        f'spacing="{_n(cloth.width / (nx - 1), cloth.height / (nz - 1), 0.05)}" mass="{_n(cloth.mass)}" radius="0.003" '
        f'pos="{_n(*(np.asarray(cloth.top) + down))}" quat="{_n(np.cos(tilt / 2), np.sin(tilt / 2), 0, 0)}" '
        f'rgba="{_n(*cloth.rgb, 1)}"><edge equality="true" damping="0.001"/>'
        f'<contact selfcollide="none" contype="0" conaffinity="0"/><pin id="{" ".join(map(str, held))}"/></flexcomp>'
    )


def _pairs(scene: Scene) -> str:
    out = []

    def pair(a: str, b: str, mu: float, roll: float, e: float) -> None:
        out.append(
            f'<pair geom1="{a}" geom2="{b}" condim="6" friction="{_n(mu, mu, 0.02 * roll + 1e-5, roll, roll)}" '
            f'solref="{solref(e)}" solimp="0.95 0.95 0.001"/>'
        )

    still = (["floor"] if scene.floor else []) + [f.name for f in scene.fixtures if f.solid]
    for b in scene.bodies:
        if b.joint in ("free", "arm"):
            roll = b.rolling * b.size[0] / 2 if b.shape != "box" else 1e-6
            for s in still:
                pair(b.name, s, b.friction, roll, b.restitution)
        if b.joint == "track":
            for f in scene.fixtures:
                if f.solid and f.name.startswith("stop"):
                    pair(b.name, f.name, 0.1, 1e-6, b.restitution)
    for a, b in combinations(scene.bodies, 2):
        pair(a.name, b.name, scene.mutual_friction, 1e-6, scene.mutual_restitution)
    return "<contact>" + "".join(out) + "</contact>"


def _marks(scene: Scene, look: Look) -> str:
    if not look.marks:
        return ""
    dark = sum(look.floor_rgb) > 1.2 or look.floor == "wood"
    rgb = (0.08, 0.08, 0.08) if dark else (0.9, 0.9, 0.9)
    radius = scene.contents.get("mark_radius", 0.012)
    return "".join(
        f'<geom name="mark_{i}" type="cylinder" size="{_n(radius, 0.0004)}" pos="{_n(*p)}" zaxis="{_n(*z)}" '
        f'rgba="{_n(*rgb, 1)}" {VISUAL_ONLY}/>'
        for i, (p, z) in enumerate(zip(scene.marks, scene.mark_facing, strict=True))
    )


def model_text(scene: Scene, look: Look | None = None, extent: float = 2.0) -> str:
    """Return the scene's MJCF; with a look, also its floor's texture, its light and its marks."""
    light, assets, marks, ground = "", "", "", 'rgba=".5 .5 .5 1"'
    assets = '<material name="paint" specular="0.3" shininess="0.5"/>'
    visual = ""
    if look is not None:
        k = look.brightness
        visual = (
            f'<visual><global offwidth="{look.size[0]}" offheight="{look.size[1]}"/>'
            '<quality shadowsize="2048" offsamples="4"/><map znear="0.01" zfar="40" shadowclip="4"/>'
            f'<headlight ambient="{_n(*[0.38 * k] * 3)}" diffuse="{_n(*[0.2 * k] * 3)}" specular="0 0 0"/></visual>'
        )
        assets += (
            '<texture name="floor" type="2d" file="floor.png"/>'
            f'<material name="floor" texture="floor" texrepeat="1.2 1.2" texuniform="true" specular="0.1" '
            f'reflectance="{_n(look.reflectance)}"/>'
            '<texture name="sky" type="skybox" builtin="gradient" rgb1=".75 .8 .85" rgb2=".55 .57 .6" '
            'width="64" height="64"/>'
        )
        ground = 'material="floor"'
        marks = _marks(scene, look)
        a, e = np.radians(look.sun[0]), np.radians(look.sun[1])
        to_sun = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        cast = "false" if look.shadow == "none" else "true"
        light = (
            f'<light name="sun" directional="true" castshadow="{cast}" pos="{_n(*(3 * to_sun))}" dir="{_n(*-to_sun)}" '
            f'diffuse="{_n(*[0.62 * k] * 3)}" specular=".25 .25 .25"/>'
        )
    fixtures = "".join(
        f'<geom name="{f.name}" {shape_text(f)} pos="{_n(*f.pos)}" quat="{_n(*f.quat)}" rgba="{_n(*f.rgb, 1)}" '
        f"{VISUAL_ONLY}/>"
        for f in scene.fixtures
    )
    floor = f'<geom name="floor" type="plane" size="8 8 .1" {ground} {VISUAL_ONLY}/>' if scene.floor else ""
    weight = next((b for b in scene.bodies if b.joint == "rope"), None)
    bodies = "".join(_body(b) for b in scene.bodies if b.joint != "rope")
    hung = (_rope(scene.rope, weight) if scene.rope else "") + (_cloth(scene.cloth) if scene.cloth else "")
    return (
        f'<mujoco><option timestep="{DT!r}" gravity="0 0 {_n(-scene.gravity)}" cone="elliptic" impratio="10" '
        f'integrator="implicitfast"/><statistic extent="{_n(extent)}" center="0 0 0.2"/>{visual}<asset>{assets}</asset>'
        f'<worldbody>{light}<camera name="view" pos="0 -3 1" xyaxes="1 0 0 0 .3 1"/>{floor}'
        f"{fixtures}{marks}{bodies}{hung}"
        f"</worldbody>{_pairs(scene)}</mujoco>"
    )


def build(scene: Scene, look: Look | None = None, texture: bytes = b"", extent: float = 2.0) -> mujoco.MjModel:
    """Compile the scene into a simulator model."""
    assets = {"floor.png": texture} if look is not None else {}
    return mujoco.MjModel.from_xml_string(model_text(scene, look, extent), assets)
