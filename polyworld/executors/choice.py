"""The `--executor` option of commands."""

from __future__ import annotations

import argparse
import sys

from polyworld.core.cores import available_cores
from polyworld.executors.dask import DaskExecutor
from polyworld.executors.executor import Executor, Progress
from polyworld.executors.local import LocalExecutor
from polyworld.executors.serial import SerialExecutor

FORMS = "local, local:WORKERS, dask (a cluster it starts), dask:tcp://HOST:PORT, or serial"


def executor_from(text: str, workers: int | None = None) -> Executor:
    """Return the executor that a text names; `workers` counts where the text does not (default: a worker a core).

    local, local:4: processes of this machine; dask: a local cluster of processes; dask:tcp://host:8786: a scheduler's
    workers; serial: this process. Raises ValueError for other texts, RuntimeError where the `distributed` extra is
    missing, ConnectionError where no scheduler or worker answers.
    """
    kind, rest = _parsed(text)
    if kind == "local":
        return LocalExecutor(int(rest) if rest else workers or available_cores())
    return DaskExecutor(rest or None, workers) if kind == "dask" else SerialExecutor()


def _parsed(text: str) -> tuple[str, str]:
    """Return kind and place; raises ValueError for what names no executor."""
    kind, colon, rest = text.partition(":")
    if kind not in ("local", "dask", "serial") or (colon and (kind == "serial" or not rest)):
        raise ValueError(f"{text!r} names no executor: give {FORMS}")
    if kind == "local" and rest and (not rest.isdecimal() or int(rest) < 1):
        raise ValueError(f"{text!r}: the number of workers must be a whole number of at least 1")
    if kind == "dask" and rest and "://" not in rest:
        raise ValueError(f"{text!r}: give the scheduler's whole address, as dask:tcp://HOST:PORT")
    return kind, rest


def add_executor_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--executor`, a text for `executor_from`; one that names none is refused with the command line."""
    parser.add_argument(
        "--executor", type=_checked, default="local", metavar="WHERE", help=f"{FORMS} (default: %(default)s)"
    )


def _checked(text: str) -> str:
    try:
        _parsed(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return text


def print_progress(what: str) -> Progress:
    """Return what prints, on the standard error, how many pieces are done and the time left."""

    def show(done: int, total: int, left: float | None) -> None:
        if left is not None:
            time = f"{left:.0f} s" if left < 120.0 else f"{left / 60.0:.0f} min"
            print(f"{done} of {total} {what}, {time} left", file=sys.stderr, flush=True)

    return show
