"""A world as the page shows it: what moves, what stands, what holds, what acts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from atw_mcp.viewer import parts, world_parts
from atw_mcp.viewer.colors import hex_color
from atw_mcp.viewer.effects import effect_marks
from atw_mcp.viewer.packing import Blocks
from atw_mcp.viewer.shapes import form_words, shape_view
from atw_mcp.viewer.starts import start_of, start_view
from atw_mcp.worlds.marks import held_nodes
from polyworld.model import mesh_of
from polyworld.pictures.rigid_pictures import STATIC_COLOR
from polyworld.probing.readouts.rope_line import rope_line
from polyworld.solver.energy_sources import points_masses
from polyworld.trajectory import Trajectory
from polyworld.world import Deformable, World, geometry
from polyworld.world.colors import display_color
from polyworld.world.materials import Form, material_of
from polyworld.world.parameter_tables import STATE_PARAMETERS
from polyworld.world.parameters import object_mass, parameter_paths, read_parameter
from polyworld.world.representations.attachment import Attachment
from polyworld.world.representations.joint import Hinge, Slider, Spring

KINDS: dict[Form, world_parts.MovingKind] = {"line": "rope", "sheet": "cloth", "solid": "soft", "liquid": "fluid"}


def world_view(
    world: World,
    blocks: Blocks,
    colors: Mapping[str, str],
    *,
    label: str,
    origin: str,
    parent: str | None,
    committed: bool,
    runs: Sequence[Trajectory] = (),
    follows: world_parts.Following | None = None,
) -> world_parts.WorldView:
    """Return a world; colors: of its moving objects, by name; runs: of it, whose objects say where fields are shown;
    follows: how well it follows the data that it was fitted to."""
    camera = world.camera
    return world_parts.WorldView(
        id=world.id,
        label=label,
        origin=origin,
        parent=parent,
        committed=committed,
        follows=follows,
        planar=world.planar,
        seconds_per_frame=world.time.seconds_per_frame,
        frame_count=world.time.frame_count,
        gravity=list(world.environment.gravity),
        camera=None if camera is None else world_parts.CameraView.model_validate(camera.model_dump(mode="json")),
        moving=[
            *(
                world_parts.Moving(
                    name=item.name,
                    kind="rigid",
                    color=colors[item.name],
                    mass=object_mass(item),
                    shape=shape_view(item.shape, blocks),
                    form=form_words(item.shape),
                    radius=None,
                    segments=None,
                    triangles=None,
                    start_time=item.start_time,
                )
                for item in world.objects
            ),
            *(_deformable(world, item, blocks, colors[item.name]) for item in world.deformables),
        ],
        statics=[
            world_parts.Static(
                name=static.name,
                color=hex_color(display_color(static.appearance.color or STATIC_COLOR, 0)),
                shape=shape_view(static.shape, blocks),
                position=list(static.position),
                orientation=list(static.orientation),
            )
            for static in world.statics
        ],
        joints=_joints(world),
        regions=_regions(world),
        effects=effect_marks(world, runs, blocks),
        floor=_floor(world),
        parameters=_parameters(world),
        start=None if runs else start_view(world, blocks),
    )


def _deformable(world: World, item: Deformable, blocks: Blocks, color: str) -> world_parts.Moving:
    mesh, kind = mesh_of(world, item), KINDS[material_of(item).form]
    radius, segments, triangles = None, None, None
    if kind == "rope":
        radius = float(getattr(item, "radius", 0.0)) or None
        count = _line_points(world, item.name)
        pairs = mesh.segments if count == len(mesh.nodes) else np.stack([np.arange(count - 1), np.arange(1, count)], 1)
        segments = blocks.integers(pairs)
    elif kind == "fluid":
        assert world.fluid_grid is not None  # a world with a fluid has one
        radius = world.fluid_grid.cell / 4.0  # two particles lie along the edge of a cell
    else:
        triangles = blocks.integers(mesh.triangles)
    return world_parts.Moving(
        name=item.name,
        kind=kind,
        color=color,
        mass=float(points_masses(world, item.name).sum()) or None,
        shape=None,
        radius=radius,
        segments=segments,
        triangles=triangles,
        start_time=float(getattr(item, "start_time", 0.0)),
    )


def _line_points(world: World, name: str) -> int:
    """Count the points of a rope's line, which over pulleys has more than its nodes."""
    return int(rope_line(world, start_of(world, [name]), name).shape[-2])


def _joints(world: World) -> list[world_parts.JointMark]:
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    marks = []
    for joint in world.joints:
        axis = _unit(joint.axis) if isinstance(joint, Hinge | Slider) else None
        if isinstance(joint, Hinge) and world.planar:
            axis = normal.tolist()
        marks.append(
            world_parts.JointMark(
                name=joint.name,
                kind=joint.kind,
                object=joint.object,
                other=joint.other,
                anchor=list(joint.anchor),
                other_anchor=list(joint.other_anchor) if isinstance(joint, Spring) else None,
                axis=axis,
                radius=None,
            )
        )
    for held in world.attachments:
        nodes = held_nodes(world, held)
        places = mesh_of(world, world.deformable(held.object)).nodes[nodes]
        marks.append(
            world_parts.JointMark(
                name=held.name,
                kind="attachment",
                object=held.object,
                other=held.to,
                anchor=places.mean(axis=0).tolist(),
                other_anchor=None,
                axis=None,
                radius=None,
                held=_held_points(world, held, nodes),
            )
        )
    for pulley in world.pulleys:
        marks.append(
            world_parts.JointMark(
                name=pulley.name,
                kind="pulley",
                object=pulley.rope,
                other=pulley.object,
                anchor=list(pulley.centre),
                other_anchor=None,
                axis=_unit(pulley.axis),
                radius=pulley.radius,
            )
        )
    return marks


def _held_points(world: World, held: Attachment, nodes: list[int]) -> list[int]:
    """Indices of held nodes among the points that are shown; of a rope over pulleys only its ends have one."""
    mesh = mesh_of(world, world.deformable(held.object))
    count = _line_points(world, held.object) if len(mesh.segments) else len(mesh.nodes)
    if count == len(mesh.nodes):
        return nodes
    last = len(mesh.nodes) - 1
    return [0 if node == 0 else count - 1 for node in nodes if node in (0, last)]


def _regions(world: World) -> list[world_parts.Region]:
    found: list[tuple[str, str, Any, Any]] = []
    grid = world.fluid_grid
    if grid is not None:
        found.append(("fluid_grid", "closed fluid grid" if grid.closed else "open fluid grid", grid.lower, grid.upper))
    for emitter in world.emitters:
        centre = np.asarray(emitter.position)
        found.append((emitter.name, "emitter", centre - emitter.radius, centre + emitter.radius))
    found += [(drain.name, "drain", drain.lower, drain.upper) for drain in world.drains]
    boxes = [
        world_parts.Region(name=name, kind=kind, lower=np.asarray(lower).tolist(), upper=np.asarray(upper).tolist())
        for name, kind, lower, upper in found
    ]
    carried = [
        world_parts.Region(name=c.name, kind="container", lower=list(c.lower), upper=list(c.upper), object=c.object)
        for c in world.containers
    ]
    return boxes + carried


def _floor(world: World) -> parts.Plane | None:
    """Return the plane that carries planar objects, where gravity presses them onto it."""
    plane = world.environment.motion_plane
    if not (world.planar and plane.supports and float(np.dot(world.environment.gravity, plane.normal)) < 0.0):
        return None
    normal = _unit(plane.normal)
    return parts.Plane(normal=normal, offset=float(np.dot(normal, plane.point)))


def _parameters(world: World) -> list[world_parts.Value]:
    """Return all parameters that have a value, but those of the start."""
    found = []
    for path, spec in parameter_paths(world).items():
        part, _, rest = path.partition(".")
        _name, _, field = rest.partition(".")
        if part in ("objects", "statics") and (field in STATE_PARAMETERS or field.startswith(("shift", "position"))):
            continue
        value = read_parameter(world, path)
        if value is not None:
            short = rest if part in ("objects", "joints", "effects", "pulleys", "emitters", "statics") else path
            found.append(world_parts.Value(name=short, value=value, unit=spec.unit))
    return found


def _unit(direction: Any) -> list[float]:
    values = np.asarray(direction, dtype=float)
    unit: list[float] = (values / np.linalg.norm(values)).tolist()
    return unit
