"""Stretches of a body's motion solved together: each begins where the one before ends, and bounces are on the floor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.flight.contacts import Equations, Side, joined, landed, rebound
from atw_mcp.perception.flight.evidence import (
    Motion,
    Normal,
    energy_gains,
    misfits,
    normal_equations,
    squares_of,
    weights_of,
)
from atw_mcp.perception.flight.settings import FlightSettings
from atw_mcp.perception.flight.sightings import Sightings
from atw_mcp.perception.flight.surfaces import Surface, allowed

Floats = NDArray[np.float64]
MEDIAN_OF_THREE = 2.366  # of the chi-square distribution with three degrees of freedom


@dataclass(frozen=True)
class Stretch:
    """Frames of the observation, rows first..last, in which a body moves without contact, or on one surface.

    motion: "flight", "unexplained" or the name of the surface it moves on.
    """

    first: int
    last: int
    motion: str
    surface: Surface | None = None

    @property
    def on_floor(self) -> bool:
        """Whether the body is on the surface that has no end."""
        return self.surface is not None and self.surface.corners is None


@dataclass(frozen=True)
class Part:
    """Sightings begin..end - 1 with the index of their motion (-1: unexplained).

    unknowns: those (7,) of its motion, None where they are not solved for yet, or nothing explains it.
    """

    begin: int
    end: int
    motion: int
    unknowns: Floats | None = None


@dataclass(frozen=True)
class Solved:
    """Unknowns (6 P + 1,) of P parts and of the distances' scale, their covariance, and the energy [nats]."""

    unknowns: Floats
    covariance: Floats
    energy: float


class Chain:
    """The motions of one body; `seen` has times about zero."""

    def __init__(
        self,
        seen: Sightings,
        centre: Floats,
        motions: Sequence[Motion],
        surfaces: Sequence[Surface],
        lift: float,
        reach: float,
        settings: FlightSettings,
    ) -> None:
        self._seen, self._motions, self._surfaces = seen, motions, surfaces
        self._lift, self._reach, self._settings = lift, reach, settings
        self._normals = [normal_equations(motion, seen, centre) for motion in motions]
        self._flying = len(motions) - 1
        self._gravity = motions[-1].drift

    def improved(self, parts: list[Part]) -> tuple[list[Part], Solved]:
        """Return the parts after contacts were moved, parts joined and motions exchanged as long as that helps."""
        parts, best = self.settled(parts)
        for _ in range(self._settings.changes):
            tried = [self.settled(other) for other in self._neighbours(parts)]
            better = min(tried, key=lambda pair: pair[1].energy, default=None)
            if better is None or better[1].energy > best.energy - self._settings.worth:
                break
            parts, best = better
        return parts, best

    def places(self, parts: Sequence[Part], solved: Solved) -> tuple[Floats, Floats]:
        """Return places (K, 3) and their covariances (K, 3, 3), NaN where unexplained."""
        times = self._seen.times
        places, covariance = np.full((len(times), 3), np.nan), np.full((len(times), 3, 3), np.nan)
        noise = self._noise(parts)
        for part, index in self._indexed(parts):
            motion, rows = self._motions[part.motion], slice(part.begin, part.end)
            basis = motion.basis(times[rows])
            places[rows] = motion.known(times[rows]) + basis @ solved.unknowns[index[:6]]
            block = solved.covariance[np.ix_(index[:6], index[:6])]
            covariance[rows] = noise * np.einsum("kij,jl,kml->kim", basis, block, basis)
        return places, covariance

    def _noise(self, parts: Sequence[Part]) -> float:
        """Variance of the sightings about the motions, of what was expected of masks in general."""
        squares = [
            squares_of(_rows(self._normals[part.motion], part), part.unknowns)
            for part in parts
            if part.unknowns is not None
        ]
        if not squares:
            return 1.0
        return max(float(np.median(np.concatenate(squares))) / MEDIAN_OF_THREE, self._settings.quietest)

    def _neighbours(self, parts: list[Part]) -> Iterator[list[Part]]:
        for n, part in enumerate(parts):
            for k in range(-1, len(self._motions)):
                if k != part.motion:
                    yield [*parts[:n], replace(part, motion=k, unknowns=None), *parts[n + 1 :]]
            for at in self._cuts(part):
                for k, m in self._pairs(part.motion):
                    two = [replace(part, end=at, motion=k, unknowns=None)]
                    two.append(replace(part, begin=at, motion=m, unknowns=None))
                    yield [*parts[:n], *two, *parts[n + 1 :]]
            if n + 1 == len(parts):
                continue
            after = parts[n + 1]
            for one in (part, after):
                yield [*parts[:n], replace(one, begin=part.begin, end=after.end), *parts[n + 2 :]]
            for shift in self._settings.shifts:
                at = part.end + shift
                if not part.begin < at < after.end:
                    continue
                early, late = replace(part, end=at), replace(after, begin=at)
                yield [*parts[:n], early, late, *parts[n + 2 :]]
                for k in range(len(self._motions)):
                    if k != part.motion:
                        yield [*parts[:n], replace(early, motion=k, unknowns=None), late, *parts[n + 2 :]]
                    if k != after.motion:
                        yield [*parts[:n], early, replace(late, motion=k, unknowns=None), *parts[n + 2 :]]

    def _pairs(self, motion: int) -> Iterator[tuple[int, int]]:
        """Motions of the two pieces of a part: at least one of them stays."""
        for other in range(len(self._motions)):
            yield motion, other
            if other != motion:
                yield other, motion

    def _indexed(self, parts: Sequence[Part]) -> list[tuple[Part, NDArray[np.int64]]]:
        moving = [part for part in parts if part.motion >= 0]
        last = 6 * len(moving)
        return [(part, np.append(np.arange(6 * n, 6 * n + 6), last)) for n, part in enumerate(moving)]

    def settled(self, parts: list[Part]) -> tuple[list[Part], Solved]:
        """Solve the parts together, noise and speeds at contacts found by iteration."""
        solved = self._solve(parts)
        for _ in range(self._settings.rounds):
            index = iter(self._indexed(parts))
            parts = [
                replace(part, unknowns=solved.unknowns[next(index)[1]]) if part.motion >= 0 else part for part in parts
            ]
            solved = self._solve(parts)
        return parts, solved

    def _solve(self, parts: Sequence[Part]) -> Solved:
        settings, seen = self._settings, self._seen
        moving = self._indexed(parts)
        size = 6 * len(moving) + 1
        matrix, right = np.zeros((size, size)), np.zeros(size)
        matrix[-1, -1] = seen.scale**-2
        energy = settings.unexplained * sum(part.end - part.begin for part in parts if part.motion < 0)
        kinds = [0, *(part.motion for part, _ in moving)]
        energy += settings.leave * sum(before == 0 and after != 0 for before, after in pairwise(kinds))
        for part, index in moving:
            motion, normal = self._motions[part.motion], _rows(self._normals[part.motion], part)
            ends = seen.times[[part.begin, part.end - 1]]
            prior, mean = (one[0] for one in motion.expected(ends.mean(keepdims=True)))
            if part.unknowns is not None:
                squares = squares_of(normal, part.unknowns)
                weights = weights_of(squares, settings)
                energy += 0.5 * float(misfits(squares, settings).sum())
                energy += 0.5 * float(np.sum((prior @ part.unknowns[:6] - mean) ** 2))
                energy += float(energy_gains(motion, ends[None], part.unknowns[None, :6], self._gravity, settings)[0])
                energy += 0.0 if self._is_allowed(part, part.unknowns) else np.inf
            else:
                weights = np.full(part.end - part.begin, 1.0 / settings.alike)
            matrix[np.ix_(index, index)] += np.einsum("k,kij->ij", weights, normal.matrix)
            right[index] += weights @ normal.right
            matrix[np.ix_(index[:6], index[:6])] += prior.T @ prior
            right[index[:6]] += prior.T @ mean
            if part.motion == 0:
                energy += settings.covered * float(np.count_nonzero(seen.covered[part.begin : part.end]))
            energy += settings.contact
            energy += float(np.log(motion.prior).sum())
        if moving and moving[0][0].unknowns is not None:
            energy += 0.5 * float(moving[0][0].unknowns[6] / seen.scale) ** 2
        for (one, left), (two, behind) in pairwise(moving):
            if one.unknowns is not None and two.unknowns is not None:
                energy += self._gain(one, two)
            if one.end == two.begin:
                options = self._contact(one, two)
                costs = [option.cost(_own(one), _own(two)) for option in options]
                energy += min(*costs, settings.parted)
                if min(costs) < settings.parted:
                    both = np.append(left[:6], behind[:6])
                    equations, wanted = options[int(np.argmin(costs))].normal()
                    matrix[np.ix_(both, both)] += equations
                    right[both] += wanted
        energy += 0.5 * float(np.linalg.slogdet(matrix)[1])
        covariance: Floats = np.asarray(np.linalg.inv(matrix), dtype=float)
        return Solved(covariance @ right, covariance, energy)

    def _gain(self, one: Part, two: Part) -> float:
        """Price of a contact after which a body is faster than before: only another moving body can do that."""
        at = 0.5 * (self._seen.times[one.end - 1] + self._seen.times[two.begin])
        speeds = [float(np.linalg.norm(self._velocity(part, at))) for part in (one, two)]
        return min(0.5 * (max(speeds[1] - speeds[0], 0.0) / self._settings.gain) ** 2, self._settings.struck)

    def _contact(self, one: Part, two: Part) -> list[Equations]:
        """Return what may hold between two parts: landing, a rebound, or that both merely meet there."""
        settings = self._settings
        before, after = self._seen.times[one.end - 1], self._seen.times[two.begin]
        middle = 0.5 * (before + after)
        a, b = (Side.of(self._motions[part.motion], _or_zero(part), middle) for part in (one, two))
        usual = float(self._motions[self._flying].prior[3])
        kinds = one.motion == self._flying, two.motion == self._flying
        rolls_off = not kinds[0] and one.motion != two.motion
        options = [joined(a, b, after - before, 0.0 if rolls_off else settings.odd, settings)]
        if kinds == (True, True):
            heights = (self._lift, self._reach)
            options.append(rebound(a, b, after - before, self._surfaces[0], heights, usual, settings))
        elif kinds == (True, False):
            options.append(landed(a, b, after - before, self._surfaces[two.motion], usual, settings))
        return options

    def _velocity(self, part: Part, at: float) -> Floats:
        """Velocity at a time; of what is not solved for yet, that of unknowns of zero."""
        found: Floats = self._motions[part.motion].velocities(np.array([at]), _or_zero(part)[None])[0]
        return found

    def _cuts(self, part: Part) -> range:
        """Return where a part is tried to be cut: about eight places, or as many as it has."""
        least = self._settings.cut
        return range(part.begin + least, part.end - least + 1, max(1, (part.end - part.begin) // 8))

    def _is_allowed(self, part: Part, unknowns: Floats) -> bool:
        motion, times = self._motions[part.motion], self._seen.times[[part.begin, part.end - 1]]
        places = motion.places(times, np.tile(unknowns[:6], (2, 1)))
        sink = self._settings.sink * self._seen.distances[[part.begin, part.end - 1]]
        return bool(allowed(places[None], self._surfaces, part.motion, self._lift, sink[None])[0])


def _own(part: Part) -> Floats | None:
    return None if part.unknowns is None else part.unknowns[:6]


def _or_zero(part: Part) -> Floats:
    return np.zeros(6) if part.unknowns is None else part.unknowns[:6]


def _rows(normal: Normal, part: Part) -> Normal:
    rows = slice(part.begin, part.end)
    return Normal(normal.matrix[rows], normal.right[rows], normal.square[rows])
