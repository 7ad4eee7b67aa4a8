"""Worlds from and to the files of other simulators: MJCF, URDF and USD in, MJCF out.

`import_world` reads a file, `export_mjcf` writes one; both list what the other side does not hold. Reading order:
`reading` (which reader a file takes), `names`, `surfaces` (friction and rebound on both sides), `geoms`, `bodies`,
`joints` and `mujoco_model` (MJCF and URDF, by MuJoCo's own compiler), `usd`, `mjcf`.
"""

from __future__ import annotations

from polyworld.exchange.imported import Imported
from polyworld.exchange.mjcf import Exported, export_mjcf
from polyworld.exchange.reading import import_world

__all__ = ["Exported", "Imported", "export_mjcf", "import_world"]
