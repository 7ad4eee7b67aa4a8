"""Whether MuJoCo can draw pictures on this machine."""

from __future__ import annotations

import mujoco
import pytest


def _has_gl() -> bool:
    if "egl" not in mujoco.GLContext.__module__ and "osmesa" not in mujoco.GLContext.__module__:
        return False  # a window is needed, and asking for one may end the process
    try:
        context = mujoco.GLContext(16, 16)
        context.make_current()
        context.free()
    except Exception:  # any failure of the driver means that there is nothing to render with
        return False
    return True


needs_gl = pytest.mark.skipif(
    not _has_gl(), reason="no offscreen OpenGL: set MUJOCO_GL=egl or osmesa before the tests start"
)
