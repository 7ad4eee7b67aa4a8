"""`python -m tests.packaging OUT` writes the bundle and `server.json` to the folder OUT (default: dist)."""

from __future__ import annotations

import sys
from pathlib import Path

from tests.packaging.published import write

for path in write(Path(sys.argv[1] if len(sys.argv) > 1 else "dist")):
    print(path)
