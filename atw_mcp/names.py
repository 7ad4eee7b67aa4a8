"""Names as agents use them: an object's own, or one that UpdateBindings has tied to it."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import TypeVar

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import BaseModel

from atw_mcp.app import App
from evidence_store import Case
from polyworld.world import World

Edit = TypeVar("Edit", bound=BaseModel)

NAME_FIELDS = ("object", "a", "b")


def object_name(app: App, case: Case, name: str, known: Sequence[str]) -> str:
    """The one of `known` that a name means; raises ToolError naming them where it means none."""
    if name in known:
        return name
    binding = app.store.cases.bindings(case.id).get(name)
    if binding is not None:
        for bound in (binding.object, binding.track):
            if bound in known:
                return str(bound)
    close = difflib.get_close_matches(name, known, n=1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    raise ToolError(f"no object {name!r}{hint}; objects: {list(known)}. UpdateBindings ties other names to them")


def chosen_names(app: App, case: Case, names: Sequence[str] | None, known: Sequence[str]) -> list[str]:
    """The objects meant by `names`, default all of `known`; raises ToolError for an unknown or empty choice."""
    if names is None:
        return list(known)
    if not names:
        raise ToolError(f"objects is empty: leave it out for all of them, or choose among {list(known)}")
    return list(dict.fromkeys(object_name(app, case, name, known) for name in names))


def renamed(app: App, case: Case, world: World, item: Edit) -> Edit:
    """An edit or a predicate with bound names replaced by the world's own; unknown names are left as they are."""
    known = {o.name for o in world.objects} | {s.name for s in world.statics}
    bindings = app.store.cases.bindings(case.id)
    changes = {}
    for field in NAME_FIELDS:
        name = getattr(item, field, None)
        if isinstance(name, str) and name not in known and name in bindings and bindings[name].object in known:
            changes[field] = bindings[name].object
    return item.model_copy(update=changes) if changes else item
