"""Generate short clips with questions of known answers: MuJoCo moves and renders them, `water.py` moves water."""

import os

os.environ.setdefault("MUJOCO_GL", "egl")  # MuJoCo reads it when it is first imported
