"""The whole state of a world of rigid bodies at one time: what a solver must know to go on as if it had not stopped."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers

Array = NDArray[np.float64]

_HEAD = "head"  # entry of the archive that is no array of the solver


@dataclass(frozen=True)
class SavedState:
    """A world at `time` [s]: poses and rates of its n objects, and the solver's memory of contacts and joints.

    positions (n, 3) [m]; orientations (n, 4) w, x, y, z; velocities (n, 3) [m/s]; angular_velocities (n, 3) [rad/s].
    memory: the solver's arrays by name; its layout belongs to the version of the engine that wrote it.
    """

    world_id: str
    time: float
    names: tuple[str, ...]
    positions: Array
    orientations: Array
    velocities: Array
    angular_velocities: Array
    memory: Mapping[str, NDArray[Any]]

    def to_bytes(self) -> bytes:
        """Return the state as a compressed NumPy archive; equal states give equal bytes."""
        head = json.dumps({"world_id": self.world_id, "time": self.time.hex(), "names": self.names})
        motion = {name: getattr(self, name) for name in _MOTION}
        file = io.BytesIO()
        content = {**motion, **{f"memory.{name}": values for name, values in self.memory.items()}}
        np.savez_compressed(file, allow_pickle=False, **{_HEAD: np.array(head)}, **content)
        return file.getvalue()

    @classmethod
    def from_bytes(cls, content: bytes) -> Self:
        """Read what `to_bytes` wrote; raises ValueError for anything else."""
        try:
            with np.load(io.BytesIO(content), allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
            head = json.loads(str(arrays.pop(_HEAD)))
            motion = {name: arrays.pop(name) for name in _MOTION}
            time = float.fromhex(head["time"])
            memory = {name.removeprefix("memory."): values for name, values in arrays.items()}
            return cls(head["world_id"], time, tuple(head["names"]), memory=memory, **motion)
        except (OSError, KeyError, EOFError, ValueError, zipfile.BadZipFile) as error:
            raise ValueError("not what SavedState.to_bytes returned, or damaged") from error


_MOTION = ("positions", "orientations", "velocities", "angular_velocities")


def arrays_of(record: Any, name: str) -> dict[str, Any]:
    """Return the Warp arrays that a record and the records in it hold, by dotted names that begin with `name`."""
    found: dict[str, Any] = {}
    for field in record._cls.vars:
        value = getattr(record, field)
        if isinstance(value, wp.array):
            found[f"{name}.{field}"] = value
        elif hasattr(value, "_cls"):
            found.update(arrays_of(value, f"{name}.{field}"))
    return found


def copied(arrays: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Copies of Warp arrays as NumPy's."""
    return {name: buffers.read(values).copy() for name, values in arrays.items() if values.size}


def write_back(arrays: Mapping[str, Any], memory: Mapping[str, NDArray[Any]]) -> None:
    """Copy what `copied` returned into Warp arrays.

    Raises ValueError where their sizes differ: the state was saved by another version of the engine, or with more room.
    """
    for name, values in arrays.items():
        if not values.size:
            continue
        kept = memory.get(name)
        view = buffers.read(values)
        if kept is None or kept.dtype != view.dtype or kept.shape != view.shape:
            raise ValueError(
                f"the saved state does not fit this engine: {name} is "
                f"{'missing' if kept is None else f'{kept.dtype.name} {kept.shape}'}, wanted "
                f"{view.dtype.name} {view.shape}; make the state again with `polyworld.state_at`"
            )
        buffers.assign(values, kept)
