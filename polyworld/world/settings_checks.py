"""Checks that settings objects run when they are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def require_positive(settings: DataclassInstance) -> None:
    """Raise ValueError, naming the first field of a dataclass that is not positive."""
    for entry in fields(settings):
        value = getattr(settings, entry.name)
        if not all(v > 0 for v in (value if isinstance(value, tuple) else (value,))):
            raise ValueError(f"{entry.name} must be positive, got {value!r}")


def require_shares(settings: object, names: Sequence[str]) -> None:
    """Raise ValueError, naming the first of these fields that is a share and exceeds 1."""
    for name in names:
        if getattr(settings, name) > 1.0:
            raise ValueError(f"{name} is a share and at most 1, got {getattr(settings, name)!r}")
