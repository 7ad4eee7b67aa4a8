"""Settings of Warp for the whole package, made before any kernel is."""

import warp as wp

# Standard output may carry a protocol: Warp would announce itself and every compilation there.
wp.config.log_level = wp.LOG_WARNING
