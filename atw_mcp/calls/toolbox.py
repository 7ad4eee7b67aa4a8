"""How a function becomes a tool: checked arguments, recorded evidence, shaped results, plain errors.

See `atw_mcp.server` for how a group of tools is written.
"""

from __future__ import annotations

import difflib
import inspect
import logging
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal, get_args, get_type_hints

import anyio
from mcp.server.mcpserver.context import Context
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.mcpserver.tools import Tool
from mcp.server.mcpserver.utilities.func_metadata import FuncMetadata, func_metadata
from mcp.shared.exceptions import MCPError
from mcp_types import CallToolResult, InputRequiredResult, ToolAnnotations
from pydantic import ValidationError

from atw_mcp.calls import tasks
from atw_mcp.calls.app import App
from atw_mcp.calls.apps import SHOWN_WITH
from atw_mcp.calls.following import follow
from atw_mcp.calls.jobs import LongWork, RunningJob
from atw_mcp.calls.limits import releasing
from atw_mcp.calls.questions import Question, asked
from atw_mcp.calls.result_schemas import referenced_schema, report_mismatch, result_schema
from atw_mcp.calls.results import Answer, to_result, validation_text
from atw_mcp.calls.roots import allow_roots
from atw_mcp.calls.schemas import inlined, without_null
from atw_mcp.calls.waiting import Forwarded, Waiting
from evidence_store import StoreError

Role = Literal["world construction", "gap", "world inspection", "world experimentation", "execution control"]
ToolFunction = Callable[..., Answer | LongWork | Waiting | Forwarded | CallToolResult]
logger = logging.getLogger(__name__)


class WorldTool(Tool):
    """A tool of this server. Its function runs in a worker thread and gets the `App` as its first argument."""

    role: Role
    pictures: bool = False
    files: bool = False
    returns: Any = None  # the model of its data, or a union of models; None: not yet declared

    @property
    def full_output(self) -> dict[str, Any]:
        """Schema of all that it returns, also where that is sent with pictures and therefore as text alone."""
        return referenced_schema(dict[str, Any] if self.returns is None else self.returns, long=_may_be_long(self.fn))

    async def run(self, arguments: dict[str, Any], context: Context[Any, Any], convert_result: bool = False) -> Any:
        """Check the arguments, call the function, record and shape what it returns.

        The result is a CallToolResult whatever `convert_result` says.
        """
        del convert_result
        app: App = context.request_context.lifespan_context
        checked = self.checked(arguments)
        began = time.monotonic()
        if self.files or not app.files.roots_known:
            await allow_roots(app, context)
        try:
            outcome = await anyio.to_thread.run_sync(self._call, app, checked)
            if isinstance(outcome, CallToolResult):
                return outcome
            if isinstance(outcome, Forwarded):
                return await app.tool(outcome.name).run(outcome.arguments, context)
            if isinstance(outcome, Waiting):
                return await self._wait_for_evidence(app, outcome, context)
            if isinstance(outcome, LongWork):
                left = max(0.0, outcome.patience - (time.monotonic() - began))  # opening a long film takes seconds
                return await self._wait(app, arguments, replace(self._watched(outcome), patience=left), context)
            self._compare(outcome)
            record = await anyio.to_thread.run_sync(app.store.evidence.add, outcome.to_evidence(self.name, arguments))
            return to_result(record)
        except MCPError:
            raise
        except Question as question:
            answered = await asked(question, arguments, context)
            if answered is None:
                raise
            return answered if isinstance(answered, InputRequiredResult) else await self.run(answered, context)
        except (ToolError, StoreError) as error:
            raise ToolError(app.files.redacted(str(error))) from error
        except Exception as error:
            logger.exception("%s failed", self.name)
            raise ToolError(
                f"{self.name} failed unexpectedly ({type(error).__name__}); the server's log has the details. "
                "Other tools still work, and ReadEvidence returns earlier results."
            ) from error

    def _call(self, app: App, checked: dict[str, Any]) -> Any:
        with releasing():
            return self.fn(app, **checked)

    def _compare(self, answer: Answer) -> Answer:
        """Return the answer, having logged where its data is not as declared."""
        if self.returns is not None:
            report_mismatch(self.name, self.returns, answer)
        return answer

    def _watched(self, work: LongWork) -> LongWork:
        return replace(work, work=lambda progress: self._compare(work.work(progress)))

    def checked(self, arguments: dict[str, Any]) -> dict[str, Any]:
        """Validate and convert arguments as given; raises ToolError naming what is wrong."""
        known = list(self.parameters.get("properties", {}))
        for name in arguments:
            if name not in known:
                close = difflib.get_close_matches(name, known, n=1)
                hint = f" (did you mean {close[0]!r}?)" if close else ""
                raise ToolError(f"{self.name} has no argument {name!r}{hint}; arguments: {', '.join(known) or 'none'}")
        try:
            return self.fn_metadata.validate_arguments(arguments)
        except ValidationError as error:
            raise ToolError(
                f"{self.name}: {validation_text(error)}. DescribeTool(tool={self.name!r}) lists every argument"
            ) from error

    async def _wait(
        self, app: App, arguments: dict[str, Any], work: LongWork, context: Context[App, Any]
    ) -> CallToolResult | dict[str, Any]:
        with anyio.CancelScope(shield=True):  # so that a cancelled call stops it below
            job = await anyio.to_thread.run_sync(app.jobs.start, self.name, arguments, work)
        as_task = tasks.offered(context.request_context)
        job.callers += 1
        try:
            with anyio.move_on_after(min(work.patience, tasks.PROMPT) if as_task else work.patience):
                await self._follow(app, job, context)
            record = await anyio.to_thread.run_sync(app.store.read_evidence, job.evidence)
            if as_task and record.status == "running":
                job.held = True
                return await anyio.to_thread.run_sync(tasks.create_task, app, record)
        except anyio.get_cancelled_exc_class():
            if job.callers == 1 and not job.held and job.progress is not None and _given_up(context):
                with anyio.CancelScope(shield=True):  # nobody else wants it: stop the work, keep the record
                    await anyio.to_thread.run_sync(app.jobs.cancel, job.evidence)
            raise
        finally:
            job.callers -= 1
        if record.status == "failed":
            raise ToolError(f"{record.summary} (evidence {record.id})")
        return await anyio.to_thread.run_sync(app.evidence_result, job.evidence)

    async def _wait_for_evidence(self, app: App, waiting: Waiting, context: Context[App, Any]) -> CallToolResult:
        with app.waiting.counted(waiting.evidence), anyio.move_on_after(waiting.seconds):
            await self._follow(app, app.jobs.running(waiting.evidence), context)
        return await anyio.to_thread.run_sync(waiting.then)

    async def _follow(self, app: App, job: RunningJob, context: Context[App, Any]) -> None:
        await follow(app, job, context.report_progress)


def _given_up(context: Context[App, Any]) -> bool:
    """Whether a cancelled call was given up by its client, instead of ending with its connection.

    On stdio and in sessions over HTTP a client gives up by a notification; without a session, closing the response
    stream says the same.
    """
    channel = context.request_context.session._request_outbound  # the SDK has no public way to ask
    return channel.transport.kind != "jsonrpc" or channel.cancel_requested.is_set()


class _Arguments(FuncMetadata):
    """Arguments of a tool, of which those that take nothing but text stay text where it is JSON: an answer may be."""

    def pre_parse_json(self, data: dict[str, Any]) -> dict[str, Any]:
        """Parse objects and lists that a client sent as text."""
        text = {key for key, field in self.arg_model.model_fields.items() if field.annotation == str | None}
        return super().pre_parse_json(data) | {key: value for key, value in data.items() if key in text}


class ToolGroup:
    """The tools of one role, in the order in which they are declared."""

    def __init__(self, role: Role) -> None:
        self.role: Role = role
        self.tools: list[WorldTool] = []

    def tool(
        self,
        name: str,
        *,
        title: str,
        read_only: bool = True,
        idempotent: bool = True,
        pictures: bool = False,
        files: bool = False,
        viewer: bool = False,
        returns: Any = None,
    ) -> Callable[[ToolFunction], ToolFunction]:
        """Declare a tool. The function's docstring is the description the agent reads.

        read_only: whether it leaves the case as it is (the evidence record apart). idempotent: whether the same call
        again changes nothing more. pictures: whether it returns images, and therefore no structured content. files:
        whether it reads files that its arguments name, so that the client's roots matter. viewer: whether hosts that
        render apps show the viewer with its result. returns: the model of the data that an agent is shown
        (`atw_mcp/results`), or a union of models where the arguments decide on the form.
        """

        def declare(function: ToolFunction) -> ToolFunction:
            arguments = func_metadata(function, skip_names=["app"], structured_output=False).arg_model
            arguments.model_config["extra"] = "forbid"  # the SDK would drop unknown arguments silently
            arguments.model_rebuild(force=True)
            data = dict[str, Any] if returns is None else returns
            output = None if pictures else result_schema(data, long=_may_be_long(function))
            self.tools.append(
                WorldTool(
                    fn=function,
                    name=name,
                    title=title,
                    description=_unwrapped(function.__doc__ or ""),
                    parameters=without_null(inlined(arguments.model_json_schema(by_alias=True))),
                    fn_metadata=_Arguments(arg_model=arguments, output_schema=output),
                    is_async=False,
                    context_kwarg=None,
                    annotations=ToolAnnotations(
                        title=title,
                        read_only_hint=read_only,
                        destructive_hint=False,
                        idempotent_hint=idempotent,
                        open_world_hint=False,
                    ),
                    role=self.role,
                    pictures=pictures,
                    files=files,
                    meta=SHOWN_WITH if viewer else None,
                    returns=returns,
                )
            )
            return function

        return declare


def _may_be_long(function: ToolFunction) -> bool:
    returned = get_type_hints(function)["return"]
    return returned is LongWork or LongWork in get_args(returned)


def _unwrapped(docstring: str) -> str:
    """A docstring as running text: its line breaks are for the editor, blank lines separate paragraphs."""
    paragraphs = inspect.cleandoc(docstring).split("\n\n")
    return "\n\n".join(" ".join(paragraph.split("\n")) for paragraph in paragraphs)
