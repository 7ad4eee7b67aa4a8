"""The option `--store`: which evidence store a command works on."""

from __future__ import annotations

import argparse
import hashlib
from pathlib import Path

PICTURES = Path("atw-pictures")


def add_store(parser: argparse.ArgumentParser) -> None:
    """Add `--store` to a command."""
    parser.add_argument(
        "--store", type=Path, metavar="FILE", help="evidence store (default: in the user's data folder)"
    )


def chosen_store(options: argparse.Namespace) -> Path:
    """Return the absolute path of the store that the option names, else of the user's own."""
    if options.store is not None:
        return Path(options.store).expanduser().absolute()
    from atw_mcp.server import default_store  # imports every tool: only where its answer is wanted

    return default_store()


def pictures_of(store: Path | None) -> Path:
    """Return where the pictures of a store, default the user's own, are written: every store has an ev-1."""
    if store is None:
        return PICTURES / "user"
    path = store.expanduser().resolve()
    return PICTURES / f"{path.stem}-{hashlib.sha256(str(path).encode()).hexdigest()[:6]}"
