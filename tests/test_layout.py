"""The packages import each other in one direction only."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FORBIDDEN = {
    "polyworld": {"mcp", "cv2", "sqlite3", "sqlite_utils", "atw_mcp", "evidence_store", "prompts"},
    "evidence_store": {"mcp", "cv2", "warp", "atw_mcp", "polyworld", "prompts"},
}


@cache
def imports(source: Path) -> tuple[tuple[ast.Import | ast.ImportFrom, bool], ...]:
    """Return every import of a file, also inside functions, and whether it is for types only."""
    found: list[tuple[ast.Import | ast.ImportFrom, bool]] = []

    def walk(node: ast.AST, for_types: bool) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Import | ast.ImportFrom):
                found.append((child, for_types))
            elif isinstance(child, ast.stmt | ast.ExceptHandler | ast.match_case):  # expressions import nothing
                test = child.test if isinstance(child, ast.If) else None
                walk(child, for_types or (isinstance(test, ast.Name) and test.id == "TYPE_CHECKING"))

    walk(ast.parse(source.read_text()), False)
    return tuple(found)


def imported_packages(source: Path) -> set[str]:
    packages = set()
    for node, _ in imports(source):
        if isinstance(node, ast.Import):
            packages |= {alias.name.split(".")[0] for alias in node.names}
        elif node.level == 0 and node.module:
            packages.add(node.module.split(".")[0])
    return packages


@pytest.mark.parametrize("package", sorted(FORBIDDEN))
def test_package_imports_nothing_from_above(package: str) -> None:
    sources = sorted((ROOT / package).rglob("*.py"))
    assert sources
    wrong = {str(s.relative_to(ROOT)): bad for s in sources if (bad := imported_packages(s) & FORBIDDEN[package])}
    assert not wrong


def test_device_memory_is_read_and_written_in_one_module() -> None:
    kept = ROOT / "polyworld" / "core" / "buffers.py"
    assert ".numpy()" in kept.read_text()
    named = (".numpy()", 'device="cpu"', "device='cpu'")
    sources = [s for s in (ROOT / "polyworld").rglob("*.py") if s != kept]
    assert not [str(s.relative_to(ROOT)) for s in sources if any(n in s.read_text() for n in named)]


def test_perception_knows_nothing_of_mcp() -> None:
    sources = sorted((ROOT / "atw_mcp" / "perception").rglob("*.py"))
    assert not [s.name for s in sources if "mcp" in imported_packages(s)]


FLOORS = {
    "polyworld": (
        ("core", "executors"),
        ("effects", "expressions"),
        ("world",),
        ("model",),
        ("edits", "exchange"),
        ("trajectory",),
        ("solver",),
        ("probing",),
        ("data",),
        ("screening",),
        ("estimation",),
        ("gap",),
        ("pictures",),
        ("materials",),
    ),
    "atw_mcp": (
        ("calls", "perception", "results"),
        ("looking",),
        ("cases",),
        ("models",),
        ("worlds",),
        ("observation",),
        ("fitting",),
        ("probing",),
        ("gap",),
        ("tools",),
        ("batch",),
        ("transports",),
        ("viewer",),
    ),
}
"""Rooms of a package from the ground up; those of one floor may import each other."""


def rooms_imported(source: Path, package: str) -> set[str]:
    """First folder or module below the package of all that a file imports, also inside functions, but for types."""
    found: set[str] = set()
    for node, for_types in imports(source):
        if for_types:
            continue
        if isinstance(node, ast.ImportFrom) and node.module == package:
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.startswith(f"{package}."):
            found.add(node.module.split(".")[1])
        elif isinstance(node, ast.Import):
            found |= {alias.name.split(".")[1] for alias in node.names if alias.name.startswith(f"{package}.")}
    return found


@pytest.mark.parametrize("package", sorted(FLOORS))
def test_rooms_import_only_what_lies_below(package: str) -> None:
    floor = {room: number for number, rooms in enumerate(FLOORS[package]) for room in rooms}
    wrong = []
    for source in sorted((ROOT / package).rglob("*.py")):
        place = source.relative_to(ROOT / package)
        own = floor.get(place.parts[0])
        if own is None:
            continue
        for room in rooms_imported(source, package) - {place.parts[0]}:
            if floor.get(room, len(floor)) > own:
                wrong.append(f"{place} imports {package}.{room}")
    assert not wrong


@pytest.mark.parametrize("package", sorted(FLOORS))
def test_every_room_says_what_lives_there(package: str) -> None:
    rooms = {path.name for path in (ROOT / package).iterdir() if (path / "__init__.py").is_file()}
    assert rooms - {"demo"} == {room for rooms in FLOORS[package] for room in rooms}
    silent = [
        r for r in sorted(rooms) if not ast.get_docstring(ast.parse((ROOT / package / r / "__init__.py").read_text()))
    ]
    assert not silent


def test_no_test_outside_the_benchmarks_imports_them() -> None:
    tests = ROOT / "tests"
    wrong = []
    for source in sorted(tests.rglob("*.py")):
        if source.relative_to(tests).parts[0] == "benchmarks":
            continue
        for node, _ in imports(source):
            names = [alias.name for alias in node.names]
            if isinstance(node, ast.ImportFrom) and node.module:
                names = [f"{node.module}.{name}" for name in names]
            if any(name.startswith("tests.benchmarks") for name in names):
                wrong.append(str(source.relative_to(ROOT)))
    assert not wrong


@pytest.mark.parametrize("package", sorted(FLOORS))
def test_tests_of_a_package_mirror_its_rooms(package: str) -> None:
    rooms = {room for floor in FLOORS[package] for room in floor}
    mirrored = {path.name for path in (ROOT / "tests" / package).iterdir() if (path / "__init__.py").is_file()}
    assert mirrored <= rooms
