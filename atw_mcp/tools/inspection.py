"""World inspection: what a world contains and how well its numbers are known."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from atw_mcp.calls.app import App
from atw_mcp.calls.names import chosen_names
from atw_mcp.calls.results import Answer, explained
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.cases.material_facts import about_deformable, mass, nodes_of, size_of
from atw_mcp.cases.origins import knowledge, lineage
from atw_mcp.results.inspection import InspectedWorld, Properties
from evidence_store import Case
from polyworld.effects import CATALOGUE
from polyworld.probing.margins import ABOUT
from polyworld.probing.predicates import Holds
from polyworld.world import Deformable, World
from polyworld.world.materials import material_of
from polyworld.world.parameter_tables import OBJECT_PARAMETERS, STATE_PARAMETERS
from polyworld.world.parameters import parameter_paths, read_parameter, specification
from polyworld.world.representations.rigid import RigidObject

GROUP = ToolGroup("world inspection")

CaseId = Annotated[str, Field(description="case id")]
WorldId = Annotated[str | None, Field(description="world id; default: the committed, else the latest")]
Objects = Annotated[list[str] | None, Field(description="names of objects; default: all", max_length=64)]

LOOKS = ("shape", "color", "material", "representation")
SIZES = ("length", "area", "volume", "mass")  # of deformable objects, at rest
VECTORS = ("position", "velocity", "angular_velocity")
SCALARS = tuple(OBJECT_PARAMETERS)
SHOWN_OTHERWISE = {"objects", "deformables", "statics", "environment", "effects", "time", "camera"}


@GROUP.tool("InspectWorld", title="Inspect a world", returns=InspectedWorld)
def inspect_world(
    app: App,
    case: CaseId,
    world: WorldId = None,
    objects: Objects = None,
    fields: Annotated[
        list[Literal["appearance", "shape", "parameters", "initial_state", "visibility", "nodes"]] | None,
        Field(
            description="what to show of each object; default: appearance, shape, visibility. nodes: where some "
            "nodes of deformable objects start, by index, for attachments",
            max_length=6,
        ),
    ] = None,
) -> Answer:
    """Describe a world: objects of every kind with their looks, shape and visibility, statics, joints, fastenings,
    pulleys, fluid grid, emitters and containers, effects, gravity, time base, what it descends from, and which edits,
    predicates and parameters it has. ReadProperty says how well a number is known."""
    found_case = app.case(case)
    found = app.world(found_case, world)
    names = chosen_names(app, found_case, objects, found.moving_names)
    wanted = fields or ["appearance", "shape", "visibility"]
    frame = found.time.seconds_per_frame
    origin = dict(app.store.cases.worlds(found_case.id))[found.id]
    stage = "committed" if found.id == found_case.committed_world else "branch" if origin == "intervention" else "draft"
    effects = ", ".join(effect.name for effect in found.effects if effect.enabled)
    return Answer(
        summary=f"{stage} world {found.id}: {len(found.moving_names)} {'planar' if found.planar else 'spatial'} "
        f"objects ({', '.join(_named(found))}), {len(found.statics)} statics"
        + (f", effects: {effects}" if effects else ""),
        data={
            "world": found.id,
            "stage": stage,
            "descent": lineage(app, found_case, found),
            "objects": [_about(app, found_case, found, name, wanted) for name in names],
            "statics": [item.model_dump(mode="json", exclude_none=True) for item in found.statics],
            "environment": found.environment.model_dump(mode="json", exclude_none=True),
            "effects": [item.model_dump(mode="json", exclude_none=True) for item in found.effects],
            **found.model_dump(mode="json", exclude=SHOWN_OTHERWISE, exclude_none=True),
            "time": {
                "seconds_per_frame": frame,
                "frame_count": found.time.frame_count,
                "observed_until": max(found.time.frame_count - 1, 0) * frame,
                "substep": found.time.substep,
            },
            "camera": None if found.camera is None else {"width": found.camera.width, "height": found.camera.height},
            "capabilities": {
                "edits": _edits(found),
                "predicates": _predicates(found),
                "effects_that_can_be_added": list(CATALOGUE),
                "parameters": _parameters(found, names),
            },
        },
        case=found_case.id,
        world=found.id,
        objects=tuple(names),
    )


@GROUP.tool("ReadProperty", title="Read a property", returns=Properties)
def read_property(
    app: App,
    case: CaseId,
    property: Annotated[
        str,
        Field(
            description="property of objects, or a path such as joints.door.friction. Properties: "
            f"{', '.join((*SCALARS, *VECTORS, *LOOKS))}; of ropes, "
            f"cloth, soft bodies and fluids: {', '.join(SIZES)} and their own parameters (stretch_stiffness, "
            "youngs_modulus, viscosity, ...). Paths: objects.red.friction, joints.door.friction, "
            "environment.gravity.z, time.seconds_per_frame",
            min_length=1,
            max_length=200,
        ),
    ],
    objects: Objects = None,
    world: WorldId = None,
) -> Answer:
    """Read a physical property from a world without running it: value, unit, and how it is known. fitted values come
    with their standard error; observed ones were read off the tracks; assumed ones are spins that no frame shows; given
    or default ones were never inferred from the video, so they are no evidence about it; edited ones were set in a
    branch. A contact's friction and restitution are each the geometric mean of both bodies' values, or the object's own
    where a static has none."""
    found_case = app.case(case)
    found = app.world(found_case, world)
    if "." in property:
        if objects is not None:
            raise ToolError(f"{property!r} is a whole path: leave objects out, or give the bare property")
        rows = [_parameter(app, found_case, found, property)]
        names = [property.split(".")[1]] if property.startswith("objects.") else []
    else:
        names = chosen_names(app, found_case, objects, found.moving_names)
        if objects is None:
            names = [name for name in names if property in _properties(found, name)]
            if not names:
                known = sorted({p for name in found.moving_names for p in _properties(found, name)})
                raise ToolError(f"no object has a {property!r}; properties: {', '.join(known)}, or a path")
        rows = [{"object": name, **_property(app, found_case, found, name, property)} for name in names]
    return Answer(
        summary=f"{property}: " + "; ".join(_in_words(row) for row in rows),
        data={"property": property, "values": rows},
        case=found_case.id,
        world=found.id,
        objects=tuple(names),
    )


def _named(world: World) -> list[str]:
    """Names of what moves, with the kind of what is not rigid."""
    return [o.name for o in world.objects] + [f"{d.name}: {d.representation}" for d in world.deformables]


def _about(app: App, case: Case, world: World, name: str, wanted: list[Any]) -> dict[str, Any]:
    item, rigid = world.item(name), world.is_rigid(name)
    about: dict[str, Any] = {"name": name, "representation": item.representation}
    start_time = getattr(item, "start_time", 0.0)
    if "appearance" in wanted:
        about["color"], about["material"] = item.appearance.color, item.appearance.material
    if "shape" in wanted:
        if rigid:
            about["shape"] = world.object(name).shape.model_dump(mode="json")
        else:
            facts = about_deformable(world, world.deformable(name))
            about["shape"] = {k: v for k, v in facts.items() if k not in (*about, "color")}
    if "visibility" in wanted:
        about["joins_at_frame"] = round(start_time / world.time.seconds_per_frame, 2)
        if world.camera is not None and rigid:
            about["starts_in_view"] = bool(world.camera.sees(np.asarray(world.object(name).position)))
    if "parameters" in wanted:
        scalars = SCALARS if rigid else tuple(material_of(item).parameters)
        about["parameters"] = {key: _property(app, case, world, name, key) for key in scalars}
    if "initial_state" in wanted:
        state = ("position", "orientation", "velocity", "angular_velocity")
        about["initial_state"] = {"time": start_time, **{k: getattr(item, k) for k in state if hasattr(item, k)}}
    if "nodes" in wanted and name in [d.name for d in world.of_form("line", "sheet", "solid")]:
        about["nodes"] = nodes_of(world, world.deformable(name), most=40)
    return about


def _properties(world: World, name: str) -> list[str]:
    """Return what can be read of an object by a bare word."""
    if world.is_rigid(name):
        return [*SCALARS, *VECTORS, *LOOKS]
    item = world.deformable(name)
    vectors = [v for v in VECTORS if hasattr(item, v)]
    size = size_of(world, item)[0]
    return [size, "mass", *material_of(item).parameters, *vectors, *LOOKS]


def _property(app: App, case: Case, world: World, name: str, property: str) -> dict[str, Any]:
    item = world.item(name)
    if property not in _properties(world, name):
        raise ToolError(
            f"{name!r} ({item.representation}) has no property {property!r}; its properties: "
            f"{', '.join(_properties(world, name))}, or a path"
        )
    rigid = world.is_rigid(name)
    if not rigid and property in ("mass", *SIZES):
        return _size(world, world.deformable(name), property)
    if property in VECTORS:
        return _vector(app, case, world, item, property)
    if property in ("color", "material"):
        return {"value": getattr(item.appearance, property), "known": "observed or given"}
    if property == "shape":
        described = world.object(name).shape.model_dump(mode="json") if rigid else None
        shape = about_deformable(world, world.deformable(name)) if described is None else described
        return {"value": shape, "unit": "m", "known": "observed or given"}
    if property == "representation":
        return {"value": item.representation, "known": "chosen"}
    return _parameter(app, case, world, f"objects.{name}.{property}")


def _size(world: World, item: Deformable, property: str) -> dict[str, Any]:
    """Mass, or length, area or volume without forces, of a deformable object as it starts."""
    if property == "mass":
        unit = "kg/m" if size_of(world, item)[0] == "area" and material_of(item).form == "liquid" else "kg"
        return {"value": mass(world, item), "unit": unit, "known": "density times size"}
    word, value, unit = size_of(world, item)
    return {"value": value, "unit": unit, "known": f"{word} at rest, from its shape as given or observed"}


def _vector(app: App, case: Case, world: World, item: RigidObject | Deformable, property: str) -> dict[str, Any]:
    path = f"objects.{item.name}.{property}"
    axes = [knowledge(app, case, world, f"{path}.{axis}") for axis in "xyz"]
    known = next((own for own in axes if own.origin in ("edited", "assumed", "fitted")), axes[0])
    errors = [own.detail.get("standard_error") for own in axes]
    detail = {"standard_error": errors} if any(error is not None for error in errors) else {}
    at = getattr(item, "start_time", 0.0)
    unit = STATE_PARAMETERS[f"{property}.x"].unit
    return {"value": getattr(item, property), "unit": unit, "at": at, "known": known.origin, **detail}


def _parameter(app: App, case: Case, world: World, path: str) -> dict[str, Any]:
    with explained():
        value, spec = read_parameter(world, path), specification(world, path)
    known = knowledge(app, case, world, path)
    return {
        "path": path,
        "value": value,
        "unit": spec.unit,
        "bounds": [spec.lower, spec.upper],
        "known": known.origin,
        **known.detail,
    }


def _in_words(row: dict[str, Any]) -> str:
    value, error = row["value"], row.get("standard_error")
    if isinstance(value, float):
        unit = row.get("unit", "")
        text = f"{value:.4g}"
        if isinstance(error, float) and error > 0.0:  # as many decimals as two digits of the error have
            text = f"{value:.{max(0, 1 - math.floor(math.log10(error)))}f} ± {error:.2g}"
        text = text if unit in ("", "1") else f"{text} {unit}"
    elif isinstance(value, tuple | list):
        text = f"({', '.join(f'{v:.4g}' for v in value)}) {row.get('unit', '')}".rstrip()
    elif isinstance(value, dict):
        text = str(value.get("kind"))
    else:
        text = "left open" if value is None and "path" in row else str(value)
    doubt = ", not determined by the data" if row.get("undetermined") else ""
    return f"{row.get('object') or row.get('path')} {text} ({row['known']}{doubt})"


def _edits(world: World) -> list[str]:
    """The edits that have something to act on in this world."""
    always = ["remove", "add", "move", "set_velocity", "scale_velocity"]
    always += ["set_parameter", "scale_parameter", "environment"]
    return [*always, *(["toggle_effect"] if world.effects else []), *(["release"] if world.attachments else [])]


def _parameters(world: World, names: list[str]) -> dict[str, list[str]]:
    """The last words of parameter paths that set_parameter and FitWorld take, by their first words, without states.

    Those of motors set_parameter takes alone.
    """
    found: dict[str, list[str]] = {}
    for path in parameter_paths(world):
        grouped = path.count(".") == 2 or ".motor." in path
        head, _, tail = path.rpartition(".") if grouped else ("", "", "")
        if head.startswith("objects.") and head.split(".")[1] not in names:
            continue
        if head and not head.startswith("environment."):
            found.setdefault(head, []).append(tail)
    same: dict[str, list[str]] = {}
    for head, tails in found.items():  # objects of one kind have the same parameters: listed once
        same.setdefault(", ".join(tails), []).append(head)
    return {", ".join(heads): tails.split(", ") for tails, heads in same.items()}


def _predicates(world: World) -> list[str]:
    """The predicates that something in this world can answer."""
    found = ["in_contact", "collides", "moving", "at_rest", "inside_region", "above", "below", "nearer_than"]
    found += ["within_distance", "moved_by_more_than", "comes_to_rest", "passes_before", "reaches_before"]
    if world.camera is not None or world.region is not None:
        found.append("in_view")
    forms = {material_of(d).form for d in world.deformables}
    for predicate, about in ABOUT.items():
        if forms.intersection(about) and (predicate is not Holds or world.containers):
            found.append(str(predicate.model_fields["predicate"].default))
    return found
