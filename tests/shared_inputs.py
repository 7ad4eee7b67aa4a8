"""Small inputs that once failed, beside the repository. Tests that need them skip where they are absent."""

from __future__ import annotations

from pathlib import Path

import pytest

INPUTS = Path(__file__).resolve().parents[1].parent / "shared" / "inputs"


def needs_input(name: str) -> pytest.MarkDecorator:
    """Skip a test, with the reason, where `../shared/inputs/NAME` is absent."""
    return pytest.mark.skipif(not (INPUTS / name).exists(), reason=f"../shared/inputs/{name} is absent")
