"""Worlds from and to the files of other simulators: MJCF, URDF and USD in, MJCF out.

`import_world` reads a file, `import_confined` does so in a process with limits, and `export_mjcf` writes one; they list
what the other side does not hold. Reading order: `confined`, `reading` (which reader a file takes), `names`, `surfaces`
(friction and rebound on both sides), `geoms`, `bodies`, `joints` and `mujoco_model` (MJCF and URDF, by MuJoCo's own
compiler), `usd`, `mjcf`.
"""

from __future__ import annotations

from polyworld.exchange.confined import ImportLimits, import_confined
from polyworld.exchange.mjcf import Exported, export_mjcf
from polyworld.exchange.reading import Imported, import_world

__all__ = ["Exported", "ImportLimits", "Imported", "export_mjcf", "import_confined", "import_world"]
