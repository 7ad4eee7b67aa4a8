"""Parts of a world beside its rigid bodies, as an agent writes them: one list of objects discriminated by `part`.

Ropes, cloth, soft bodies, fluids and what goes with them have some hundred fields. The list of tools shows their
names and types; `DescribeTool(tool='BuildWorld', argument='parts.rope')` gives units, defaults and meaning.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import ValidationError

from atw_mcp.calls.results import validation_text
from atw_mcp.calls.schemas import inlined, without_null
from atw_mcp.calls.spelling import did_you_mean
from polyworld.world.description import Description
from polyworld.world.materials import kinds, material
from polyworld.world.representations.attachment import Attachment
from polyworld.world.representations.fluid import Container, Drain, Emitter, FluidGrid
from polyworld.world.representations.joint import Ball, Fixed, Hinge, Joint, Slider, Spring
from polyworld.world.representations.rope import Pulley

_OTHERS: dict[str, type[Description]] = {
    "fluid_grid": FluidGrid,
    "emitter": Emitter,
    "drain": Drain,
    "container": Container,
    "attachment": Attachment,
    "pulley": Pulley,
    "hinge": Hinge,
    "slider": Slider,
    "ball": Ball,
    "fixed": Fixed,
    "spring": Spring,
}
JOINTS = ("hinge", "slider", "ball", "fixed", "spring")
TAGS = ("representation", "kind")  # fields of the engine's descriptions that `part` stands for
EXAMPLES: dict[str, str] = {
    "geometry": 'cloth: {"kind":"sheet","corner":[0,0,1],"edge_u":[1,0,0],"edge_v":[0,1,0],"divisions":[20,20]}, '
    'or {"kind":"mesh","vertices":[...],"faces":[...]}',
    "shape": 'soft: {"kind":"sphere","radius":0.1}, box: half_extents, cylinder, capsule: radius, half_height, '
    "convex_mesh: vertices, mesh: vertices, faces",
    "volumes": 'fluid: [{"shape":{"kind":"box","half_extents":[0.2,0.2,0.1]},"position":[0,0,0.1]}]',
    "motor": '{"target_speed":3,"limit":0.5}',
    "region": '{"lower":[x,y,z],"upper":[x,y,z]}',
}
COLOR = "colour name, or #rrggbb"
LONGEST = 10_000  # items of a list that the engine itself does not bound
EXAMPLE = {"part": "rope", "name": "cord", "points": [[0, 0, 2], [1, 0, 2]], "linear_density": 0.05}


@dataclass(frozen=True)
class Parts:
    """Parts that an agent described, in the engine's terms. Deformables are still as written: what is missing in them
    may have been observed."""

    deformables: tuple[dict[str, Any], ...] = ()
    joints: tuple[Joint, ...] = ()
    attachments: tuple[Attachment, ...] = ()
    pulleys: tuple[Pulley, ...] = ()
    fluid_grid: FluidGrid | None = None
    emitters: tuple[Emitter, ...] = ()
    drains: tuple[Drain, ...] = ()
    containers: tuple[Container, ...] = ()


def longest_step(parts: Parts) -> dict[str, float]:
    """Return the longest step [s] that liquids alone need, as TimeBase takes it; empty where other objects deform.

    Their grid does not resolve what moves across a part of a cell; at 5 m/s, faster than liquids of a table's size,
    this is a step a cell. Two scenes of `tests.benchmarks.examination_scenes` end within 1 cm at this step, as at half.
    """
    if parts.fluid_grid is None or any(not str(d["representation"]).startswith("fluid") for d in parts.deformables):
        return {}
    return {"substep": min(max(parts.fluid_grid.cell / 5.0, 0.002), 0.004)}


def part_kinds() -> dict[str, type[Description]]:
    """Kinds of parts and the engine's descriptions of them: objects of every registered material first."""
    return {**{kind: material(kind).description for kind in kinds()}, **_OTHERS}


def read_parts(given: Sequence[Any]) -> Parts:
    """Parts as written, checked one by one; raises ToolError naming the part, its field and what it takes."""
    found: dict[str, list[Any]] = {kind: [] for kind in part_kinds()}
    for number, item in enumerate(given, start=1):
        kind = _kind(item, number)
        fields = {key: value for key, value in item.items() if key != "part"}
        if kind in kinds():
            _known_fields(kind, fields, number)
            if "name" not in fields:
                raise ToolError(f"part {number} ({kind}): name is missing; {takes(kind)}. {_more(kind)}")
            if "color" in fields:
                fields["appearance"] = {"color": fields.pop("color")}
            found[kind].append({"representation": kind, **fields})
        else:
            found[kind].append(read_part(kind, fields, number))
    if len(found["fluid_grid"]) > 1:
        raise ToolError("give one fluid_grid: all fluids share it")
    return Parts(
        deformables=tuple(item for kind in kinds() for item in found[kind]),
        joints=tuple(joint for kind in JOINTS for joint in found[kind]),
        attachments=tuple(found["attachment"]),
        pulleys=tuple(found["pulley"]),
        fluid_grid=found["fluid_grid"][0] if found["fluid_grid"] else None,
        emitters=tuple(found["emitter"]),
        drains=tuple(found["drain"]),
        containers=tuple(found["container"]),
    )


def read_part(kind: str, fields: Mapping[str, Any], number: int | None = None) -> Any:
    """One part as the engine describes it; raises ToolError naming the field whose value is wrong."""
    what = f"part {number} ({kind})" if number is not None else f"{kind} {fields.get('name', '')!r}"
    _known_fields(kind, fields, number)
    model = part_kinds()[kind].model_fields
    missing = [name for name in _fields(kind) if name in model and model[name].is_required() and name not in fields]
    if missing:
        raise ToolError(f"{what}: {', '.join(missing)} is missing; {takes(kind)}. {_more(kind)}")
    try:
        return part_kinds()[kind].model_validate(fields)
    except ValidationError as error:
        raise ToolError(f"{what}: {validation_text(error)}. {_more(kind)}") from error


def takes(kind: str) -> str:
    """The fields of a kind of part in one phrase, optional ones in brackets."""
    fields = part_kinds()[kind].model_fields
    required = [name for name in _fields(kind) if name != "color" and fields[name].is_required()]
    optional = [name for name in _fields(kind) if name not in required]
    return f"{kind}({', '.join(required)}" + (f", [{', '.join(optional)}])" if optional else ")")


def parts_schema() -> dict[str, Any]:
    """The schema of one part, as a flat object: every field of every kind with its type, and which kind has which."""
    tag = {"type": "string", "enum": list(part_kinds()), "description": "kind of part"}
    properties: dict[str, Any] = {"part": tag}
    notes: dict[str, dict[str, list[str]]] = {}  # of each field: what it is, and in which kinds of parts
    for kind, model in part_kinds().items():
        for name, schema in without_null(inlined(model.model_json_schema()))["properties"].items():
            if name in TAGS:
                continue
            name, schema = ("color", {"type": "string"}) if name == "appearance" else (name, schema)
            about = COLOR if name == "color" else schema["description"].split(". ")[0].rstrip(".")
            notes.setdefault(name, {}).setdefault(about, []).append(kind)
            simple = _bare(schema)
            types = properties.setdefault(name, {"anyOf": [simple]})["anyOf"]
            if simple not in types:
                types.append(simple)
    for name, field in properties.items():
        if "anyOf" in field and len(field["anyOf"]) == 1:
            properties[name] = field["anyOf"][0]
        if name in notes:
            texts = [f"{', '.join(owners)}: {about}" for about, owners in notes[name].items()]
            properties[name]["description"] = "; ".join([*texts, *([EXAMPLES[name]] if name in EXAMPLES else [])])
    says = "; ".join(takes(kind) for kind in part_kinds())
    return {
        "type": "object",
        "additionalProperties": False,
        "required": ["part"],
        "properties": properties,
        "description": f"{says}. {_more('rope')}",
    }


def part_schema(kind: str) -> dict[str, Any]:
    """The full schema of one kind of part; raises ToolError naming the kinds."""
    if kind not in part_kinds():
        raise ToolError(f"no part {kind!r}{did_you_mean(kind, part_kinds())}; parts: {', '.join(part_kinds())}")
    schema = without_null(inlined(part_kinds()[kind].model_json_schema()))
    schema["properties"] = {
        "part": {"const": kind},
        **{key: value for key, value in schema["properties"].items() if key not in (*TAGS, "appearance")},
    }
    if kind in kinds():
        schema["properties"]["color"] = {"type": "string", "description": COLOR}
    return schema


def part_field_schema(kind: str, field: str) -> dict[str, Any]:
    """The full schema of one field of a kind of part; raises ToolError naming the kinds or the fields."""
    properties = part_schema(kind)["properties"]
    if field not in properties:
        raise ToolError(f"{kind} has no {field}{did_you_mean(field, properties)}; fields: {', '.join(properties)}")
    schema: dict[str, Any] = properties[field]
    return schema


def _kind(item: Any, number: int) -> str:
    if not isinstance(item, Mapping) or "part" not in item:
        raise ToolError(
            f"part {number} needs 'part', one of {', '.join(part_kinds())}, for example {json.dumps(EXAMPLE)}; "
            f"got {item!r}"
        )
    kind, known = str(item["part"]), part_kinds()
    if kind not in known:
        raise ToolError(f"part {number}: no part {kind!r}{did_you_mean(kind, known)}; parts: {', '.join(known)}")
    return kind


def _known_fields(kind: str, fields: Mapping[str, Any], number: int | None) -> None:
    known = _fields(kind)
    # A deformable may also come as it stands in a world.
    allowed = {*known, "representation", "appearance"} if kind in kinds() else set(known)
    unknown = [str(name) for name in fields if name not in allowed]
    if unknown:
        hint = did_you_mean(unknown[0], known)
        what = f"part {number} ({kind})" if number is not None else kind
        raise ToolError(f"{what} has no {', '.join(unknown)}{hint}; {takes(kind)}")


def _fields(kind: str) -> list[str]:
    """Names of the fields of a kind of part, as an agent writes them."""
    names = [name for name in part_kinds()[kind].model_fields if name not in TAGS]
    return ["color" if name == "appearance" else name for name in names]


def _more(kind: str) -> str:
    return f"DescribeTool(tool='BuildWorld', argument='parts.{kind}') gives units, defaults and meaning"


def _bare(schema: dict[str, Any]) -> dict[str, Any]:
    """A type without bounds of numbers, defaults and the inside of nested objects."""
    if "oneOf" in schema or "properties" in schema:
        return {"type": "object"}
    if "anyOf" in schema:
        return _bare(schema["anyOf"][0])
    if schema.get("type") == "array":
        room = {key: value for key, value in schema.items() if key in ("minItems", "maxItems")}
        return {"type": "array", "items": _bare(schema.get("items", {})), "maxItems": LONGEST, **room}
    if schema.get("type") == "integer":
        return {"type": "integer", "minimum": schema.get("minimum", 0)}
    if "enum" in schema:
        return {"type": "string", "enum": schema["enum"]}
    return {"type": schema["type"]}
