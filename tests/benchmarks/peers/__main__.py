"""The engine beside its peers: speed, accuracy, identification, growth and start-up, in one command.

    uv run --group bench python -m tests.benchmarks.peers [--only forward,growth] [--quick] [--plots DIR] [--out FILE]

A whole run writes its tables, with the machine's description, to tests/benchmarks/RESULTS.md; runs with `--only` or
`--quick` print them, and write where `--out` says.
"""

from __future__ import annotations

import argparse
import importlib
import time
import traceback
from pathlib import Path
from types import ModuleType

from tests.benchmarks.peers.machine import description
from tests.benchmarks.peers.markdown import markdown

SECTIONS = ("forward", "identification", "real_motion", "growth", "startup")
RESULTS = Path(__file__).parents[1] / "RESULTS.md"


class SkippedError(Exception):
    """A section that cannot run here, and why."""


def section(name: str) -> ModuleType:
    """Return the module of a section; SkippedError where it, or a package that it needs, is not installed."""
    path = f"tests.benchmarks.peers.{name}"
    try:
        return importlib.import_module(path)
    except ModuleNotFoundError as error:
        reason = "there is no such module" if error.name == path else f"{error.name} is not installed"
        raise SkippedError(f"{name}: skipped, {reason}") from error


def chosen(only: str | None) -> tuple[str, ...]:
    """Return the sections named, each by its name or the beginning of it, separated by commas (default: all)."""
    if only is None:
        return SECTIONS
    asked = [part.strip() for part in only.split(",") if part.strip()]
    unknown = [part for part in asked if not any(name.startswith(part) for name in SECTIONS)]
    if unknown or not asked:
        raise SystemExit(f"no section is called {', '.join(unknown) or 'so'}; there are {', '.join(SECTIONS)}")
    return tuple(name for name in SECTIONS if any(name.startswith(part) for part in asked))


def run(name: str, quick: bool, plots: Path | None) -> str:
    """Return a section as Markdown, with how long it took, or why it did not run."""
    title = f"## {name.replace('_', ' ').capitalize()}"
    began = time.perf_counter()
    try:
        module = section(name)
        tables = module.tables(quick)
    except SkippedError as skipped:
        return f"{title}\n\n{skipped}."
    except Exception as error:  # the other sections are worth having
        traceback.print_exc()
        return f"{title}\n\nfailed: {type(error).__name__}: {error}"
    if plots is not None and hasattr(module, "plot"):
        module.plot(tables, plots)
    took = f"{'Quick run, ' if quick else ''}{time.perf_counter() - began:.0f} s."
    return "\n\n".join([title, took, *(markdown(table) for table in tables)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--only", metavar="SECTIONS", help=f"some of {', '.join(SECTIONS)}")
    parser.add_argument("--quick", action="store_true", help="few repetitions and small sizes")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="folder for pictures")
    parser.add_argument("--out", type=Path, metavar="FILE", help=f"default, for a whole run: {RESULTS.name}")
    arguments = parser.parse_args()
    names = chosen(arguments.only)
    parts = ["# Results of `python -m tests.benchmarks.peers`", "\n".join(f"- {line}" for line in description())]
    print("\n\n".join(parts), flush=True)
    for name in names:
        parts.append(run(name, arguments.quick, arguments.plots))
        print(f"\n{parts[-1]}", flush=True)
    whole = names == SECTIONS and not arguments.quick
    out = arguments.out or (RESULTS if whole else None)
    if out is not None:
        out.write_text("\n\n".join(parts) + "\n")
        print(f"\nwritten to {out}")


if __name__ == "__main__":
    main()
