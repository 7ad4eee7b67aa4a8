"""What a process imports: a server loads what a call needs, a client neither the server nor the engine."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from mcp.server.mcpserver.exceptions import ToolError

from atw_mcp.calls.deferred import DeferredTool
from atw_mcp.demo.truth import FOLDER
from atw_mcp.server import all_tools
from atw_mcp.tools import manifest

HEAVY = ("warp", "cv2", "matplotlib", "scipy", "trimesh", "mujoco")

SERVER = """
import json, sys
from pathlib import Path
import anyio
from mcp import Client
from atw_mcp.server import build_server

async def session():
    async with Client(build_server(Path(sys.argv[1]))) as client:
        await client.list_tools()
        for tool, arguments in json.loads(sys.argv[2]):
            result = await client.call_tool(tool, arguments)
            assert not result.is_error, result

anyio.run(session)
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
"""


CLIENT = """
import json, sys
from atw_mcp.cli import main
assert main(["call", "OpenCase", "--store", sys.argv[1]]) == 0
print(json.dumps(sorted(sys.modules)))
"""

ENGINE = """
import json, sys
from polyworld import compare, query, rollout
print(json.dumps(sorted(sys.modules)))
"""

COMMAND_LINE = """
import json, sys
from atw_mcp.cli import main
assert main(["tools", "BuildWorld"]) == 0
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
"""


def imports_of(program: str, *arguments: str) -> set[str]:
    """What a program that prints a list of its imports has imported, run in a process of its own."""
    finished = subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, text=True, timeout=120, check=False
    )
    assert finished.returncode == 0, finished.stderr
    return set(json.loads(finished.stdout.splitlines()[-1]))


def test_tools_about_cases_and_evidence_load_no_engine(tmp_path: Path) -> None:
    calls = [
        ("OpenCase", {}),
        ("DescribeTool", {"tool": "BuildWorld"}),
        ("OpenCase", {"data": str(manifest.FILE), "name": "one", "questions": ["Why?"]}),
        ("ReadEvidence", {"evidence": "ev-1"}),
        ("Finish", {"case": "one", "question": "Why?", "evidence": [], "missing": "all of it"}),
    ]
    loaded = imports_of(SERVER, str(tmp_path / "atw.db"), json.dumps(calls))
    assert "evidence_store" in loaded
    assert not loaded & set(HEAVY)


def test_opening_a_video_loads_what_reads_it_and_no_engine(tmp_path: Path) -> None:
    calls = [("OpenCase", {"video": str(FOLDER / "collision.mp4")})]
    loaded = imports_of(SERVER, str(tmp_path / "atw.db"), json.dumps(calls))
    assert loaded & set(HEAVY) == {"cv2"}


def test_a_client_loads_neither_server_nor_engine(tmp_path: Path) -> None:
    loaded = imports_of(CLIENT, str(tmp_path / "atw.db"))
    assert "atw_mcp.client" in loaded
    assert not loaded & {*HEAVY, "numpy", "evidence_store", "atw_mcp.server", "atw_mcp.calls.toolbox"}


def test_the_engine_loads_neither_meshers_nor_optimizers() -> None:
    loaded = imports_of(ENGINE)
    assert "polyworld.solver.rollout" in loaded
    assert not loaded & {"trimesh", "scipy.optimize", "scipy.stats", "scipy.ndimage", "matplotlib"}


def test_the_command_line_reads_commands_with_the_standard_library_alone() -> None:
    loaded = imports_of(COMMAND_LINE)
    assert not loaded & {*HEAVY, "numpy", "mcp", "anyio", "pydantic", "evidence_store", "platformdirs"}


def test_manifest_is_what_the_tools_declare() -> None:
    declared = manifest.declared_entries()
    assert manifest.entries() == declared, "changed on purpose? python -m tests.atw_mcp.tools.contract_snapshots"


def test_every_module_of_tools_is_in_the_manifest() -> None:
    with_tools = {path.stem for path in manifest.FILE.parent.glob("*.py") if "\nGROUP = " in path.read_text()}
    assert with_tools == set(manifest.MODULES)


def test_a_listed_tool_is_the_declared_one() -> None:
    tool = next(tool for tool in all_tools() if tool.name == "OpenCase")
    assert isinstance(tool, DeferredTool)
    declared = tool.declared()
    assert not isinstance(declared, DeferredTool)
    assert (tool.parameters, tool.output_schema, tool.annotations) == (
        declared.parameters,
        declared.output_schema,
        declared.annotations,
    )


def test_a_tool_that_cannot_be_imported_is_refused_and_named() -> None:
    entry = {**manifest.entries()[0], "module": "atw_mcp.tools.missing"}
    with pytest.raises(ToolError, match=r"OpenCase cannot be used: .*atw_mcp\.tools\.missing"):
        DeferredTool.from_entry(entry).checked({})
