"""Generate short clips with questions of known answers, simulated and rendered by MuJoCo."""

import os

os.environ.setdefault("MUJOCO_GL", "egl")  # MuJoCo reads it when it is first imported
