"""Settings of Warp for the whole package, made before anything is launched."""

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

import warp as wp

# Standard output may carry a protocol: Warp would announce itself and every compilation there.
wp.config.log_level = wp.LOG_WARNING

NO_DRIVER = b"Warp CUDA warning: Could not find or load the NVIDIA CUDA driver"


@contextmanager
def without_driver_warning() -> Iterator[None]:
    """Drop the warning that there is no CUDA driver from what is written to standard error, and pass on the rest.

    Warp's native code writes it with `fprintf` when Warp starts, whatever the log level.
    """
    try:
        kept = os.dup(2)
    except OSError:  # standard error is closed: there is nothing to drop
        yield
        return
    with tempfile.TemporaryFile() as written:
        os.dup2(written.fileno(), 2)
        try:
            yield
        finally:
            if sys.stderr is not None:
                sys.stderr.flush()
            os.dup2(kept, 2)
            os.close(kept)
            written.seek(0)
            for line in written:
                if not line.startswith(NO_DRIVER):
                    os.write(2, line)
