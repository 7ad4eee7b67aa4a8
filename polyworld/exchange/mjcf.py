"""A world of rigid bodies as MJCF, MuJoCo's own format."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Any

import numpy as np

from polyworld.exchange.mjcf_contacts import Contacts
from polyworld.exchange.mjcf_joints import Tree
from polyworld.exchange.mjcf_shapes import Assets, add_geom
from polyworld.exchange.mjcf_text import number, numbers, placed
from polyworld.world import World, geometry
from polyworld.world.shapes import Plane, TriangleMesh, Wall

KEYFRAME = "start"  # holds velocities and motors, which MJCF's bodies do not


@dataclass(frozen=True)
class Exported:
    """An MJCF document, and a sentence for everything of the world that it does not hold, or holds otherwise."""

    xml: str
    left_out: tuple[str, ...]


def export_mjcf(world: World) -> Exported:
    """Return a world of spatial rigid bodies as an MJCF document.

    Velocities at the start and motors are in its keyframe "start". Raises ValueError for planar worlds.
    """
    if world.planar:
        raise ValueError(
            "planar worlds have no counterpart in MJCF: give the objects the representation rigid_spatial, and a plane "
            "to slide on as a static"
        )
    notes = _absent(world)
    root = ET.Element("mujoco", model=world.id)
    contacts = Contacts(world)
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(
        root,
        "option",
        timestep=number(contacts.timestep),
        gravity=numbers(world.environment.gravity),
        integrator="implicitfast",
        cone="elliptic",
        impratio="10",
    )
    assets = Assets(ET.SubElement(root, "asset"))
    worldbody = ET.SubElement(root, "worldbody")
    for static in world.statics:
        place = {"pos": numbers(static.position), "quat": numbers(static.orientation)}
        shape: Any = static.shape
        if isinstance(shape, Wall):
            shape, centre, rotation = geometry.wall_box(shape)
            turn = geometry.quaternion_matrix(np.asarray(static.orientation))
            place = placed(turn @ centre + np.asarray(static.position), turn @ rotation)
        elif isinstance(shape, Plane):
            place = _plane(static)
        elif isinstance(shape, TriangleMesh):
            notes.append(f"{static.name}: MuJoCo collides with the convex hull of its mesh")
        add_geom(worldbody, assets, static.name, shape, place, static.appearance, contacts.of_static(static))
    tree = Tree(world, contacts.timestep)
    _add_bodies(worldbody, None, tree, assets, contacts)
    contacts.write(root)
    tree.write(root)
    notes += [*tree.notes, *contacts.notes]
    for part in ("asset", "contact", "equality", "tendon", "actuator"):
        found = root.find(part)
        if found is not None and not len(found):
            root.remove(found)
    _add_keyframe(root, tree)
    ET.indent(root)
    return Exported(ET.tostring(root, encoding="unicode") + "\n", tuple(notes))


def _add_bodies(parent: ET.Element, name: str | None, tree: Tree, assets: Assets, contacts: Contacts) -> None:
    """Add the bodies that hang on the body `name`, or on the world, and theirs."""
    for item in tree.children(name):
        position, rotation = tree.relative(item, name)
        body = ET.SubElement(parent, "body", {"name": item.name, **placed(position, rotation)})
        tree.add_joint(body, item)
        mass = item.mass if item.mass is not None else item.density * geometry.mass_properties(item.shape).volume
        solid = geometry.mass_properties(item.shape)
        inertia = solid.inertia / solid.volume * mass
        moments = (*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2])
        ET.SubElement(body, "inertial", pos="0 0 0", mass=number(mass), fullinertia=numbers(moments))
        for count, piece in enumerate(geometry.pieces(item.shape)):
            label = item.name if count == 0 else f"{item.name}-{count}"
            where = placed(piece.position, piece.rotation)
            add_geom(body, assets, label, piece.shape, where, item.appearance, contacts.of_object(item))
        _add_bodies(body, item.name, tree, assets, contacts)


def _plane(static: Any) -> dict[str, str]:
    turn = geometry.quaternion_matrix(np.asarray(static.orientation))
    normal = np.asarray(static.shape.normal, dtype=float)
    normal = turn @ (normal / np.linalg.norm(normal))
    offset = static.shape.offset + normal @ np.asarray(static.position)
    aside = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = np.cross(aside, normal)
    first /= np.linalg.norm(first)
    return placed(normal * offset, np.stack([first, np.cross(normal, first), normal], axis=1))


def _add_keyframe(root: ET.Element, tree: Tree) -> None:
    positions, velocities, controls = tree.start()
    frame = {"qpos": positions, "qvel": velocities, "ctrl": controls}
    given = {name: numbers(values) for name, values in frame.items() if len(values)}
    ET.SubElement(ET.SubElement(root, "keyframe"), "key", {"name": KEYFRAME, **given})


def _absent(world: World) -> list[str]:
    found = []
    for part, what in (("deformables", "deformable objects"), ("attachments", "attachments"), ("effects", "effects")):
        names = [x.name for x in getattr(world, part)]
        if names:
            found.append(f"{what} are left out: {', '.join(names)}")
    for name in ("linear_damping", "angular_damping"):
        damped = [o.name for o in world.objects if getattr(o, name)]
        if damped:
            found.append(f"{name} is left out: {', '.join(damped)}")
    late = [o.name for o in world.objects if o.start_time > 0.0]
    if late:
        found.append(f"start_time is left out, they are there from the start: {', '.join(late)}")
    return found
