"""Settings of Warp for the whole package, made before anything is launched."""

import warp as wp

# Standard output may carry a protocol: Warp would announce itself and every compilation there.
wp.config.log_level = wp.LOG_WARNING
