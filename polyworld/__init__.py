"""Worlds in, trajectories and events out."""

import warp as _warp

# Standard output may carry a protocol: Warp announces itself and every compilation there.
_warp.config.log_level = _warp.LOG_WARNING
