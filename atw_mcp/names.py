"""Names as agents use them: an object's own, one that UpdateBindings has tied to it, or its own written otherwise."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from typing import Any

from mcp.server.mcpserver.exceptions import ToolError

from atw_mcp.app import App
from evidence_store import Case
from polyworld.world import World

NAME_FIELDS = ("object", "a", "b")  # of edits and predicates


def object_name(app: App, case: Case, name: str, known: Sequence[str]) -> str:
    """The one of `known` that a name means; raises ToolError naming them where it means none."""
    meant = _meant(app, case, name, known)
    if meant is not None:
        return meant
    close = difflib.get_close_matches(_plain(name), known, n=1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    raise ToolError(f"no object {name!r}{hint}; objects: {list(known)}. UpdateBindings ties other names to them")


def chosen_names(app: App, case: Case, names: Sequence[str] | None, known: Sequence[str]) -> list[str]:
    """The objects meant by `names`, default all of `known`; raises ToolError for an unknown or empty choice."""
    if names is None:
        return list(known)
    if not names:
        raise ToolError(f"objects is empty: leave it out for all of them, or choose among {list(known)}")
    return list(dict.fromkeys(object_name(app, case, name, known) for name in names))


def with_own_names(app: App, case: Case, world: World, item: Mapping[str, Any]) -> dict[str, Any]:
    """An edit or a predicate with names replaced by the world's own; those that mean nothing are left as they are.

    Raises ToolError for text that could not be the name of any object.
    """
    known = [o.name for o in world.objects] + [s.name for s in world.statics]
    changed = dict(item)
    for field in NAME_FIELDS:
        name = item.get(field)
        if isinstance(name, str):
            could_be = re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_\-]*", name)
            meant = _meant(app, case, name, known) if could_be else object_name(app, case, name, known)
            changed[field] = meant or name
    return changed


def _meant(app: App, case: Case, name: str, known: Sequence[str]) -> str | None:
    if name in known:
        return name
    binding = app.store.cases.bindings(case.id).get(name)
    if binding is not None:
        for bound in (binding.object, binding.track):
            if bound in known:
                return str(bound)
    alike = [own for own in known if _plain(own) == _plain(name)]  # "Red cylinder" for red_cylinder
    return alike[0] if len(alike) == 1 else None


def _plain(name: str) -> str:
    return "_".join(name.lower().replace("-", " ").replace("_", " ").split())
