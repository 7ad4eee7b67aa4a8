"""Ask the person at the client what only they know, where the client offers that (elicitation)."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from mcp.server.elicitation import AcceptedElicitation, render_elicitation_schema
from mcp.server.mcpserver.context import Context
from mcp.server.mcpserver.exceptions import ToolError
from mcp_types import ElicitRequest, ElicitRequestFormParams, ElicitResult, InputRequiredResult
from mcp_types.version import is_version_at_least
from pydantic import BaseModel

WITHIN_RESULTS = "2026-07-28"  # revision from which on a question is a result, and the call is repeated with the answer
KEY = "answer"


class Question(ToolError):
    """A refusal that an answer of the person at the client lifts; where nobody is asked or answers, it stands.

    form: what is asked for, of primitive fields. changed: makes the call's arguments and the form filled in those to go
    on with; may raise ToolError.
    """

    def __init__(
        self,
        refusal: str,
        message: str,
        form: type[BaseModel],
        changed: Callable[[dict[str, Any], Any], dict[str, Any]],
    ) -> None:
        super().__init__(refusal)
        self.message, self.form, self.changed = message, form, changed


async def asked(
    question: Question, arguments: dict[str, Any], context: Context[Any, Any]
) -> dict[str, Any] | InputRequiredResult | None:
    """Return the arguments to go on with, a result that asks for them, or None where there is no answer to be had."""
    capabilities = context.client_capabilities
    offered = None if capabilities is None else capabilities.elicitation
    if offered is None or (offered.form is None and offered.url is not None):
        return None
    filled: BaseModel | None
    if is_version_at_least(context.protocol_version or "", WITHIN_RESULTS):
        state = json.loads(context.request_state or '{"answers": {}}')  # sealed by the SDK, so that it is our own
        answers: dict[str, Any] = state["answers"]
        reply = (context.input_responses or {}).get(KEY)
        if isinstance(reply, ElicitResult) and "asked" in state:
            answers[state["asked"]] = reply.content if reply.action == "accept" else None
        if question.message not in answers:
            schema = render_elicitation_schema(question.form)
            request = ElicitRequest(params=ElicitRequestFormParams(message=question.message, requested_schema=schema))
            kept = json.dumps({"asked": question.message, "answers": answers})
            return InputRequiredResult(input_requests={KEY: request}, request_state=kept)
        content = answers[question.message]
        filled = None if content is None else question.form.model_validate(content)
    elif not context.session.can_send_request:
        return None
    else:
        outcome = await context.elicit(question.message, question.form)
        filled = outcome.data if isinstance(outcome, AcceptedElicitation) else None
    return None if filled is None else question.changed(arguments, filled)
