"""The packages import each other in one direction only."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FORBIDDEN = {
    "polyworld": {"mcp", "cv2", "sqlite3", "sqlite_utils", "atw_mcp", "evidence_store", "prompts"},
    "evidence_store": {"mcp", "cv2", "warp", "atw_mcp", "polyworld", "prompts"},
}


def imported_packages(source: Path) -> set[str]:
    packages = set()
    for node in ast.walk(ast.parse(source.read_text())):
        if isinstance(node, ast.Import):
            packages |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            packages.add(node.module.split(".")[0])
    return packages


@pytest.mark.parametrize("package", sorted(FORBIDDEN))
def test_package_imports_nothing_from_above(package: str) -> None:
    sources = sorted((ROOT / package).rglob("*.py"))
    assert sources
    wrong = {str(s.relative_to(ROOT)): bad for s in sources if (bad := imported_packages(s) & FORBIDDEN[package])}
    assert not wrong


def test_perception_knows_nothing_of_mcp() -> None:
    sources = sorted((ROOT / "atw_mcp" / "perception").rglob("*.py"))
    assert not [s.name for s in sources if "mcp" in imported_packages(s)]
