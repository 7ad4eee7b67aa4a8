"""Coverage of a recording: region, speeds, spin, contacts. Ordinary sizes of effects follow from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2

Array = NDArray[np.float64]

SHARE = 0.05  # of the weight: what a force has to be to count as ordinary
AIR = 1.2  # density [kg/m^3]
FAR = 2.0  # sizes of the region visited by which a place may lie off its middle: from afar, all forces look uniform


@dataclass(frozen=True)
class Conditions:
    """Coverage of a recording of a world.

    lower, upper (3,): box that holds all places seen [m]. spread: standard deviation of places about their mean, root
    mean square over the axes of motion [m]. axes: indices of the world axes along which bodies may move and were
    measured. speed, fastest: root mean square and largest [m/s]. spin: typical [rad/s]; 0 where neither orientations
    nor spins were measured and the world gives none. duration: of the longest run [s]. frame: shortest time between
    samples of any run [s]. gravity (3,) [m/s^2]. acceleration: ordinary one [m/s^2]: gravity, or what friction on a
    supporting plane gives.
    masses, ball_radii: of each rigid body, the latter of the ball of equal volume [m]. mass, radius: medians, the
    latter of circumscribed balls. drop: height of a resting ball's centre above what it touches [m]; 0 without balls.
    deformables: whether there are any. planar: whether bodies move in a plane. supported: they lie on a motion plane
    that gravity presses them on. bounces: some body comes within reach of a static. meetings: pairs of bodies that come
    within reach of each other. slides: some body stays in contact with a static or plane. rubs: some body has friction.
    turns: some orientation or spin was measured. unturned: runs, by free rigid body, in which its places but not its
    turns were measured.
    places (P, 3): of rigid bodies, in the middle of the region along axes that were not measured [m]. touching (P,):
    whether the body there is within reach of a static.
    """

    lower: Array
    upper: Array
    spread: float
    axes: tuple[int, ...]
    speed: float
    fastest: float
    spin: float
    duration: float
    frame: float
    gravity: Array
    acceleration: float
    masses: tuple[float, ...]
    ball_radii: tuple[float, ...]
    mass: float
    radius: float
    drop: float
    deformables: bool
    planar: bool
    supported: bool
    bounces: bool
    meetings: tuple[tuple[str, str], ...]
    slides: bool
    rubs: bool
    turns: bool
    unturned: Mapping[str, tuple[str, ...]]
    places: Array
    touching: NDArray[np.bool_]

    @property
    def size(self) -> float:
        """Largest extent of the region visited [m]."""
        return float(max(np.max(self.upper - self.lower), 4.0 * self.radius, 1e-3))

    @property
    def middle(self) -> Array:
        """Centre (3,) of the region visited [m]."""
        return (self.lower + self.upper) / 2

    @property
    def force(self) -> float:
        """An ordinary force of an effect on a body [N]."""
        return SHARE * self.mass * self.acceleration

    @property
    def weight(self) -> float:
        """Weight of a body [N]; without gravity, what gives it its ordinary acceleration."""
        return self.mass * max(float(np.linalg.norm(self.gravity)), self.acceleration)

    @property
    def plate_drag(self) -> float:
        """Drag per squared speed [kg/m] in air with C_d = 2, that of a plate (Hoerner, Fluid-Dynamic Drag, 3)."""
        ball = float(np.median(self.ball_radii)) if self.ball_radii else 0.0
        return float(AIR * np.pi * ball**2)

    @property
    def strongest_drag(self) -> float:
        """Largest ordinary drag per squared speed [kg/m]: a plate's in air; in liquids what balances the weight, as a
        body that falls through one soon falls evenly."""
        return max(self.plate_drag, self.weight / self.speed**2)

    @property
    def spin_decay(self) -> float:
        """An ordinary torque per spin against it [kg m^2/s]: a ball loses a fifth of its spin."""
        return 0.2 * 0.4 * self.mass * max(self.radius, 1e-6) ** 2 / max(self.duration, 1e-6)

    @property
    def spin_shows(self) -> bool:
        """Whether a change of the spin shows: there is one, which was measured or acts where bodies rub."""
        return self.bodies > 0 and self.spin > 0.0 and (self.turns or (self.touches and self.rubs))

    @property
    def bodies(self) -> int:
        """Number of rigid bodies."""
        return len(self.masses)

    @property
    def touches(self) -> bool:
        """Whether anything touches anything."""
        return self.impacts or self.slides or self.supported

    @property
    def impacts(self) -> bool:
        """Whether bodies may hit statics or each other."""
        return self.bounces or bool(self.meetings)

    @property
    def across(self) -> tuple[int, ...]:
        """World axes of motion along which a uniform force shows other than as gravity."""
        size = np.abs(self.gravity)
        down = int(np.argmax(size))
        return tuple(a for a in self.axes if size[down] == 0.0 or a != down)

    def grid(self, counts: Sequence[int], margin: float = 0.0) -> Array:
        """Places (k, 3) that fill the region visited, evenly: counts along each of `axes`, in their order.

        margin: share of the extent by which the outermost places lie beyond the region; -0.25 puts two places at the
        quarters. Along other axes they lie in the middle.
        """
        ticks = [np.array([c]) for c in self.middle]
        for axis, count in zip(self.axes, counts, strict=False):
            beyond = margin * (self.upper[axis] - self.lower[axis])
            low, high = self.lower[axis] - beyond, self.upper[axis] + beyond
            ticks[axis] = np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2])
        return np.stack([g.ravel() for g in np.meshgrid(*ticks, indexing="ij")], axis=1)

    def flat_grid(self, each: int, margin: float) -> Array:
        """Return the grid of `each` places along two axes of motion; three along height cost much and add little."""
        return self.grid([each] * min(len(self.axes), 2) + [2] * max(0, len(self.axes) - 2), margin)

    def visited(self, count: int, *, touching_only: bool = False) -> Array:
        """Up to `count` places (k, 3) that stand for all on the paths: the centres of clusters (Lloyd 1982).

        touching_only: where bodies touch a static or lie on a supporting plane.
        """
        points = self.places[self.touching] if touching_only and not self.supported else self.places
        points = points[:: max(1, len(points) // 1000)]
        if len(np.unique(points, axis=0)) <= count:
            return np.unique(points, axis=0)
        centres, _ = kmeans2(points, count, iter=10, minit="++", seed=0)
        chosen: Array = centres[np.all(np.isfinite(centres), axis=1)]
        return chosen

    def distances(self, place: Array) -> Array:
        """Distances (P,) [m] of the places seen to one place (3,)."""
        found: Array = np.linalg.norm(self.places - place, axis=1)
        return found


def unequal(values: Sequence[float]) -> bool:
    """Whether some differ by more than a per cent."""
    return len(values) > 1 and max(values) > 1.01 * min(values)
