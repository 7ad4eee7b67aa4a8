"""Worlds of a few simple bodies, written as command-line options instead of a JSON file."""

from __future__ import annotations

import argparse
import re

from pydantic import ValidationError

from atw_mcp.calls.results import validation_text
from atw_mcp.gap.options import EXAMPLES, FORM
from polyworld.world import Environment, StaticObject, World
from polyworld.world.geometry import circumscribed_radius
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Cylinder, Plane, Sphere
from polyworld.world.units import Dimension, read_quantity

GRAVITY = -Environment().gravity[2]  # [m/s^2]
_APART = 4.0  # distance of the bodies' first places, in radii of the largest: bodies of different runs never meet
_WITH_OBJECT = ("floor", "on_plane", "restitution", "friction", "gravity")


def world_of(options: argparse.Namespace) -> World:
    """Return the world that the options describe.

    Raises ValueError in one sentence for options that describe none, ValidationError for a JSON file that holds none.
    """
    if options.world is not None:
        given = [f"--{name.replace('_', '-')}" for name in _WITH_OBJECT if getattr(options, name) is not None]
        if given:
            raise ValueError(f"{', '.join(given)} go with --object; with --world, write them into {options.world}")
        return World.model_validate_json(options.world.read_text())
    if options.on_plane and options.floor is not None:
        raise ValueError("--on-plane and --floor exclude each other: bodies on a plane do not leave it")
    floor = None if options.floor is None else _quantity("--floor", options.floor, "length")
    contact = {k: v for k in ("restitution", "friction") if (v := getattr(options, k)) is not None}
    try:
        objects = [_body(text, bool(options.on_plane), contact) for text in options.objects]
        reach = max(circumscribed_radius(item.shape) for item in objects)
        return World(
            objects=tuple(
                item.model_copy(update={"position": (_APART * reach * k, 0.0, (floor or 0.0) + _half_height(item))})
                for k, item in enumerate(objects)
            ),
            statics=() if floor is None else (StaticObject(name="floor", shape=Plane(), position=(0.0, 0.0, floor)),),
            environment=Environment(gravity=(0.0, 0.0, -(GRAVITY if options.gravity is None else options.gravity))),
        )
    except ValidationError as error:
        raise ValueError(f"the world of --object: {validation_text(error)}") from error


def _body(text: str, planar: bool, contact: dict[str, float]) -> RigidObject:
    """Return the body that a text NAME:SHAPE:SIZE:MASS describes, at the origin."""
    where = f"--object {text!r}"
    parts = [part.strip() for part in text.split(":")]
    if len(parts) != 4:
        raise ValueError(f"{where} has {len(parts)} parts, expected {FORM}, such as {EXAMPLES['sphere']}")
    name, kind, size, weight = parts
    if kind not in EXAMPLES:
        raise ValueError(f"{where}: {kind!r} is no shape; choose from {', '.join(EXAMPLES)}, as in {EXAMPLES['box']}")
    if kind == "box":
        shape: Sphere | Box | Cylinder = _box(where, size)
    else:
        shape = _round(where, kind, size, planar)
    mass = _positive(where, weight, "mass")
    try:
        return RigidObject.model_validate(
            {
                "name": name,
                "representation": "rigid_planar" if planar else "rigid_spatial",
                "shape": shape,
                "mass": mass,
                "position": (0.0, 0.0, 0.0),
                **contact,
            }
        )
    except ValidationError as error:
        raise ValueError(f"{where}: {validation_text(error)}") from error


def _box(where: str, size: str) -> Box:
    edges = [edge.strip() for edge in re.split(r"[x×*]", size)]
    unit = re.sub(r"^[\d.eE+-]*", "", edges[-1])
    if len(edges) == 1:
        edges *= 3  # a cube
    if len(edges) != 3:
        raise ValueError(f"{where}: a box has three edges, as in {EXAMPLES['box']}, or one for a cube")
    whole = [edge if re.search(r"[a-z]", edge.lower().replace("e", "")) else edge + unit for edge in edges]
    x, y, z = (_positive(where, edge, "length") / 2.0 for edge in whole)
    return Box(half_extents=(x, y, z))


def _round(where: str, kind: str, size: str, planar: bool) -> Sphere | Cylinder:
    """Return a sphere, cylinder or disc by radius or diameter, and height."""
    given: dict[str, float] = {}
    for part in size.split(","):
        key, equals, value = (p.strip() for p in part.rpartition("="))
        key = key.lower() if equals else "r"
        if key not in ("r", "d", "h") or key in given or (kind == "sphere" and key == "h"):
            raise ValueError(f"{where}: size {size!r} is not that of a {kind}, as in {EXAMPLES[kind]}")
        given[key] = _positive(where, value, "length")
    if ("r" in given) == ("d" in given):
        raise ValueError(f"{where}: a {kind} needs its radius r or its diameter d, one of them, as in {EXAMPLES[kind]}")
    radius = given["r"] if "r" in given else given["d"] / 2.0
    if kind == "sphere":
        return Sphere(radius=radius)
    if "h" not in given and not (planar and kind == "disc"):
        raise ValueError(f"{where}: a {kind} needs its height h, as in {EXAMPLES[kind]}")
    # How thick a disc is does not matter to its motion on a plane.
    return Cylinder(radius=radius, half_height=given.get("h", radius) / 2.0)


def _half_height(item: RigidObject) -> float:
    shape = item.shape
    if isinstance(shape, Box):
        return shape.half_extents[2]
    return shape.half_height if isinstance(shape, Cylinder) else circumscribed_radius(shape)


def _positive(where: str, text: str, dimension: Dimension) -> float:
    value = _quantity(where, text, dimension)
    if value <= 0.0:
        raise ValueError(f"{where}: {text!r} must be positive")
    return value


def _quantity(where: str, text: str, dimension: Dimension) -> float:
    try:
        return read_quantity(text, dimension)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
