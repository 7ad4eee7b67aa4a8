"""Evidence that clients wait for without asking: notifications when its work moves on or ends.

Handshake era: `resources/subscribe` on atw://evidence/ID. 2026-07-28: `subscriptions/listen`, for resources and,
with the tasks extension, for tasks.
"""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, cast

import anyio
from mcp.server import MCPServer
from mcp.server.context import ServerRequestContext
from mcp.server.mcpserver.server import require_client_extension
from mcp.server.session import ServerSession
from mcp.server.subscriptions import SUBSCRIPTION_ID_META_KEY, ListenHandler
from mcp.shared.exceptions import MCPError
from mcp_types import (
    INVALID_PARAMS,
    EmptyResult,
    Notification,
    RequestId,
    ResourceUpdatedNotification,
    ResourceUpdatedNotificationParams,
    ServerNotification,
    SubscribeRequestParams,
    SubscriptionFilter,
    SubscriptionsAcknowledgedNotification,
    SubscriptionsListenRequestParams,
    SubscriptionsListenResult,
    UnsubscribeRequestParams,
)

from atw_mcp.calls import tasks
from evidence_store import EvidenceStore, StoreError

EVIDENCE = "atw://evidence/"
LOOK = 0.5  # [s] between two looks at the store, where other processes report too
MOST_WATCHED = 256  # records of one server at a time: each look reads them all

logger = logging.getLogger(__name__)
Context = ServerRequestContext[Any, Any]
Listener = Callable[[str], Awaitable[None]]


@dataclass
class _Watched:
    """One record that one listener waits for. seen: status and progress at the last look."""

    evidence: str
    listener: Listener
    seen: tuple[Any, ...] | None = None


class EvidenceWatch:
    """Looks at the evidence that somebody listens for and reports its changes."""

    def __init__(self, store: EvidenceStore) -> None:
        self._store = store
        self._watched: list[_Watched] = []
        self._wanted = anyio.Event()
        self._turn = anyio.Lock()

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Watch for as long as the context lasts."""
        async with anyio.create_task_group() as group:
            group.start_soon(self._run)
            yield
            group.cancel_scope.cancel()

    def watch(self, evidence: str, listener: Listener) -> Callable[[], None]:
        """Call `listener` with the status of a record now and whenever status or progress change, until it has ended.

        Returns a function that stops it. Raises MCPError where too many records are watched.
        """
        if len(self._watched) >= MOST_WATCHED:
            raise MCPError(code=INVALID_PARAMS, message=f"{MOST_WATCHED} records are watched already, no more are")
        watched = _Watched(evidence, listener)
        self._watched.append(watched)
        self._wanted.set()

        def stop() -> None:
            if watched in self._watched:
                self._watched.remove(watched)

        return stop

    async def _run(self) -> None:
        async with self._turn:  # a server with several connections in one process enters `running` for each
            while True:
                if not self._watched:
                    self._wanted = anyio.Event()
                    await self._wanted.wait()
                states = await anyio.to_thread.run_sync(self._states, {watched.evidence for watched in self._watched})
                for watched in list(self._watched):
                    await self._report(watched, states.get(watched.evidence))
                await anyio.sleep(LOOK)

    async def _report(self, watched: _Watched, state: tuple[Any, ...] | None) -> None:
        if state is None or state == watched.seen or watched not in self._watched:
            return
        watched.seen = state
        if state[0] != "running":
            self._watched.remove(watched)
        try:
            await watched.listener(state[0])
        except Exception:  # one client that is gone must not end the notifications of the others
            logger.warning("could not notify a client of %s", watched.evidence, exc_info=True)

    def _states(self, evidence: Iterable[str]) -> dict[str, tuple[Any, ...]]:
        found: dict[str, tuple[Any, ...]] = {}
        for identifier in evidence:
            try:
                status = self._store.read_evidence(identifier).status
                job = self._store.jobs.get(identifier) if status == "running" else None
            except StoreError:  # not there yet, or the store is busy: the next look decides
                continue
            found[identifier] = (status,) if job is None else (status, job.done, job.message)
        return found


def register(server: MCPServer[Any], app: Any) -> None:
    """Serve `resources/subscribe`, `resources/unsubscribe` and `subscriptions/listen` for evidence and tasks."""
    lowlevel = server._lowlevel_server  # the SDK has no public way to serve subscriptions to resources
    lowlevel.add_request_handler("resources/subscribe", SubscribeRequestParams, partial(_subscribe, app))
    lowlevel.add_request_handler("resources/unsubscribe", UnsubscribeRequestParams, _unsubscribe)
    listen = partial(_listen, app, ListenHandler(server._subscriptions))
    lowlevel.add_request_handler("subscriptions/listen", SubscriptionsListenRequestParams, listen)


# --- handshake era ---


async def _subscribe(app: Any, context: Context, params: SubscribeRequestParams) -> EmptyResult:
    uri, session = str(params.uri), context.session
    subscriptions = _subscriptions(context)
    if not uri.startswith(EVIDENCE) or uri in subscriptions:
        return EmptyResult()  # the other resources never change

    async def ready(status: str) -> None:
        if status != "running":
            await session.send_resource_updated(uri)

    try:
        await anyio.to_thread.run_sync(app.store.read_evidence, uri.removeprefix(EVIDENCE))
    except StoreError as error:
        raise MCPError(code=INVALID_PARAMS, message=str(error), data={"uri": uri}) from error
    subscriptions[uri] = app.watch.watch(uri.removeprefix(EVIDENCE), ready)
    return EmptyResult()


async def _unsubscribe(context: Context, params: UnsubscribeRequestParams) -> EmptyResult:
    stop = _subscriptions(context).pop(str(params.uri), None)
    if stop is not None:
        stop()
    return EmptyResult()


def _subscriptions(context: Context) -> dict[str, Callable[[], None]]:
    """Return what the connection has subscribed to: what stops it, by address."""
    connection = context.session._connection  # per-connection state has no public access from a handler
    subscriptions: dict[str, Callable[[], None]] | None = connection.state.get(EVIDENCE)
    if subscriptions is None:
        subscriptions = connection.state[EVIDENCE] = {}
        connection.exit_stack.callback(_stop_all, subscriptions)
    return subscriptions


def _stop_all(subscriptions: dict[str, Callable[[], None]]) -> None:
    for stop in subscriptions.values():
        stop()


# --- 2026-07-28 ---


class TaskNotification(Notification[dict[str, Any], Literal["notifications/tasks"]]):
    """State of a task, as `tasks/get` returns it."""

    method: Literal["notifications/tasks"] = "notifications/tasks"
    params: dict[str, Any]


@dataclass
class _Stream:
    """Session of a listening request; the SDK's handler writes its acknowledgement through it.

    tasks: ids of the tasks that are listened for, which the acknowledgement names. begin: starts the notifications.
    """

    session: ServerSession
    tasks: list[str]
    begin: Callable[[], None]

    async def send_notification(
        self, notification: ServerNotification, related_request_id: RequestId | None = None
    ) -> None:
        acknowledgement = notification if isinstance(notification, SubscriptionsAcknowledgedNotification) else None
        if acknowledgement is not None and self.tasks:
            honored = acknowledgement.params.notifications.model_dump(exclude_none=True)
            acknowledgement.params.notifications = SubscriptionFilter.model_validate({**honored, "taskIds": self.tasks})
        await self.session.send_notification(notification, related_request_id)
        if acknowledgement is not None:
            self.begin()


async def _listen(
    app: Any, handler: ListenHandler, context: Context, params: SubscriptionsListenRequestParams
) -> SubscriptionsListenResult:
    asked = (params.notifications.model_extra or {}).get("taskIds") or []
    if not isinstance(asked, list) or not all(isinstance(identifier, str) for identifier in asked):
        raise MCPError(code=INVALID_PARAMS, message="notifications.taskIds must be a list of task ids")
    if asked:
        require_client_extension(context, tasks.EXTENSION)
    known = await anyio.to_thread.run_sync(tasks.known, app, asked)
    session, request = context.session, context.request_id
    meta: dict[str, Any] = {SUBSCRIPTION_ID_META_KEY: request}

    async def updated(uri: str, status: str) -> None:
        if status != "running":
            changed = ResourceUpdatedNotificationParams(uri=uri, _meta=meta)
            await session.send_notification(ResourceUpdatedNotification(params=changed), request)

    async def moved(identifier: str, _status: str) -> None:
        state = await anyio.to_thread.run_sync(tasks.task_state, app, identifier, context.protocol_version)
        state.pop("resultType")
        notification = TaskNotification(params={**state, "_meta": meta})
        await session.send_notification(cast(ServerNotification, notification), request)

    stops: list[Callable[[], None]] = []

    def begin() -> None:
        for uri in params.notifications.resource_subscriptions or []:
            if uri.startswith(EVIDENCE):
                stops.append(app.watch.watch(uri.removeprefix(EVIDENCE), partial(updated, uri)))
        for identifier, evidence in known.items():
            stops.append(app.watch.watch(evidence, partial(moved, identifier)))

    stream = cast(ServerSession, _Stream(session, list(known), begin))
    try:
        return await handler(replace(context, session=stream), params)
    finally:
        for stop in stops:
            stop()
