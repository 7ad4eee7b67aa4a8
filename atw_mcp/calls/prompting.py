"""The prompts an agent is given, read from Markdown files and served over MCP.

A file starts with TOML between two lines `+++`: name, title, description and a list of arguments (name,
description, required). In the text `{{argument}}` stands for the argument's value, and for nothing where an
optional one is not given.
"""

from __future__ import annotations

import re
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

from mcp.server import MCPServer
from mcp.server.mcpserver.context import Context
from mcp.server.mcpserver.prompts.base import Message, Prompt, PromptArgument, UserMessage
from mcp.shared.exceptions import MCPError
from mcp_types import INVALID_PARAMS, GetPromptResult, InputRequiredResult
from pydantic import BaseModel, ConfigDict

from atw_mcp.calls.app import App

FENCE = "+++"


class _Argument(BaseModel):
    model_config = ConfigDict(extra="forbid")
    name: str
    description: str
    required: bool


class _FrontMatter(BaseModel):
    model_config = ConfigDict(extra="forbid")
    name: str
    title: str
    description: str
    arguments: list[_Argument]


class FilePrompt(Prompt):
    """A prompt whose text is a file."""

    text: str

    async def render(self, arguments: dict[str, Any] | None, context: Context[Any, Any]) -> list[Message]:
        """The prompt as one user message; raises MCPError (invalid params) for missing or unknown arguments."""
        del context
        return [UserMessage(self.filled(arguments or {}))]

    def filled(self, given: dict[str, Any]) -> str:
        """The text with the arguments put in; raises MCPError naming the arguments where they do not fit."""
        known = {argument.name: argument.required for argument in self.arguments or []}
        missing = [name for name, required in known.items() if required and not str(given.get(name, "")).strip()]
        unknown = sorted(set(given) - set(known))
        if missing or unknown:
            wrong = [f"missing {missing}"] * bool(missing) + [f"unknown {unknown}"] * bool(unknown)
            listed = ", ".join(f"{name} ({'required' if known[name] else 'optional'})" for name in known)
            raise MCPError(INVALID_PARAMS, f"prompt {self.name}: {' and '.join(wrong)}; arguments: {listed}")
        # One pass, so that braces inside a value are left alone.
        text = re.sub(r"\{\{(\w+)\}\}", lambda found: str(given.get(found[1], "")).strip(), self.text)
        return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"


class PromptServer(MCPServer[App]):
    """An MCP server that answers requests for prompts it does not have as the protocol wants it."""

    async def get_prompt(
        self, name: str, arguments: dict[str, Any] | None = None, context: Context[App, Any] | None = None
    ) -> GetPromptResult | InputRequiredResult:
        """One prompt; raises MCPError (invalid params), which unlike the SDK's own error reaches every client."""
        names = [prompt.name for prompt in await self.list_prompts()]
        if name not in names:
            raise MCPError(INVALID_PARAMS, f"unknown prompt {name!r}; prompts: {names}")
        return await super().get_prompt(name, arguments, context)


def add_prompts(server: MCPServer[Any]) -> None:
    """Serve every prompt file."""
    for prompt in all_prompts():
        server.add_prompt(prompt)


@cache
def all_prompts() -> tuple[FilePrompt, ...]:
    """Every prompt, by file name; raises ValueError for a file that is not well formed."""
    return tuple(read_prompt(path) for path in sorted(prompt_folder().glob("*.md")))


def prompt_folder() -> Path:
    """Where the files are: in the package when installed, beside it in a checkout."""
    package = Path(__file__).parents[1]
    installed = package / "prompts"
    return installed if installed.is_dir() else package.parent / "prompts"


def read_prompt(path: Path) -> FilePrompt:
    """One prompt file; raises ValueError saying what is wrong with it."""
    head, fence, text = path.read_text(encoding="utf-8").removeprefix(FENCE + "\n").partition("\n" + FENCE + "\n")
    if not fence:
        raise ValueError(f"{path}: no front matter between two lines {FENCE!r}")
    matter = _FrontMatter.model_validate(tomllib.loads(head))
    declared, used = {argument.name for argument in matter.arguments}, set(re.findall(r"\{\{(\w+)\}\}", text))
    if declared != used:
        raise ValueError(f"{path}: declares the arguments {sorted(declared)} and uses {sorted(used)}")
    return FilePrompt(
        name=matter.name,
        title=matter.title,
        description=matter.description,
        arguments=[PromptArgument(**argument.model_dump()) for argument in matter.arguments],
        fn=lambda: "",  # the SDK wants a function; `render` does not call it
        icons=None,
        context_kwarg=None,
        text=text,
    )
