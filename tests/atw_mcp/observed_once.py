"""Observations of the tools, of which those with equal arguments are made once in a run of all tests.

To follow bodies through a film takes most of the time of tests that only need an observation to go on from. What is
observed is tested in `tests/atw_mcp/perception`, where nothing is shared.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from atw_mcp.cases.cases import path_hash
from atw_mcp.perception.observation import ImageObservation
from polyworld.core.compile_lock import one_process_at_a_time

Observe = Callable[..., ImageObservation]


def shared(observe: Observe, folder: Path) -> Observe:
    """An observing function whose results are kept in a folder that several processes may share."""

    def kept(path: Path, *given: Any, progress: Any, cancelled: Any, **options: Any) -> ImageObservation:
        if cancelled():  # as the function itself says
            return observe(path, *given, progress=progress, cancelled=cancelled, **options)
        asked = (observe.__name__, path_hash(path), given, sorted(options.items()))
        key = hashlib.sha256(pickle.dumps(asked)).hexdigest()
        file = folder / key
        with one_process_at_a_time(folder, [key]):
            if file.exists():
                found: ImageObservation = pickle.loads(file.read_bytes())
                return replace(found, video=replace(found.video, path=str(path)))
            found = observe(path, *given, progress=progress, cancelled=cancelled, **options)
            file.write_bytes(pickle.dumps(found))
            return found

    return kept
