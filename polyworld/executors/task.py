"""A piece on its way to a worker and back, in pickled form, the same for all executors."""

from __future__ import annotations

import pickle
import traceback
from collections.abc import Callable
from typing import Any

from polyworld.core import interruption
from polyworld.executors.executor import Failure

Dumps = Callable[[Any], bytes]


def pickled_function(function: Callable[[Any], Any], dumps: Dumps = pickle.dumps) -> bytes:
    """Return a function in pickled form; raises TypeError where it has none."""
    try:
        return dumps(function)
    except Exception as error:
        raise TypeError(
            f"{function!r} cannot be pickled ({describe(error)}): give a function from the top of a module"
        ) from error


def pickled_task(key: str, function: bytes, piece: object, dumps: Dumps = pickle.dumps) -> bytes | Failure:
    """Return the task of `answered`, or the failure of a piece that cannot be pickled."""
    try:
        return pickle.dumps((key, function, dumps(piece)))
    except Exception as error:
        return Failure(key, f"the piece cannot be pickled: {describe(error)}")


def answered(task: bytes, dumps: Dumps = pickle.dumps) -> bytes:
    """Return the pickled result of a task, or its pickled failure where the function raises."""
    key, function, piece = pickle.loads(task)
    try:
        outcome = pickle.loads(function)(pickle.loads(piece))
    except Exception as error:
        interruption.check()
        outcome = Failure(key, describe(error), traceback.format_exc())
    try:
        return dumps(outcome)
    except Exception as error:
        return pickle.dumps(Failure(key, f"the result cannot be pickled: {describe(error)}"))


def describe(error: BaseException) -> str:
    """Return an exception in one line."""
    return "".join(traceback.format_exception_only(error)).strip().splitlines()[-1]
