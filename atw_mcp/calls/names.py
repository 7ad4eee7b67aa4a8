"""Names as agents use them: an object's own, one that UpdateBindings has tied to it, or its own written otherwise."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field, create_model

from atw_mcp.calls.app import App
from atw_mcp.calls.questions import Question
from atw_mcp.calls.spelling import did_you_mean
from evidence_store import Case

if TYPE_CHECKING:
    from polyworld.world import World

NAME_FIELDS = ("object", "a", "b")  # of edits and predicates
MOST_ASKED = 30  # objects that a person is asked to choose among
# Parts of a world that an edit may remove by name although they are no objects.
CONNECTING = ("joints", "attachments", "pulleys", "emitters", "drains", "containers")


def object_name(app: App, case: Case, name: str, known: Sequence[str]) -> str:
    """The one of `known` that a name means; raises ToolError naming them where it means none."""
    meant = _meant(app, case, name, known)
    if meant is not None:
        return meant
    refusal = (
        f"no object {name!r}{did_you_mean(_plain(name), known)}; objects: {list(known)}. "
        "UpdateBindings ties other names to them"
    )
    if not 2 <= len(known) <= MOST_ASKED:
        raise ToolError(refusal)
    choice: Any = (Literal[tuple(known)], Field(title="Object", description="that is meant"))
    form = create_model("Meant", object=choice)
    raise Question(
        refusal,
        f"Which object of case {case.id!r} is meant by {name!r}?",
        form,
        lambda arguments, meant: _replaced(arguments, name, meant.object),
    )


def _replaced(value: Any, name: str, by: str) -> Any:
    """Arguments with a name replaced wherever it stands alone."""
    if isinstance(value, dict):
        return {key: _replaced(item, name, by) for key, item in value.items()}
    if isinstance(value, list):
        return [_replaced(item, name, by) for item in value]
    return by if value == name else value


def chosen_names(app: App, case: Case, names: Sequence[str] | None, known: Sequence[str]) -> list[str]:
    """The objects meant by `names`, default all of `known`; raises ToolError for an unknown or empty choice."""
    if names is None:
        return list(known)
    if not names:
        raise ToolError(f"objects is empty: leave it out for all of them, or choose among {list(known)}")
    return list(dict.fromkeys(object_name(app, case, name, known) for name in names))


def with_own_names(
    app: App, case: Case, world: World, item: Mapping[str, Any], added: Collection[str] = ()
) -> dict[str, Any]:
    """An edit or a predicate with names replaced by the world's own.

    Left as it is: a name of `added`, and one that is not in this world but in another of the case, such as the
    one it was removed from. Raises ToolError with the names there are for a name that means nothing in the case.
    """
    known = [*world.moving_names, *(s.name for s in world.statics)]
    parts = {x.name for part in CONNECTING for x in getattr(world, part)}
    changed = dict(item)
    for field in NAME_FIELDS:
        name = item.get(field)
        if not isinstance(name, str):
            continue  # reading the form refuses it
        if item.get("action") == "remove" and name in parts and (name not in known or item.get("part") is not None):
            continue
        if name not in added:
            changed[field] = _meant(app, case, name, known) or _of_another_world(app, case, name)
            if changed[field] is None:
                removable = sorted(parts) if item.get("action") == "remove" else []
                object_name(app, case, name, [*known, *removable])
    return changed


def case_hint(app: App) -> str:
    """How a hint writes the case argument where it is not known which case is meant."""
    cases = [case.id for case in app.store.cases.all()]
    return repr(cases[0]) if len(cases) == 1 else f"CASE, one of {cases}" if cases else "CASE"


def _of_another_world(app: App, case: Case, name: str) -> str | None:
    worlds = [app.world(case, identifier) for identifier, _ in app.store.cases.worlds(case.id)]
    known = [name for w in worlds for name in [*w.moving_names, *(s.name for s in w.statics)]]
    return _meant(app, case, name, list(dict.fromkeys(known)))


def _meant(app: App, case: Case, name: str, known: Sequence[str]) -> str | None:
    if name in known:
        return name
    binding = app.store.cases.bindings(case.id).get(name)
    if binding is not None:
        for bound in (binding.object, binding.track):
            if bound in known:
                return str(bound)
    equal = [own for own in known if _plain(own) == _plain(name)]  # "Red cylinder" for red_cylinder
    return equal[0] if len(equal) == 1 else None


def _plain(name: str) -> str:
    return "_".join(name.lower().replace("-", " ").replace("_", " ").split())
