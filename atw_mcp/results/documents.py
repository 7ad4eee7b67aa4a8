"""Documents inside results: parts of worlds, edits and statements, as they are written in arguments."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import TypeAdapter, WithJsonSchema

from atw_mcp.calls.flat_unions import flat_schema
from atw_mcp.calls.schemas import inlined
from atw_mcp.results.values import DOCUMENT
from polyworld.edits.interventions import Intervention
from polyworld.probing.predicates import Predicate
from polyworld.probing.readouts import Readout
from polyworld.world import Effect, Environment, Region, StaticObject
from polyworld.world.observer import Observer
from polyworld.world.representations.attachment import Attachment
from polyworld.world.representations.fluid import Container, Drain, Emitter, FluidGrid
from polyworld.world.representations.joint import Joint
from polyworld.world.representations.rope import Pulley
from polyworld.world.shapes import BodyShape

KEPT = ("type", "items", "enum", "const", "required", "additionalProperties", "description", "anyOf", "oneOf")
MOST_FIXED = 4  # numbers of a vector, quaternion or pair: longer lists have no fixed length in a result


def lean(union: Any) -> WithJsonSchema:
    """Return the schema of what a world is written with, to be read and not written.

    Each choice among forms is one object, whose field is required where all forms have it. Results leave out what is
    null; bounds are left out, but of the length of vectors, since lists may be cut to fit.
    """
    return WithJsonSchema(_lean(inlined(TypeAdapter(union).json_schema())))


def _lean(schema: Any) -> Any:
    if isinstance(schema, list):
        return [_lean(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    found = {key: _lean(part) for key, part in schema.items() if key in KEPT and key != "properties"}
    if "properties" in schema:
        found["properties"] = {name: _lean(part) for name, part in schema["properties"].items()}
    if "description" in found:
        found["description"] = " ".join(str(schema["description"]).split("\n\n")[0].split())
    length = schema.get("maxItems")
    if length == schema.get("minItems", 0) <= MOST_FIXED:
        found |= {"minItems": length, "maxItems": length}
    choices = [choice for choice in found.pop("anyOf", []) if choice != {"type": "null"}]
    if choices:
        return {**choices[0], **found} if len(choices) == 1 else {**found, "anyOf": choices}
    forms = found.pop("oneOf", None)
    return found if forms is None else {**_merged(forms), **found}


def _merged(forms: list[dict[str, Any]]) -> dict[str, Any]:
    """One object for several, distinguished by a constant field."""
    properties: dict[str, Any] = {}
    for name, part in [item for form in forms for item in form["properties"].items()]:
        known = properties.setdefault(name, part)
        if "const" in part:
            choices = [*known.get("enum", []), part["const"]]
            properties[name] = {"type": "string", "enum": choices}
        elif known.get("type") != part.get("type"):
            properties[name] = {"anyOf": [*known.get("anyOf", [known]), part]}
    tags = {name for name, part in properties.items() if all("const" in f["properties"].get(name, {}) for f in forms)}
    common = set.intersection(*(set(form.get("required", [])) for form in forms)) | tags
    return {
        "type": "object",
        "additionalProperties": False,
        "required": [name for name in properties if name in common],
        "properties": properties,
    }


def _edit_schema() -> dict[str, Any]:
    """Schema of an edit as one object; what it adds is a document, and the argument `edits` describes the fields."""
    flat = flat_schema(Intervention, "action")
    named = {name: _without_words(part) for name, part in flat["properties"].items()}
    return {**flat, "properties": named, "description": "an edit, written as in the argument edits of Rollout"}


def _without_words(schema: dict[str, Any]) -> dict[str, Any]:
    if "anyOf" in schema:
        return {"anyOf": [_without_words(choice) for choice in schema["anyOf"]]}
    bare = {key: part for key, part in schema.items() if key != "description"}
    return {**bare, "description": DOCUMENT} if bare == {"type": "object"} else bare


Edit = Annotated[Intervention, WithJsonSchema(_edit_schema())]
Statement = Annotated[Predicate, lean(Predicate)]
Reading = Annotated[Readout, lean(Readout)]
ShapeOfBody = Annotated[BodyShape, lean(BodyShape)]
StaticPart = Annotated[StaticObject, lean(StaticObject)]
EnvironmentPart = Annotated[Environment, lean(Environment)]
EffectPart = Annotated[Effect, lean(Effect)]
JointPart = Annotated[Joint, lean(Joint)]
AttachmentPart = Annotated[Attachment, lean(Attachment)]
PulleyPart = Annotated[Pulley, lean(Pulley)]
FluidGridPart = Annotated[FluidGrid, lean(FluidGrid)]
EmitterPart = Annotated[Emitter, lean(Emitter)]
DrainPart = Annotated[Drain, lean(Drain)]
ContainerPart = Annotated[Container, lean(Container)]
RegionPart = Annotated[Region, lean(Region)]
ObserverPart = Annotated[Observer, lean(Observer)]
