"""Limits of what one call may ask for, checked before the work begins. The owner of the server sets them, no agent."""

from __future__ import annotations

import ctypes
import os
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

VARIABLE = "ATW_MCP_LIMITS"
_C = None if sys.platform == "win32" else ctypes.CDLL(None)
UNKNOWN_MEMORY = 8_000_000_000  # bytes of the machine where the system does not say


class LimitsError(ValueError):
    """A file of limits that cannot be used; the message names the limits there are."""


def machine_memory() -> int:
    """Memory of the machine [bytes]."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return UNKNOWN_MEMORY


class Limits(BaseModel):
    """Sizes above which a call is refused, each with its reason."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    file_bytes: int = Field(
        default=2_000_000_000, gt=0, description="of a file, or of all files of a folder [bytes]: read in some seconds"
    )
    text_bytes: int = Field(
        default=32_000_000,
        gt=0,
        description="of a table, JSON file or mesh [bytes]: a million rows, read in a minute with 1 GB",
    )
    folder_files: int = Field(default=20_000, gt=0, description="files of a folder: ten masks in each of 2,000 frames")
    elements: int = Field(
        default=30_000, gt=0, description="of all soft bodies of a world: divided in a quarter of a minute, with 300 MB"
    )
    triangles: int = Field(default=200_000, gt=0, description="of all cloths of a world: more are not run in an hour")
    segments: int = Field(default=20_000, gt=0, description="of all ropes of a world: more are not run in an hour")
    cells: int = Field(default=1_000_000, gt=0, description="of the grid of fluids: some 200 bytes each in a rollout")
    particles: int = Field(
        default=1_000_000, gt=0, description="of all fluids, with those emitted: some 300 bytes each in a rollout"
    )
    memory_bytes: int = Field(
        default_factory=lambda: machine_memory() // 2,
        gt=0,
        description="of this process: above it no long work begins, and running work is stopped; default: half the "
        "machine's",
    )
    rollout_seconds: float = Field(
        default=600.0,
        gt=0,
        description="that a rollout may be predicted to take [s], and after which one that slows down ends: with fewer "
        "segments, elements or cells, most take a few",
    )
    call_seconds: float = Field(
        default=14_400.0, gt=0, description="after which long work is stopped [s]: the longest searches take an hour"
    )

    @classmethod
    def read(cls, file: Path | None) -> Self:
        """Return the limits of a TOML file, default that of ATW_MCP_LIMITS, else the defaults; raises LimitsError."""
        named = os.environ.get(VARIABLE)
        path = file if file is not None else Path(named).expanduser() if named else None
        if path is None:
            return cls()
        try:
            return cls.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise LimitsError(f"limits {path}: {error}") from error
        except ValidationError as error:
            wrong = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())
            raise LimitsError(f"limits {path}: {wrong}; limits are {', '.join(cls.model_fields)}") from error

    def exceeded(self, seconds: float = 0.0) -> str | None:
        """Say which limit of a running process is exceeded; None if none is. seconds: that its work has run."""
        used = resident_bytes()
        if used is not None and used > self.memory_bytes:
            return (
                f"the server uses {used / 1e9:.2g} GB, more than its limit of {self.memory_bytes / 1e9:.2g} GB "
                "(memory_bytes)"
            )
        if seconds > self.call_seconds:
            return f"it ran for more than {self.call_seconds:g} s, the limit (call_seconds) of this server"
        return None


def resident_bytes() -> int | None:
    """Memory that this process has in use [bytes]; None where the system does not say."""
    try:
        with open("/proc/self/statm", encoding="ascii") as facts:
            return int(facts.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return None if sys.platform == "win32" else _most_resident_bytes()


@contextmanager
def releasing() -> Iterator[None]:
    """Give memory that was freed in the context back to the system.

    glibc keeps freed blocks of up to 32 MB, such as frames, for the next ones: gigabytes after a film.
    """
    try:
        yield
    finally:
        trim = getattr(_C, "malloc_trim", None)  # of glibc; others give large blocks back at once
        if trim is not None:
            trim(0)


def _most_resident_bytes() -> int:
    import resource  # not on Windows

    # Kilobytes, on macOS bytes.
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


DEFAULT = Limits()
