"""Random small files of MJCF, URDF and USD, most of them wrong."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from random import Random

from polyworld.exchange import Imported, import_confined

NUMBERS = ("0", "-1", "0.1", "1", "3", "1000", "1e9", "1e308", "-1e-320", "nan", "inf", "", "x", "99999999999999999999")
GEOMS = ("sphere", "box", "capsule", "cylinder", "ellipsoid", "plane", "mesh", "hfield", "nothing")
TREE = {
    "mujoco": ("worldbody", "option", "asset", "default", "contact", "equality", "tendon", "actuator", "keyframe"),
    "worldbody": ("body", "geom", "replicate", "composite", "flexcomp", "include", "frame"),
    "body": ("body", "geom", "joint", "freejoint", "inertial", "replicate", "composite", "flexcomp"),
    "replicate": ("body", "geom", "replicate"),
    "frame": ("body", "geom", "frame"),
    "asset": ("mesh", "hfield", "texture", "material"),
    "robot": ("link", "link", "joint"),
    "link": ("inertial", "collision", "visual"),
    "collision": ("geometry", "origin"),
    "geometry": ("sphere", "box", "cylinder", "mesh"),
    "joint": ("parent", "child", "limit", "axis"),
    "inertial": ("mass", "inertia", "origin"),
}
ATTRIBUTES = (
    "name", "type", "size", "pos", "quat", "euler", "mass", "count", "offset", "axis", "range", "file", "density",
    "spacing", "dim", "curve", "vertex", "nrow", "ncol", "radius", "length", "xyz", "value", "ixx", "link", "filename",
)  # fmt: skip
PRIMS = ("Xform", "Sphere", "Cube", "Mesh", "PhysicsRevoluteJoint", "PointInstancer", "Plane")
APIS = ("PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysicsMassAPI", "PhysicsArticulationRootAPI")


def _element(rng: Random, tag: str, depth: int) -> ET.Element:
    made = ET.Element(tag)
    for name in rng.sample(ATTRIBUTES, rng.randint(0, 5)):
        if name == "type":
            made.set(name, rng.choice((*GEOMS, "free", "hinge", "fixed", "grid", "cable", "box", "2D")))
        elif name in ("name", "file", "filename", "link"):
            made.set(name, rng.choice(("a", "b", "../a.obj", "/dev/zero", "a.xml", "a.stl")))
        elif name == "count":
            made.set(name, " ".join(rng.choice(("1", "3", "40", "1000", "-1", "x")) for _ in range(rng.randint(1, 3))))
        else:
            made.set(name, " ".join(rng.choice(NUMBERS) for _ in range(rng.randint(1, 4))))
    if depth:
        for _ in range(rng.randint(0, 4)):
            if tag in TREE:
                made.append(_element(rng, rng.choice(TREE[tag]), depth - 1))
    return made


def _prim(rng: Random, depth: int, number: int) -> str:
    lists = ", ".join(f'"{api}"' for api in rng.sample(APIS, rng.randint(0, 3)))
    more = rng.choice(
        ("", "references = @/dev/zero@", "payload = @a.usda@", "instanceable = true", "references = </p0>")
    )
    values = [
        f"double radius = {rng.choice(NUMBERS[:8])}",
        f"float3[] extent = [({rng.choice(NUMBERS[:5])}, 0, 0), (1, 1, 1)]",
        f"double3 xformOp:translate = (0, {rng.choice(NUMBERS[:8])}, 0)\n uniform token[] xformOpOrder = "
        '["xformOp:translate"]',
        f"float physics:mass = {rng.choice(NUMBERS[:8])}",
        f"int[] faceVertexCounts = [3, {rng.choice(('3', '-1', '1000000000'))}]\n"
        " int[] faceVertexIndices = [0, 1, 99]\n point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]",
    ]
    inner = "".join(_prim(rng, depth - 1, k) for k in range(rng.randint(0, 3))) if depth else ""
    body = "\n ".join(rng.sample(values, rng.randint(0, 4)))
    return f'def {rng.choice(PRIMS)} "p{number}" (prepend apiSchemas = [{lists}]\n {more})\n{{\n {body}\n{inner}}}\n'


def write(folder: Path, seed: int) -> Path:
    """Write the file of a seed: MJCF, URDF and USD in turn, one in eight cut short somewhere."""
    rng = Random(seed)
    ending = (".xml", ".urdf", ".usda")[seed % 3]
    if ending == ".usda":
        text = "#usda 1.0\n(metersPerUnit = 1)\n" + "".join(_prim(rng, 2, k) for k in range(rng.randint(1, 4)))
    else:
        text = ET.tostring(_element(rng, "mujoco" if ending == ".xml" else "robot", 5), encoding="unicode")
    if rng.random() < 0.125:
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
