"""World inspection: what a world contains and how well its numbers are known."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from atw_mcp.app import App
from atw_mcp.names import chosen_names
from atw_mcp.provenance import knowledge, lineage
from atw_mcp.results import Answer, explained
from atw_mcp.toolbox import ToolGroup
from evidence_store import Case
from polyworld.effects import CATALOGUE
from polyworld.parameter_tables import OBJECT_PARAMETERS, STATE_PARAMETERS
from polyworld.parameters import read_parameter, specification
from polyworld.world import World

GROUP = ToolGroup("world inspection")

CaseId = Annotated[str, Field(description="case id, as OpenCase returned it")]
WorldId = Annotated[str | None, Field(description="world id; default: the committed world, else the latest draft")]
Objects = Annotated[list[str] | None, Field(description="names of objects; default: all", max_length=64)]

LOOKS = ("shape", "color", "material", "representation")
VECTORS = ("position", "velocity", "angular_velocity")
SCALARS = tuple(OBJECT_PARAMETERS)
SHOWN_OTHERWISE = {"objects", "statics", "environment", "effects", "time", "camera"}


@GROUP.tool("InspectWorld", title="Inspect a world")
def inspect_world(
    app: App,
    case: CaseId,
    world: WorldId = None,
    objects: Objects = None,
    fields: Annotated[
        list[Literal["appearance", "shape", "parameters", "initial_state", "visibility"]] | None,
        Field(description="what to tell about each object; default: appearance, shape, visibility", max_length=5),
    ] = None,
) -> Answer:
    """What a world contains: objects with their looks, shape and visibility, statics, effects, gravity, time base, what
    it descends from, and which edits and predicates it supports. ReadProperty tells how well a number is known."""
    found_case = app.case(case)
    found = app.world(found_case, world)
    names = chosen_names(app, found_case, objects, [item.name for item in found.objects])
    wanted = fields or ["appearance", "shape", "visibility"]
    frame = found.time.seconds_per_frame
    stage = (
        "committed" if found.id == found_case.committed_world else "branch" if found_case.committed_world else "draft"
    )
    effects = ", ".join(effect.name for effect in found.effects if effect.enabled)
    return Answer(
        summary=f"{stage} world {found.id}: {len(found.objects)} {'planar' if found.planar else 'spatial'} objects "
        f"({', '.join(item.name for item in found.objects)}), {len(found.statics)} statics"
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
                "edits": [
                    "remove",
                    "add",
                    "move",
                    "set_velocity",
                    "set_parameter",
                    "toggle_effect",
                    "environment",
                ],
                "predicates": _predicates(found),
                "effects_that_can_be_added": list(CATALOGUE),
            },
        },
        case=found_case.id,
        world=found.id,
        objects=tuple(names),
    )


@GROUP.tool("ReadProperty", title="Read a property")
def read_property(
    app: App,
    case: CaseId,
    property: Annotated[
        str,
        Field(
            description=f"an object's {', '.join((*SCALARS, *VECTORS, *LOOKS))}, for the objects given; or a "
            "parameter path such as objects.red.friction, environment.gravity.z, effects.air.coefficient, "
            "time.seconds_per_frame",
            min_length=1,
            max_length=200,
        ),
    ],
    objects: Objects = None,
    world: WorldId = None,
) -> Answer:
    """Read a physical property from a world without running it: value, unit, and how it is known. fitted values come
    with their standard error; observed ones were read off the tracks; given or default ones were never inferred from
    the video, so they are no evidence about it; edited ones were set in a branch. A contact's friction and restitution
    are each the geometric mean of both bodies' values, or the object's own where a static has none."""
    found_case = app.case(case)
    found = app.world(found_case, world)
    if "." in property:
        if objects is not None:
            raise ToolError(f"{property!r} is a whole path: leave objects out, or give the bare property")
        rows = [_parameter(app, found_case, found, property)]
        names = [property.split(".")[1]] if property.startswith("objects.") else []
    else:
        names = chosen_names(app, found_case, objects, [item.name for item in found.objects])
        rows = [{"object": name, **_property(app, found_case, found, name, property)} for name in names]
    return Answer(
        summary=f"{property}: " + "; ".join(_told(row) for row in rows),
        data={"property": property, "values": rows},
        case=found_case.id,
        world=found.id,
        objects=tuple(names),
    )


def _about(app: App, case: Case, world: World, name: str, wanted: list[Any]) -> dict[str, Any]:
    item = world.object(name)
    about: dict[str, Any] = {"name": name, "representation": item.representation}
    if "appearance" in wanted:
        about["color"], about["material"] = item.appearance.color, item.appearance.material
    if "shape" in wanted:
        about["shape"] = item.shape.model_dump(mode="json")
    if "visibility" in wanted:
        start = item.start_time / world.time.seconds_per_frame
        about["joins_at_frame"] = round(start, 2)
        if world.camera is not None:
            about["starts_in_view"] = bool(world.camera.sees(np.asarray(item.position)))
    if "parameters" in wanted:
        about["parameters"] = {key: _property(app, case, world, name, key) for key in SCALARS}
    if "initial_state" in wanted:
        about["initial_state"] = {
            "time": item.start_time,
            "position": item.position,
            "orientation": item.orientation,
            "velocity": item.velocity,
            "angular_velocity": item.angular_velocity,
        }
    return about


def _property(app: App, case: Case, world: World, name: str, property: str) -> dict[str, Any]:
    item = world.object(name)
    if property in SCALARS:
        return _parameter(app, case, world, f"objects.{name}.{property}")
    if property in VECTORS:
        known = knowledge(app, case, world, f"objects.{name}.{property}.x")
        errors = [
            knowledge(app, case, world, f"objects.{name}.{property}.{axis}").detail.get("standard_error")
            for axis in "xyz"
        ]
        detail = {"standard_error": errors} if any(error is not None for error in errors) else {}
        unit = STATE_PARAMETERS[f"{property}.x"].unit
        return {"value": getattr(item, property), "unit": unit, "at": item.start_time, "known": known.origin, **detail}
    if property in ("color", "material"):
        return {"value": getattr(item.appearance, property), "known": "observed or given"}
    if property == "shape":
        return {"value": item.shape.model_dump(mode="json"), "unit": "m", "known": "observed or given"}
    if property == "representation":
        return {"value": item.representation, "known": "chosen"}
    raise ToolError(f"no property {property!r}; properties: {', '.join((*SCALARS, *VECTORS, *LOOKS))}, or a path")


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


def _told(row: dict[str, Any]) -> str:
    value = row["value"]
    if isinstance(value, float):
        unit = row.get("unit", "")
        text = f"{value:.4g}" if unit in ("", "1") else f"{value:.4g} {unit}"
    elif isinstance(value, tuple | list):
        text = f"({', '.join(f'{v:.4g}' for v in value)}) {row.get('unit', '')}".rstrip()
    elif isinstance(value, dict):
        text = str(value.get("kind"))
    else:
        text = "left to the touching object" if value is None and "path" in row else str(value)
    error = row.get("standard_error")
    sigma = f" ± {error:.2g}" if isinstance(error, float) else ""
    doubt = ", not determined by the data" if row.get("undetermined") else ""
    return f"{row.get('object') or row.get('path')} {text}{sigma} ({row['known']}{doubt})"


def _predicates(world: World) -> list[str]:
    always = ["in_contact", "collides", "moving", "at_rest", "inside_region", "above", "below", "nearer_than"]
    view = ["in_view"] if world.camera is not None or world.region is not None else []
    return [*always, "passes_before", *view]
