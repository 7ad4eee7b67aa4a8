"""The version of this program."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version


def installed_version() -> str:
    """The version of this program as installed."""
    try:
        return version("atw-mcp")
    except PackageNotFoundError:  # run from a source tree that was never installed
        return "0+source"
