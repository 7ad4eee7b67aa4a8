"""Compare the states of bodies where one segment of a run ends and the next begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polyworld import geometry
from polyworld.estimation.problem import Problem, Segment
from polyworld.estimation.segment_forward import Ends, Outcome
from polyworld.symmetry import rotation_vector

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

AXES = "xyz"
QUANTITIES = ("position", "velocity", "rotation", "spin")  # of which a jump's components are, in the order of `kind`


@dataclass(frozen=True)
class Boundary:
    """What has to be continuous where segment `before` ends and segment `after` begins.

    body, kind, axis (D,): column of the body among those simulated, index into QUANTITIES, and axis of each component.
    constant (C, 2): pairs of initial-state coordinates of both segments that are equal along a run.
    """

    before: int
    after: int
    body: Ints
    kind: Ints
    axis: Ints
    constant: Ints

    @property
    def length(self) -> int:
        """Number of components D + C."""
        return len(self.body) + len(self.constant)


@dataclass(frozen=True)
class Continuity:
    """All boundaries of a problem; `planar` worlds have their states in the coordinates of the plane."""

    problem: Problem
    planar: bool

    @cached_property
    def boundaries(self) -> tuple[Boundary, ...]:
        """Every boundary, run by run."""
        found = []
        for chain in self.problem.chains:
            for k in range(1, len(chain)):
                found.append(_boundary(self.problem, chain[k - 1], chain[k], self.planar))
        return tuple(found)

    @cached_property
    def entering(self) -> dict[int, Boundary]:
        """The boundary at which each segment but a run's first begins."""
        return {b.after: b for b in self.boundaries}

    def signs(self, labels: Sequence[str]) -> Array:
        """Return the sign (N,) with which a jump's components add to coordinates of these labels."""
        if not self.planar:
            return np.ones(len(labels))
        axes = geometry.plane_axes(self.problem.world.environment.motion_plane)
        found = []
        for label in labels:
            name, letter = label.split(".")
            _kind, axis = _component(
                QUANTITIES.index({"angular_velocity": "spin"}.get(name, name)), AXES.index(letter), True, axes
            )
            found.append(np.sign(axes[2 if axis == 2 else axis, AXES.index(letter)]))
        return np.array(found)

    def jump(self, boundary: Boundary, end: Ends, begin: Ends, before: Array, after: Array) -> Array:
        """Return jumps (k, D + C): states at a segment's end less those at the next one's begin.

        before, after (k, n): initial-state coordinates of both segments. Either side may have one row (k = 1).
        """
        parts = []
        body, axis = boundary.body, boundary.axis
        count = max(len(end.position), len(begin.position))
        jump = np.zeros((count, len(body)))
        if self.planar:
            place = end.position - begin.position
            place = np.concatenate([place[..., :2], _folded(place[..., 2:])], axis=-1)
            rate = end.velocity - begin.velocity
            of_pose = boundary.kind == 0
            jump[:, of_pose] = place[:, body[of_pose], axis[of_pose]]
            jump[:, ~of_pose] = rate[:, body[~of_pose], axis[~of_pose]]
        else:
            for kind, name in enumerate(QUANTITIES):
                own = boundary.kind == kind
                if not own.any():
                    continue
                if name == "rotation":
                    change = rotation_vector(*np.broadcast_arrays(end.orientation, begin.orientation))
                else:
                    change = getattr(end, name) - getattr(begin, name)
                jump[:, own] = change[:, body[own], axis[own]]
        parts.append(jump)
        if len(boundary.constant):
            change = before[:, boundary.constant[:, 0]] - after[:, boundary.constant[:, 1]]
            parts.append(np.broadcast_to(change, (count, change.shape[1])))
        return np.concatenate(parts, axis=1)


def _folded(angles: Array) -> Array:
    """Angles within half a turn of zero: segments may count whole turns differently."""
    folded: Array = angles - 2.0 * np.pi * np.round(angles / (2.0 * np.pi))
    return folded


def _boundary(problem: Problem, before: int, after: int, planar: bool) -> Boundary:
    world = problem.world
    names = [o.name for o in problem.segments[after].layout.world(world).objects]
    axes = geometry.plane_axes(world.environment.motion_plane) if planar else np.eye(3)
    rows: list[tuple[int, int, int]] = []
    ahead = {key: i for i, key in enumerate(_labels(problem.segments[before]))}
    constant = []
    at = 0
    for coordinates in problem.segments[after].layout.states:
        if coordinates.linkage is not None:
            for link in coordinates.linkage.links:
                rows += _all_of(names.index(link.item.name), planar)
        for label in coordinates.labels if coordinates.linkage is None else ():
            if label.startswith("effects."):
                if (coordinates.name, label) in ahead:
                    constant.append((ahead[(coordinates.name, label)], at + coordinates.labels.index(label)))
                continue
            name, letter = label.split(".")
            kind = {"position": 0, "velocity": 1, "rotation": 2, "angular_velocity": 3}[name]
            rows.append((names.index(coordinates.name), *_component(kind, AXES.index(letter), planar, axes)))
        at += len(coordinates.labels)
    unique = np.array(list(dict.fromkeys(rows)), dtype=np.int64).reshape(-1, 3)
    pairs = np.array(constant, dtype=np.int64).reshape(-1, 2)
    return Boundary(before, after, unique[:, 0], unique[:, 1], unique[:, 2], pairs)


def _component(kind: int, axis: int, planar: bool, axes: Array) -> tuple[int, int]:
    """(kind, axis) of a component; in the plane, that of the plane's axis nearest to a world axis."""
    if not planar:
        return kind, axis
    if kind >= 2:
        return kind - 2, 2
    return kind, int(np.argmax(np.abs(axes[:2, axis])))


def _all_of(body: int, planar: bool) -> list[tuple[int, int, int]]:
    return [(body, kind, axis) for kind in range(2 if planar else 4) for axis in range(3)]


def _labels(segment: Segment) -> list[tuple[str, str]]:
    return [(s.name, label) for s in segment.layout.states for label in s.labels]


def jumps(continuity: Continuity, outcomes: Sequence[Outcome], states: Sequence[Array]) -> list[Array]:
    """Return the jumps (k, D) at every boundary, from outcomes and coordinates (k, N) of all segments."""
    return [
        continuity.jump(b, outcomes[b.before].end, outcomes[b.after].begin, states[b.before], states[b.after])
        for b in continuity.boundaries
    ]
