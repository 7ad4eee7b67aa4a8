"""Print what the code weighs: `python -m tests.counts`.

Lines of Python per package (of the page: of TypeScript and CSS), files over 400 lines, and constants of modules: names
in capitals that stand for a number, how many of them in all, and those of several modules.
"""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ("polyworld", "atw_mcp", "evidence_store", "prompts", "tests", "tests/benchmarks")
PAGE = "atw_mcp/viewer/web"
LONG = 400  # lines


def lines(files: list[Path]) -> dict[Path, int]:
    """Count lines of each file."""
    return {file: len(file.read_text().splitlines()) for file in files}


def numbers(file: Path) -> list[str]:
    """Names of a module that stand for one number."""
    found = []
    for node in ast.parse(file.read_text()).body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            value = node.value.operand if isinstance(node.value, ast.UnaryOp) else node.value
            if isinstance(target, ast.Name) and isinstance(value, ast.Constant) and type(value.value) in (int, float):
                found.append(target.id)
    return found


def main() -> None:
    """Print all counts."""
    files = {package: lines(sorted((ROOT / package).rglob("*.py"))) for package in PACKAGES}
    files[PAGE] = lines([f for end in ("ts", "tsx", "css") for f in (ROOT / PAGE / "src").rglob(f"*.{end}")])
    print(f"{'':20}{'lines':>8}{'files':>7}{'over ' + str(LONG):>10}{'numbers':>9}")
    product: Counter[str] = Counter()
    for package, counted in files.items():
        names = [name for file in counted if file.suffix == ".py" for name in numbers(file)]
        product.update(names if package in PACKAGES[:4] else [])
        long = sum(n > LONG for n in counted.values())
        print(f"{package:20}{sum(counted.values()):8}{len(counted):7}{long:10}{len(names):9}")
    shared = sorted(((n, name) for name, n in product.items() if n > 1), reverse=True)
    print(f"names of numbers in several modules: {len(shared)}; {', '.join(f'{name} {n}' for n, name in shared[:12])}")
    for file, n in sorted((f, n) for counted in files.values() for f, n in counted.items() if n > LONG):
        print(f"{n:6} {file.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
