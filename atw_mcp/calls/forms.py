"""Edits and predicates as an agent writes them, read into their exact types with refusals in plain words."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, get_args

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import BaseModel, ValidationError

from atw_mcp.calls.error_text import LIMITS, and_more, short_repr, without_middle
from atw_mcp.calls.results import validation_text
from atw_mcp.calls.spelling import did_you_mean


def tagged(given: Any, union: Any, tag: str, *, what: str, example: Mapping[str, Any]) -> Mapping[str, Any]:
    """The same, found to be an object that names one of the union's forms and takes no field this one lacks.

    what: how a refusal calls it. Raises ToolError naming the forms or the fields there are.
    """
    shown = f"for example {json.dumps(example)}"
    if not isinstance(given, Mapping):
        raise ToolError(f"{what} is written as an object, {shown}; got {short_repr(given)}")
    forms = _forms(union, tag)
    kind = given.get(tag)
    if kind is None:
        raise ToolError(f"{what} needs {tag!r}, one of {', '.join(forms)}; {shown}")
    if not isinstance(kind, str) or kind not in forms:
        near = did_you_mean(kind, forms) if isinstance(kind, str) else ""
        raise ToolError(f"{what}: no {tag} {short_repr(kind)}{near}; there are {', '.join(forms)}")
    fields = {name: field for name, field in forms[kind].model_fields.items() if name != tag}
    takes = f"{kind} takes " + ", ".join(name if field.is_required() else f"[{name}]" for name, field in fields.items())
    unknown = [str(name) for name in given if name != tag and name not in fields]
    if unknown:
        named = ", ".join(without_middle(name, LIMITS.quoted) for name in unknown[: LIMITS.findings])
        raise ToolError(f"{what}: {takes}; not {named}{and_more(len(unknown) - LIMITS.findings)}")
    missing = [name for name, field in fields.items() if field.is_required() and name not in given]
    if missing:
        raise ToolError(f"{what}: {takes}; {', '.join(missing)} is missing")
    return given


def read_form(given: Mapping[str, Any], union: Any, tag: str, *, what: str) -> Any:
    """The exact type of what `tagged` has passed; raises ToolError naming the field whose value is wrong."""
    form = _forms(union, tag)[given[tag]]
    try:
        return form.model_validate(given)
    except ValidationError as error:
        raise ToolError(f"{what}: {given[tag]}: {validation_text(error)}") from error


def _forms(union: Any, tag: str) -> dict[str, type[BaseModel]]:
    return {form.model_fields[tag].default: form for form in get_args(get_args(union)[0])}
