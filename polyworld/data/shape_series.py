"""Observed shapes: a readout of a deformable object as it was measured at the frames of a track record."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from polyworld.probing.readouts.kinds import Readout

Array = NDArray[np.float64]
_READOUT: TypeAdapter[Readout] = TypeAdapter(Readout)


@dataclass(frozen=True)
class ShapeSeries:
    """Measured values of one readout at T frames.

    readout: what was measured, and of which object. values (T, m, c): m entries of c components, in the readout's unit
    (see `polyworld.probing.readouts.kinds`), NaN where unknown. sigma (T, m): standard deviation of each component.
    confidence (T, m) in 0..1, 0 where nothing was observed.
    """

    readout: Readout
    values: Array
    sigma: Array
    confidence: Array

    def __post_init__(self) -> None:
        if self.values.ndim != 3:
            raise ValueError(f"values must have shape (T, m, c), got {self.values.shape}")
        expected = self.values.shape[:2]
        if self.sigma.shape != expected or self.confidence.shape != expected:
            raise ValueError(
                f"sigma {self.sigma.shape} and confidence {self.confidence.shape} must have shape {expected}"
            )
        seen = self.confidence > 0.0
        if np.any(seen & ~np.isfinite(self.values).all(axis=-1)):
            raise ValueError(f"{self.readout.kind} of {self.object!r}: a value with confidence above 0 must be finite")
        if np.any(seen & ~(np.isfinite(self.sigma) & (self.sigma > 0.0))):
            raise ValueError(f"{self.readout.kind} of {self.object!r}: sigma must be above 0 where confidence is")

    @property
    def object(self) -> str:
        """Name of the object."""
        return self.readout.object

    def rows(self, chosen: Any) -> Self:
        """The same at some of the frames."""
        return replace(self, values=self.values[chosen], sigma=self.sigma[chosen], confidence=self.confidence[chosen])

    def onto(self, frames: NDArray[np.int64], own: NDArray[np.int64]) -> Self:
        """The same on other frames, of which its `own` frames are a part; unknown elsewhere."""
        at = np.searchsorted(frames, own)
        count = len(frames)
        values = np.full((count, *self.values.shape[1:]), np.nan)
        sigma, confidence = np.full((count, self.values.shape[1]), np.nan), np.zeros((count, self.values.shape[1]))
        values[at], sigma[at], confidence[at] = self.values, self.sigma, self.confidence
        return replace(self, values=values, sigma=sigma, confidence=confidence)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values, NaN as None; `from_dict` reads them back exactly."""
        return {
            "readout": self.readout.model_dump(mode="json"),
            "shape": list(self.values.shape),
            "values": _listed(self.values),
            "sigma": _listed(self.sigma),
            "confidence": _listed(self.confidence),
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """The inverse of `to_dict`."""
        shape = tuple(int(n) for n in data["shape"])
        return cls(
            readout=_READOUT.validate_python(data["readout"]),
            values=np.asarray(data["values"], dtype=float).reshape(shape),
            sigma=np.asarray(data["sigma"], dtype=float).reshape(shape[:2]),
            confidence=np.asarray(data["confidence"], dtype=float).reshape(shape[:2]),
        )


def _listed(values: Array) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in values.ravel()]
