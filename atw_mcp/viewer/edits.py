"""Interventions in the words of whoever looks at a branch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from atw_mcp.viewer.document import EditWords

MOST = 4  # edits, or objects, that a label names
PARTS = ("object", "deformable", "static", "joint", "attachment", "pulley", "emitter", "drain", "container")


def edit_words(edit: Mapping[str, Any]) -> EditWords:
    """Return one edit, as a branch's record has it, in a few words."""
    action = str(edit.get("action", "edit"))
    name = edit.get("object") if isinstance(edit.get("object"), str) else None
    text = action.replace("_", " ")
    if action == "remove":
        text = f"without {name}"
    elif action == "add":
        added: Mapping[str, Any] = next((edit[part] for part in PARTS if isinstance(edit.get(part), Mapping)), {})
        name = str(added.get("name", "")) or None
        text = f"with {name or 'one more part'}"
    elif action == "move":
        text = f"{name} moved"
        if edit.get("position") is not None:
            text = f"{name} at {_vector(edit['position'])} m"
        elif edit.get("shift") is not None:
            text = f"{name} moved by {_vector(edit['shift'])} m"
        elif edit.get("turn") is not None or edit.get("orientation") is not None:
            text = f"{name} turned"
    elif action == "set_velocity":
        given = edit.get("velocity")
        text = f"{name} at {_vector(given)} m/s" if given is not None else f"{name} with another spin"
    elif action == "scale_velocity":
        text = f"{name} {float(edit.get('factor', 1.0)):.4g} times as fast"
    elif action == "set_parameter":
        text = f"{_path(edit)} = {float(edit['value']):.4g}"
    elif action == "scale_parameter":
        text = f"{_path(edit)} times {float(edit['factor']):.4g}"
    elif action == "toggle_effect":
        text = f"{'with' if edit.get('enabled') else 'without'} {edit.get('effect')}"
    elif action == "release":
        when = edit.get("time")
        text = f"{edit.get('attachment')} released" + ("" if when is None else f" at {float(when):.4g} s")
    elif action == "environment":
        text = _surroundings(edit)
    return EditWords(action=action, object=name, text=text)


def branch_label(edits: Sequence[EditWords]) -> str:
    """Return a branch's edits as a title: those of one kind together, starts of objects last."""
    gone = [edit.object for edit in edits if edit.action == "remove" and edit.object]
    moved = [edit.object for edit in edits if edit.action == "move" and edit.object]
    thrown = [edit.object for edit in edits if edit.action in ("set_velocity", "scale_velocity") and edit.object]
    others = [edit.text for edit in edits if edit.object not in (*gone, *moved, *thrown) or edit.object is None]
    if len(edits) == 1:
        return edits[0].text
    parts = [f"without {_named(gone)}"] if gone else []
    parts += others[:MOST] + ([f"{len(others) - MOST} more edits"] if len(others) > MOST else [])
    if moved and set(moved) == set(thrown):
        return "; ".join([*parts, f"{_named(moved)} with another start"])
    parts += [f"{_named(moved)} moved"] if moved else []
    return "; ".join(parts + ([f"{_named(thrown)} with another velocity"] if thrown else []))


def _named(objects: Sequence[str]) -> str:
    names = list(dict.fromkeys(objects))
    return (
        ", ".join(names) if len(names) <= MOST else f"{', '.join(names[: MOST - 1])} and {len(names) - MOST + 1} more"
    )


def _surroundings(edit: Mapping[str, Any]) -> str:
    units = {"gravity": "m/s^2", "wind": "m/s", "air_density": "kg/m^3"}
    words = []
    for field, value in edit.items():
        if field == "action" or value is None:
            continue
        shown = _vector(value) if isinstance(value, Sequence) else f"{float(value):.4g}"
        words.append(f"{field.replace('_', ' ')} {shown} {units.get(field, '')}".strip())
    return ", ".join(words) or "other surroundings"


def _path(edit: Mapping[str, Any]) -> str:
    return str(edit.get("path", "")).removeprefix("objects.")


def _vector(values: Any) -> str:
    return "(" + ", ".join(f"{float(value):.3g}" for value in values) + ")"
