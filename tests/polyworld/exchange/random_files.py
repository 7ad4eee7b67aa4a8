"""Random small files of MJCF, URDF and USD: almost right, they ask for much, for nonsense or for other files."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from random import Random

from polyworld.exchange import Imported, import_confined

NEEDED = ("count", "size", "body1", "body2", "anchor", "joint", "name", "type", "nrow", "ncol", "vertex")
BAD = ("0", "-1", "1e9", "1e308", "-1e-320", "nan", "inf", "", "x", "99999999999999999999")
RARE = 0.04  # of the values are bad, of the names are unknown, of the elements lie in the wrong place
GEOMS = ("sphere", "box", "capsule", "cylinder", "ellipsoid")

# Tag: its children. A tag stands several times where it is wanted often.
TREE = {
    "mujoco": ("worldbody", "worldbody", "asset", "option", "default", "equality", "contact", "tendon", "actuator"),
    "worldbody": ("body", "body", "body", "geom", "replicate", "frame"),
    "body": ("body", "geom", "geom", "joint", "freejoint", "inertial", "replicate", "composite", "flexcomp", "site"),
    "replicate": ("body", "geom", "replicate"),
    "frame": ("body", "geom", "frame"),
    "asset": ("mesh", "hfield", "texture", "material"),
    "equality": ("connect", "weld"),
    "actuator": ("motor", "position"),
    "link": ("inertial", "collision", "visual"),
    "collision": ("geometry", "origin"),
    "visual": ("geometry", "origin"),
    "geometry": ("sphere", "box", "cylinder", "mesh"),
    "uinertial": ("mass", "inertia", "origin"),
    "ujoint": ("limit", "axis", "origin"),
}
# Tag: attributes and what they hold: a number of numbers, or words to choose from.
HOLDS: dict[str, dict[str, int | str | tuple[str, ...]]] = {
    "option": {"timestep": 1, "gravity": 3, "integrator": ("Euler", "RK4"), "iterations": ("1", "1000000000")},
    "body": {"pos": 3, "quat": 4, "euler": 3, "mocap": ("true", "false")},
    "geom": {"type": GEOMS, "size": 3, "pos": 3, "quat": 4, "mass": 1, "friction": 3, "mesh": ("m",), "hfield": ("h",)},
    "joint": {"type": ("hinge", "slide", "ball", "free"), "axis": 3, "range": 2, "damping": 1, "stiffness": 1},
    "inertial": {"pos": 3, "mass": 1, "diaginertia": 3},
    "replicate": {"count": (*"2223333559", "90", "100000"), "offset": 3, "euler": 3, "sep": ("-", "")},
    "composite": {"type": ("cable", "grid"), "count": ("9 1 1", "400 1 1", "3 3 3"), "size": 1, "curve": ("l 0 0",)},
    "flexcomp": {
        "name": ("f", "g"), "type": ("grid", "box", "mesh"),
        "count": ("3 3 1", "9 9 9", "9 9 9", "25 25 25", "999 999 999"),
        "spacing": 3, "dim": ("1", "2", "3"), "radius": 1, "mass": 1, "file": ("a.obj",),
    },
    "mesh": {"name": ("m",), "vertex": 12, "file": ("", "", "a.obj", "/dev/zero"), "scale": 3},
    "hfield": {"name": ("h",), "nrow": ("2", "900", "30000"), "ncol": ("2", "900", "30000"), "size": 4},
    "texture": {"name": ("t",), "type": ("2d",), "builtin": ("flat",), "width": ("9", "30000")},
    "connect": {"body1": ("b0", "b1", "none"), "body2": ("b1", "b2"), "anchor": 3},
    "weld": {"body1": ("b0", "b1"), "body2": ("b2", "b1"), "relpose": 7},
    "motor": {"joint": ("j",), "gear": 1},
    "sphere": {"radius": 1},
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "origin": {"xyz": 3, "rpy": 3},
    "mass": {"value": 1},
    "inertia": {"ixx": ("1", "1e-9"), "iyy": "1", "izz": ("1", "1.5"), "ixy": ("0", "3"), "ixz": "0", "iyz": "0"},
    "ujoint": {"type": ("revolute", "prismatic", "fixed", "continuous", "floating", "planar")},
    "limit": {"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
    "axis": {"xyz": 3},
}  # fmt: skip
PRIMS = ("Xform", "Sphere", "Cube", "Capsule", "Cylinder", "Mesh", "PhysicsRevoluteJoint", "PointInstancer", "Plane")
APIS = ("PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysicsMassAPI", "PhysicsArticulationRootAPI")
META = (
    "instanceable = true",
    "references = </p0>",
    "inherits = </p1>",
    "references = @/dev/zero@",
    "payload = @a.usda@",
)


def _number(rng: Random) -> str:
    return rng.choice(BAD) if rng.random() < RARE / 4 else f"{rng.choice((1,) * 12 + (-1,)) * rng.expovariate(2.0):.3g}"


def _element(rng: Random, tag: str, depth: int, urdf: bool) -> ET.Element:
    own = f"u{tag}" if urdf and f"u{tag}" in TREE else tag
    made = ET.Element(tag)
    if tag == "body" and rng.random() < 0.5:
        made.set("name", f"b{rng.randrange(12)}")
    for name, holds in HOLDS.get(own, {}).items():
        if rng.random() < (1.0 if urdf or name in NEEDED else 0.4):
            text = rng.choice(holds) if not isinstance(holds, int) else " ".join(_number(rng) for _ in range(holds))
            if text:
                made.set(name if rng.random() > RARE / 4 else "nothing", text)
    inner = TREE.get(own, ())
    if inner and depth:
        several = rng.randint(1, 5) if tag in ("mujoco", "worldbody", "body", "replicate") else len(inner)
        wanted = rng.sample(inner, min(several, len(inner))) if urdf else rng.choices(inner, k=several)
        for child in wanted:
            made.append(_element(rng, child, depth - 1, urdf))
    if rng.random() < RARE / 8:
        made.append(_element(rng, rng.choice(sorted(HOLDS)).removeprefix("u"), 1, urdf))
    return made


def _robot(rng: Random) -> ET.Element:
    made = ET.Element("robot", name="r")
    for k in range(rng.randint(1, 9)):
        link = _element(rng, "link", 4, urdf=True)
        link.set("name", f"l{k}")
        made.append(link)
        if k:
            joint = _element(rng, "joint", 4, urdf=True)
            joint.set("name", f"j{k}")
            ET.SubElement(joint, "parent", link=f"l{rng.randrange(k)}")
            ET.SubElement(joint, "child", link=f"l{k if rng.random() > RARE else rng.randrange(k + 2)}")
            made.append(joint)
    return made


def _prim(rng: Random, depth: int, number: int) -> str:
    lists = ", ".join(f'"{api}"' for api in [*APIS[: rng.randint(1, 3)], *rng.sample(APIS[3:], rng.randint(0, 1))])
    more = f"\n {rng.choice(META)}" if rng.random() < RARE / 4 else ""
    many = rng.choice((3, 40, 3000))
    values = [
        f"double radius = {_usd(rng)}",
        f"double size = {_usd(rng)}",
        f"double height = {_usd(rng)}",
        f"double3 xformOp:translate = (0, {_usd(rng)}, 0)",
        f"float3 xformOp:scale = (1, {_usd(rng)}, {_usd(rng)})",
        'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]',
        f"float3 physics:diagonalInertia = (1, {_usd(rng)}, 1)",
        f"int[] faceVertexCounts = [{', '.join(['3'] * many)}, {rng.choice(('3', '3', '-1', '1000000000'))}]",
        f"int[] faceVertexIndices = [{', '.join(str(rng.randrange(4)) for _ in range(3 * many + 3))}]",
        "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]",
        f"int[] protoIndices = [{', '.join(['0'] * many)}]",
        "rel prototypes = </p0>",
        f"rel physics:body{rng.choice('01')} = {rng.choice(('</p0>', '</p1>', '</none>'))}",
        'uniform token physics:axis = "Z"',
        f"double radius.timeSamples = {{ 0: 1, {rng.choice(('1', '1e300'))}: 2 }}",
    ]
    inner = "".join(_prim(rng, depth - 1, k) for k in range(rng.randint(0, 3))) if depth else ""
    body = "\n ".join([f"float physics:mass = {_usd(rng)}", *rng.sample(values, rng.randint(2, 9))])
    kind = rng.choice(PRIMS)
    return f'def {kind} "p{number}" (\n prepend apiSchemas = [{lists}]{more}\n)\n{{\n {body}\n{inner}}}\n'


def _usd(rng: Random) -> str:
    return rng.choice(("0", "-1", "1e9", "1e308", "nan", "inf")) if rng.random() < RARE else f"{rng.expovariate(2):.3g}"


def write(folder: Path, seed: int) -> Path:
    """Write the file of a seed: MJCF, URDF and USD in turn, one in twenty cut short somewhere."""
    rng = Random(seed)
    ending = (".xml", ".urdf", ".usda")[seed % 3]
    if ending == ".usda":
        text = "#usda 1.0\n(\n metersPerUnit = 1\n)\n" + "".join(_prim(rng, 2, k) for k in range(rng.randint(1, 4)))
    else:
        root = _robot(rng) if ending == ".urdf" else _element(rng, "mujoco", 5, urdf=False)
        text = ET.tostring(root, encoding="unicode")
    if rng.random() < 0.05:
        text = text[: rng.randrange(len(text))]
    path = folder / f"seed-{seed}{ending}"
    path.write_text(text)
    return path


def outcome(path: Path, importer: Callable[..., Imported] = import_confined) -> str:
    """Import a file that may read no other; returns how that ended: "read" or the first words of why not."""

    def read(other: Path) -> bytes:
        if other != path:
            raise ValueError(f"{other} may not be read")
        return other.read_bytes()

    try:
        importer(path, read=read)
    except ValueError as error:
        return str(error).replace(path.name, "it")[:60].split("\n")[0]
    return "read"
