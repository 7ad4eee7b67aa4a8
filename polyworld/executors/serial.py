"""Run pieces in the calling process."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Generator, Mapping

from polyworld.core import interruption
from polyworld.executors.executor import Executor, Failure, Piece, Result
from polyworld.executors.task import answered, pickled_function, pickled_task


class SerialExecutor(Executor):
    """Run the pieces one after the other in the calling process, with its threads: for debugging and tiny pieces.

    Functions, pieces and results are pickled and read again, as by the other executors.
    """

    workers = 1

    def _outcomes(
        self, function: Callable[[Piece], Result], pieces: Mapping[str, Piece]
    ) -> Generator[tuple[str, Result | Failure]]:
        work = pickled_function(function)
        for key in pieces:
            interruption.check()
            task = pickled_task(key, work, pieces[key])
            yield key, task if isinstance(task, Failure) else pickle.loads(answered(task))

    def close(self) -> None:
        """End nothing: there are no workers."""
