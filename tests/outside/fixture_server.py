"""The server with the tools, resources and prompts that the official conformance suite calls by name.

They are written with the classes of the real server, so that the suite judges how that lists, calls, reports and
refuses. Run alone: python -m tests.outside.fixture_server STORE PORT
"""

from __future__ import annotations

import base64
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import uvicorn
from mcp.server import MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.mcpserver.prompts.base import UserMessage
from mcp_types import AudioContent, CallToolResult, EmbeddedResource, ImageContent, TextContent, TextResourceContents

from atw_mcp import server as real
from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.results import Answer
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.serving import http_app
from tests.atw_mcp import task_tools

GROUP = ToolGroup("execution control")
PIXEL = cv2.imencode(".png", np.zeros((1, 1, 3), np.uint8))[1].tobytes()
SILENCE = b"RIFF\x26\0\0\0WAVEfmt \x10\0\0\0\x01\0\x01\0\x40\x1f\0\0\x80\x3e\0\0\x02\0\x10\0data\x02\0\0\0\0\0"
PICTURE = ImageContent(type="image", data=base64.b64encode(PIXEL).decode(), mime_type="image/png")


def text(words: str) -> TextContent:
    """One block of text."""
    return TextContent(type="text", text=words)


def document(uri: str, words: str) -> EmbeddedResource:
    """One embedded resource."""
    resource = TextResourceContents(uri=uri, mime_type="text/plain", text=words)
    return EmbeddedResource(type="resource", resource=resource)


@GROUP.tool("test_simple_text", title="Text")
def simple_text(app: App) -> CallToolResult:
    """Return one line of text."""
    del app
    return CallToolResult(content=[text("a line of text")])


@GROUP.tool("test_image_content", title="Image", pictures=True)
def image_content(app: App) -> CallToolResult:
    """Return a picture."""
    del app
    return CallToolResult(content=[PICTURE])


@GROUP.tool("test_audio_content", title="Audio", pictures=True)
def audio_content(app: App) -> CallToolResult:
    """Return a sound."""
    del app
    sound = AudioContent(type="audio", data=base64.b64encode(SILENCE).decode(), mime_type="audio/wav")
    return CallToolResult(content=[sound])


@GROUP.tool("test_embedded_resource", title="Resource", pictures=True)
def embedded_resource(app: App) -> CallToolResult:
    """Return an embedded resource."""
    del app
    return CallToolResult(content=[document("test://embedded-resource", "a document")])


@GROUP.tool("test_multiple_content_types", title="Everything", pictures=True)
def multiple_content_types(app: App) -> CallToolResult:
    """Return text, a picture and a resource."""
    del app
    return CallToolResult(content=[text("three things"), PICTURE, document("test://mixed-content-resource", "one")])


@GROUP.tool("test_error_handling", title="Error", pictures=True)
def error_handling(app: App) -> CallToolResult:
    """Refuse."""
    del app
    raise ToolError("refused on purpose")


@GROUP.tool("test_tool_with_progress", title="Progress", pictures=True)
def with_progress(app: App) -> LongWork:
    """Report progress three times."""
    del app

    def work(progress: Progress) -> Answer:
        for done in (0, 50, 100):
            progress.report(done, 100, f"{done} of 100")
            time.sleep(0.2)
        return Answer(summary="done", data={})

    return LongWork(f"progress {time.time_ns()}", work, Answer(summary="counting", data={}), 10.0)


def fixture_server(store: Path) -> MCPServer[App]:
    """The real server and what the suite asks for."""
    real.GROUPS = (*real.GROUPS, GROUP, task_tools.TASKS)
    server = real.build_server(store)
    _add_resources(server)
    _add_prompts(server)
    return server


def _add_resources(server: MCPServer[App]) -> None:
    @server.resource("test://static-text", mime_type="text/plain")
    def static_text() -> str:
        return "text that stays"

    @server.resource("test://static-binary", mime_type="image/png")
    def static_binary() -> bytes:
        return PIXEL

    @server.resource("test://template/{id}/data", mime_type="text/plain")
    def template(id: str) -> str:
        return f"data of {id}"

    @server.resource("test://watched-resource", mime_type="text/plain")
    def watched() -> str:
        return "watched"


def _add_prompts(server: MCPServer[App]) -> None:
    @server.prompt("test_simple_prompt", description="a prompt of the suite")
    def simple() -> list[UserMessage]:
        return [UserMessage("a prompt")]

    @server.prompt("test_prompt_with_arguments", description="a prompt of the suite")
    def with_arguments(arg1: str, arg2: str) -> list[UserMessage]:
        return [UserMessage(f"arg1 is {arg1}, arg2 is {arg2}")]

    @server.prompt("test_prompt_with_embedded_resource", description="a prompt of the suite")
    def with_resource(resourceUri: str) -> list[UserMessage]:  # the suite's name
        return [UserMessage(document(resourceUri, "a document")), UserMessage("read it")]

    @server.prompt("test_prompt_with_image", description="a prompt of the suite")
    def with_image() -> list[UserMessage]:
        return [UserMessage(PICTURE), UserMessage("look at it")]


if __name__ == "__main__":
    uvicorn.run(http_app(fixture_server(Path(sys.argv[1]))), port=int(sys.argv[2]), log_level="warning")
