"""Completion of the arguments of prompts and resource templates: ids of records, names of objects and of tools."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import anyio
from mcp.server import MCPServer
from mcp_types import (
    Completion,
    CompletionArgument,
    CompletionContext,
    PromptReference,
    ResourceTemplateReference,
)

from atw_mcp.calls.app import App
from evidence_store import Evidence, StoreError, UnknownRecord

MOST_COMPLETIONS = 100  # the protocol's limit
LATEST = 1000  # records of a case whose ids and objects are offered: completion is asked for at every key
Given = Mapping[str, str]  # the other arguments, as far as they are filled in


def register(server: MCPServer[Any], app: App) -> None:
    """Answer `completion/complete`."""

    async def complete(
        reference: PromptReference | ResourceTemplateReference,
        argument: CompletionArgument,
        context: CompletionContext | None,
    ) -> Completion:
        del reference
        given = (context.arguments if context is not None else None) or {}
        known = await anyio.to_thread.run_sync(known_values, app, argument.name, given)
        fitting = [value for value in known if value.startswith(argument.value)]
        return Completion(
            values=fitting[:MOST_COMPLETIONS], total=len(fitting), has_more=len(fitting) > MOST_COMPLETIONS
        )

    completion: Any = server.completion  # the SDK leaves it untyped
    completion()(complete)


def known_values(app: App, argument: str, given: Given) -> list[str]:
    """Return the values that an argument may take, latest first, of evidence those of the latest records; none for one
    whose values are free.

    given: values of other arguments; a case narrows the choice of what belongs to one.
    """
    if argument not in _VALUES:
        return []
    try:
        return list(dict.fromkeys(_VALUES[argument](app, given)))
    except (StoreError, ValueError):  # a case or record that does not exist, or is damaged, has nothing to offer
        return []


def _cases(app: App, given: Given) -> list[str]:
    if given.get("case"):
        return [app.store.cases.get(given["case"]).id]
    return [case.id for case in app.store.cases.all()[::-1]]


def _records(app: App, given: Given) -> Iterable[Evidence]:
    return (record for case in _cases(app, given) for record in app.store.evidence.search(case, limit=LATEST).records)


def _objects(app: App, given: Given) -> Iterable[str]:
    return (name for record in _records(app, given) for name in record.objects)


def _pictures(app: App, given: Given) -> list[str]:
    if not given.get("evidence"):
        return []
    try:
        return sorted(app.store.evidence.get(given["evidence"]).pictures)
    except UnknownRecord:
        return []


_VALUES: dict[str, Callable[[App, Given], Iterable[str]]] = {
    "case": lambda app, given: _cases(app, {key: value for key, value in given.items() if key != "case"}),
    "evidence": lambda app, given: (record.id for record in _records(app, given)),
    "world": lambda app, given: (w for case in _cases(app, given) for w, _ in app.store.cases.worlds(case)[::-1]),
    "rollout": lambda app, given: (record.rollout for record in _records(app, given) if record.rollout),
    "object": _objects,
    "name": _pictures,
    "tool": lambda app, given: (tool.name for tool in app.served),  # noqa: ARG005
}
