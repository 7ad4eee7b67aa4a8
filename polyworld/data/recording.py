"""Measured motion in one or several runs: what a world is held against when the gap is looked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks, continuous, frame_grid

Array = NDArray[np.float64]


def _none_measured() -> Array:
    """Return the empty array that stands for angular velocities of which none was measured."""
    return np.empty((0, 0, 3))


@dataclass(frozen=True)
class Run:
    """One run: n objects at T instants, from an initial state of its own.

    names (n,): objects of the world, or markers of a deformable one as `NAME#k`: marker k is the material point that
    the deformable object NAME has, at the run's start, nearest to where the marker is first seen. times (T,) [s]:
    increasing, by the observer's clock; the world starts at
    `times[0]` less `lead`, the `origin`, and laws that depend on time (a forcing) go by this clock. positions (T, n, 3)
    [m], NaN for each component that was not measured. orientations (T, n, 4) w, x, y, z, NaN where unknown. sigma:
    standard deviation of a position [m] where it is known; None to have it estimated. symmetry (n,): as in
    `ObservedTracks`. lead [s]: how long before the first row the run begins, for runs whose initial state is given and
    not fitted.
    angular_velocities (T, n, 3) [rad/s]: measured spins in world axes, NaN for each component that was not measured;
    default: none measured. arms (n,) [m]: for objects whose positions stand for measured angles, the distance from the
    hinge's axis; NaN for others.
    """

    name: str
    names: tuple[str, ...]
    times: Array
    positions: Array
    orientations: Array
    sigma: float | None = None
    symmetry: tuple[int, ...] = ()
    lead: float = 0.0
    angular_velocities: Array = field(default_factory=_none_measured)
    arms: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        t, n = len(self.times), len(self.names)
        if self.positions.shape != (t, n, 3) or self.orientations.shape != (t, n, 4):
            raise ValueError(
                f"run {self.name!r}: positions {self.positions.shape} and orientations {self.orientations.shape}, "
                f"expected {(t, n, 3)} and {(t, n, 4)}"
            )
        if self.angular_velocities.size == 0:
            object.__setattr__(self, "angular_velocities", np.full((t, n, 3), np.nan))
        if self.angular_velocities.shape != (t, n, 3):
            raise ValueError(
                f"run {self.name!r}: angular_velocities {self.angular_velocities.shape}, expected {(t, n, 3)}"
            )
        if t and (not np.all(np.isfinite(self.times)) or np.any(np.diff(self.times) <= 0)):
            raise ValueError(f"run {self.name!r}: times must be finite and increase")
        if len(set(self.names)) != n:
            raise ValueError(f"run {self.name!r}: object names repeat: {list(self.names)}")
        if not self.symmetry:
            object.__setattr__(self, "symmetry", (1,) * n)
        if not self.arms:
            object.__setattr__(self, "arms", (np.nan,) * n)

    def rows(self, keep: NDArray[np.bool_]) -> Self:
        """Return the run restricted to some of its instants, keep (T,)."""
        return replace(
            self,
            times=self.times[keep],
            positions=self.positions[keep],
            orientations=self.orientations[keep],
            angular_velocities=self.angular_velocities[keep],
        )

    def columns(self, keep: Sequence[int]) -> Self:
        """Return the run restricted to some of its objects, by their index in `names`."""
        chosen = list(keep)
        return replace(
            self,
            names=tuple(self.names[i] for i in chosen),
            positions=self.positions[:, chosen],
            orientations=self.orientations[:, chosen],
            symmetry=tuple(self.symmetry[i] for i in chosen),
            angular_velocities=self.angular_velocities[:, chosen],
            arms=tuple(self.arms[i] for i in chosen),
        )

    @property
    def origin(self) -> float:
        """The clock's reading [s] at the run's start, for laws that depend on time."""
        return float(self.times[0]) - self.lead

    @classmethod
    def of_tracks(cls, name: str, tracks: ObservedTracks) -> Self:
        """A run from the tracks of a video: what has no confidence is not there."""
        seen = (tracks.confidence > 0.0)[..., None]
        turned = (tracks.orientation_confidence > 0.0)[..., None]
        sigma = tracks.coordinate_sigma[tracks.confidence > 0.0]
        return cls(
            name=name,
            names=tracks.names,
            times=tracks.times,
            positions=np.where(seen, tracks.positions, np.nan),
            orientations=np.where(turned, tracks.orientations, np.nan),
            sigma=float(np.median(sigma)) if len(sigma) else None,
            symmetry=tracks.symmetry,
        )

    def to_tracks(self) -> ObservedTracks:
        """Return the run as tracks, as a fit takes them: places of which all components were measured, their noise as
        stated or 0, which a fit reads off the places. Raises ValueError where there are none."""
        seen: NDArray[np.bool_] = np.all(np.isfinite(self.positions), axis=2)
        if not seen.any():
            raise ValueError(f"run {self.name!r}: no place of which x, y and z were all measured")
        turned = np.isfinite(self.orientations).all(axis=2)
        frames, step, clock = frame_grid(self.times - self.times[0])
        return ObservedTracks(
            names=self.names,
            frames=frames,
            seconds_per_frame=step,
            positions=np.where(seen[..., None], self.positions, np.nan),
            position_sigma=np.where(seen, self.sigma or 0.0, np.nan),
            orientations=np.stack([continuous(q) for q in self.orientations.swapaxes(0, 1)], axis=1),
            confidence=seen.astype(float),
            orientation_confidence=turned.astype(float),
            symmetry=self.symmetry,
            clock=None if np.array_equal(frames, clock) else clock,
        )

    def __repr__(self) -> str:
        span = f"{self.times[0]:.4g} to {self.times[-1]:.4g} s" if len(self.times) else "empty"
        return f"Run({self.name!r}: {', '.join(self.names)}; {len(self.times)} instants, {span})"


@dataclass(frozen=True)
class Recording:
    """All runs of a case."""

    runs: tuple[Run, ...]

    def __repr__(self) -> str:
        return f"Recording of {len(self.runs)} runs: " + ", ".join(map(repr, self.runs))

    def __post_init__(self) -> None:
        names = [r.name for r in self.runs]
        if not names:
            raise ValueError("a recording needs at least one run")
        if len(set(names)) != len(names):
            raise ValueError(f"names of runs repeat: {names}")

    def run(self, name: str) -> Run:
        """The run called `name`; raises KeyError naming the valid choices."""
        for candidate in self.runs:
            if candidate.name == name:
                return candidate
        raise KeyError(f"unknown run {name!r}; runs: {[r.name for r in self.runs]}")

    def select(self, names: tuple[str, ...]) -> Self:
        """Some of the runs, in the order given."""
        return type(self)(tuple(self.run(n) for n in names))
