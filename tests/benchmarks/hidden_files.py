"""The files through which generator, runner and scorer meet: no object of one process reaches another.

Public folder of a case: `world.json`, `data.csv`, `sealed.csv`, then `verdict.json` by the runner; private folder:
`truth.json`, which the scorer alone opens (and the generator, when an experiment is asked for).
"""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COLUMNS = ("run", "object", "t", "x", "y", "z", "qw", "qx", "qy", "qz")


def write_json(path: Path, content: Any) -> None:
    """Write JSON, whole or not at all."""
    part = path.with_suffix(".part")
    part.write_text(json.dumps(content, indent=1))
    part.replace(path)


def read_json(path: Path) -> Any:
    """Read JSON."""
    return json.loads(path.read_text())


def write_runs(
    path: Path, names: Sequence[str], runs: Sequence[tuple[str, Array, Array, Array]], *, append: bool = False
) -> None:
    """Write runs: name, stamps (T,), positions (T, n, 3), orientations (T, n, 4); NaN stays empty."""
    with path.open("a" if append else "w", newline="") as file:
        writer = csv.writer(file)
        if not append:
            writer.writerow(COLUMNS)
        for run, stamps, positions, orientations in runs:
            for k, t in enumerate(stamps):
                for i, name in enumerate(names):
                    numbers = [*positions[k, i], *orientations[k, i]]
                    writer.writerow([run, name, f"{t:.9f}", *("" if np.isnan(v) else f"{v:.9g}" for v in numbers)])


def runs_of(text: str) -> list[tuple[str, tuple[str, ...], Array, Array, Array]]:
    """Return the runs of a file's text in their order.

    Name, names of objects, stamps (T,), positions (T, n, 3), orientations (T, n, 4).
    """
    rows: dict[str, dict[str, list[list[float]]]] = {}
    for row in csv.DictReader(text.splitlines()):
        values = [float(row[c]) if row[c] else np.nan for c in COLUMNS[2:]]
        rows.setdefault(row["run"], {}).setdefault(row["object"], []).append(values)
    found = []
    for run, objects in rows.items():
        table = np.array(list(objects.values()))
        stamps, positions, orientations = table[0, :, 0], table[..., 1:4], table[..., 4:]
        found.append((run, tuple(objects), stamps, positions.swapaxes(0, 1), orientations.swapaxes(0, 1)))
    return found
