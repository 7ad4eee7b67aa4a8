"""Run a bag of independent pieces: in this process, in processes of this machine, or on a Dask cluster.

`executor_from("local:4")` gives an `Executor`; its `run(function, {key: piece})` yields `(key, result or Failure)` as
pieces complete, `map` in the pieces' order, and `results` collects them or raises `FailedPiecesError`. Which executor
ran a piece, beside how many others and after which, does not change its result: draw random numbers by
`piece_seed(seed, key)`.

Whole cases and fits are worth a process: a piece costs about 1 ms locally and 50 ms by Dask.
Within a case the gap search uses none: of 13 to 18 s of CPU of a one-ball case
at most 3 s are fits that do not wait for each other. Nor do populations of coupled worlds, whose kernels share the
cores by threads (16 ropes: 0.6 s of CPU by threads or by processes) and meet after every generation.
"""

from polyworld.executors.choice import add_executor_argument, executor_from, print_progress
from polyworld.executors.dask import DaskExecutor
from polyworld.executors.executor import (
    TRIES,
    Executor,
    FailedPiecesError,
    Failure,
    Progress,
    piece_seed,
    results,
)
from polyworld.executors.local import LocalExecutor
from polyworld.executors.serial import SerialExecutor

__all__ = [
    "TRIES",
    "DaskExecutor",
    "Executor",
    "FailedPiecesError",
    "Failure",
    "LocalExecutor",
    "Progress",
    "SerialExecutor",
    "add_executor_argument",
    "executor_from",
    "piece_seed",
    "print_progress",
    "results",
]
