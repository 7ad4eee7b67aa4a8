"""Initial states of bodies that joints hold to the world and to each other: one coordinate and one rate a joint.

A linkage is a tree of hinges and sliders (and fixed joints, which have no coordinate) that begins at the world: a
pendulum, a double pendulum, a cart that carries one. Places and velocities of all its bodies follow from the joints'
coordinates, body by body from the world outwards (Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 4).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.initial_states import free_stretch
from polyworld.data.noise import noise_level
from polyworld.data.recording import Run
from polyworld.world import World, geometry
from polyworld.world.representations.joint import Fixed, Hinge, Joint, Slider, Spring
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.symmetry import rotation_vector

Array = NDArray[np.float64]

EARLY = 16  # most samples from which a first place and rate are taken: with a curvature, as far as that describes them


@dataclass(frozen=True)
class Link:
    """One body of a linkage and the joint that holds it to its parent (-1: the world), in the world's description.

    forward: whether the body is the joint's `object`, which its stops refer to. rate: of its coordinate as described.
    free: whether the coordinate is one of a run's own; it is not where the body was not seen, and is as described then.
    """

    item: RigidObject
    joint: Joint
    parent: int
    axis: Array
    forward: bool
    rate: float
    free: bool

    @property
    def moves(self) -> bool:
        """Whether the joint has a coordinate."""
        return not isinstance(self.joint, Fixed)

    @property
    def stops(self) -> tuple[float, float]:
        """Least and greatest value of the coordinate."""
        lower, upper = getattr(self.joint, "lower", None), getattr(self.joint, "upper", None)
        low, high = -np.inf if lower is None else lower, np.inf if upper is None else upper
        return (low, high) if self.forward else (-high, -low)


@dataclass(frozen=True)
class _Motion:
    """How bodies of K worlds moved from where they are described: p goes to turn p + shift; twist is their rate.

    angle (K,): about the linkage's axis; turn (K, 3, 3), shift, spin (K, 3); velocity (K, 3) of the point of the body
    that is at the world's origin.
    """

    angle: Array
    turn: Array
    shift: Array
    spin: Array
    velocity: Array

    def of(self, point: Array) -> Array:
        """Return where points (K, 3) or (3,) go."""
        moved: Array = np.einsum("kij,kj->ki", self.turn, np.broadcast_to(point, self.shift.shape)) + self.shift
        return moved


@dataclass(frozen=True)
class Linkage:
    """A tree of links, parents first, all of whose hinges have parallel axes."""

    links: tuple[Link, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the coordinates, two a moving link: its angle [rad] or displacement [m], and the rate of it."""
        found = []
        for i, link in enumerate(self.links):
            if link.free:
                own = f"{link.item.name}." if i else ""
                found += [f"{own}{'displacement' if isinstance(link.joint, Slider) else 'angle'}", f"{own}rate"]
        return tuple(found)

    def overrides(self, values: Array, given: Mapping[str, Array]) -> dict[str, Array]:
        """Parameter path -> values (K,) for coordinates (K, N); `given`: parameters that differ from the description.

        Bodies' positions among the latter say where they are when all coordinates are 0.
        """
        found: dict[str, Array] = {}
        at = 0
        motions: list[_Motion] = []
        for link in self.links:
            q, rate = np.zeros(len(values)), np.full(len(values), link.rate)
            if link.free:
                q, rate = values[:, at], values[:, at + 1]
                at += 2
            path = f"joints.{link.joint.name}"
            anchor = _vectors(given, f"{path}.anchor", link.joint.anchor, len(values))
            place = _vectors(given, f"objects.{link.item.name}.position", link.item.position, len(values))
            parent = _still(len(values)) if link.parent < 0 else motions[link.parent]
            own = _moved(link, parent, anchor, q, rate)
            motions.append(own)
            centre = own.of(place)
            vectors = {
                f"objects.{link.item.name}.position": centre,
                f"objects.{link.item.name}.velocity": own.velocity + np.cross(own.spin, centre),
                f"objects.{link.item.name}.rotation": own.angle[:, None] * self._axis,
                f"objects.{link.item.name}.angular_velocity": own.spin,
            }
            if link.parent >= 0:
                vectors[f"{path}.anchor"] = parent.of(anchor)
            for name, vector in vectors.items():
                found |= {f"{name}.{axis}": vector[:, i] for i, axis in enumerate("xyz")}
            for stop in ("lower", "upper"):  # they are counted from the pose at the start
                described = getattr(link.joint, stop, None)
                if described is not None:
                    initial = q if link.forward else -q
                    found[f"{path}.{stop}"] = given.get(f"{path}.{stop}", np.full(len(values), described)) - initial
        return found

    def first_guess(self, run: Run) -> Array:
        """Return coordinates (N,) of a run's start, from the first samples of those of its bodies that were seen."""
        times = run.times - run.times[0] + run.lead
        motions: list[_Motion] = []
        found: list[float] = []
        for link in self.links:
            parent = _still(len(times)) if link.parent < 0 else motions[link.parent]
            q = self._seen(link, run, parent) if link.free else link.rate * times
            rows = np.flatnonzero(np.isfinite(q))
            if isinstance(link.joint, Hinge):
                q[rows] = np.unwrap(q[rows])
            if link.free and len(rows) < 2:
                found += [0.0, link.rate]
                q = link.rate * times
            elif link.free:
                if isinstance(link.joint, Hinge):
                    q = q + _turns_between(link.stops, float(q[rows[0]]))
                noise = max(float(np.nan_to_num(noise_level(times[rows], q[rows]))), 1e-9)
                free = free_stretch(times[rows], q[rows][:, None], np.ones(len(rows)), noise, 1)
                early = rows[: min(free, EARLY)]
                fitted = np.polyfit(times[early], q[early], min(2, len(early) - 1))
                found += [float(fitted[-1]), float(fitted[-2])]
            anchor = np.asarray(link.joint.anchor, dtype=float)
            motions.append(_moved(link, parent, anchor, q, np.zeros(len(times))))
        return np.array(found)

    def of_run(self, run: Run) -> Linkage:
        """Return the linkage with the coordinates of those bodies alone that a run shows."""
        return Linkage(tuple(replace(k, free=k.free and k.item.name in run.names) for k in self.links))

    @property
    def _axis(self) -> Array:
        return next((k.axis for k in self.links if isinstance(k.joint, Hinge)), np.zeros(3))

    def _seen(self, link: Link, run: Run, parent: _Motion) -> Array:
        """Return a link's coordinate at each instant of a run; NaN where nothing shows it."""
        unknown = np.full(len(run.times), np.nan)
        if link.item.name not in run.names:
            return unknown
        column = run.names.index(link.item.name)
        # What lies along the axis of turning need not have been measured.
        place = parent.of(np.asarray(link.item.position, dtype=float))
        flat = np.abs(self._axis) > 1.0 - 1e-9
        seen = np.where(flat & ~np.isfinite(run.positions[:, column]), place, run.positions[:, column])
        axis = np.einsum("kij,j->ki", parent.turn, link.axis)
        if isinstance(link.joint, Slider):
            known = np.where(np.isfinite(run.positions[:, column]), run.positions[:, column] - place, 0.0)
            weight = np.where(np.isfinite(run.positions[:, column]), axis**2, 0.0).sum(axis=1)
            along: Array = np.where(weight > 0.25, (known * axis).sum(axis=1) / np.maximum(weight, 1e-12), np.nan)
            return along
        pivot = parent.of(np.asarray(link.joint.anchor, dtype=float))
        arm = place - pivot
        arm = arm - axis * (axis * arm).sum(axis=1)[:, None]
        described = np.asarray(link.item.position) - np.asarray(link.joint.anchor)
        if float(np.linalg.norm(np.cross(described, link.axis))) > 1e-6:
            there = seen - pivot
            angle: Array = np.arctan2((there * np.cross(axis, arm)).sum(axis=1), (there * arm).sum(axis=1))
            return angle
        turned = np.all(np.isfinite(run.orientations[:, column]), axis=-1)
        first = np.broadcast_to(np.asarray(link.item.orientation), (int(turned.sum()), 4))
        unknown[turned] = rotation_vector(run.orientations[turned, column], first) @ link.axis - parent.angle[turned]
        return unknown


def linkages(world: World) -> tuple[Linkage, ...]:
    """Find the linkages of a world; bodies that joints hold otherwise (closed chains, ball joints, a hinge that another
    tilts, trees that begin at no wall) are in none."""
    joints = [j for j in world.joints if not isinstance(j, Spring)]
    tied = {a.to for a in world.attachments} | {p.object for p in world.pulleys}
    placed: dict[str, tuple[int, int]] = {}  # body -> its linkage and place in it
    found: list[list[Link]] = []
    left = list(joints)
    broken: set[int] = set()
    while left:
        ways = [(j, n, p) for j in left for n, p in ((j.object, j.other), (j.other, j.object)) if n is not None]
        ready = [way for way in ways if way[2] is None or way[2] in placed]
        if not ready:
            break
        joint, name, parent = ready[0]
        left.remove(joint)
        if name in placed:  # a closed chain, unless it is a door's other hinge
            own, at = placed[name]
            if not (parent is None and _same_hinge(world, found[own][at], joint)):
                broken |= {own} if parent is None else {own, placed[parent][0]}
            continue
        if parent is None:
            found.append([])
        number, above = (len(found) - 1, -1) if parent is None else placed[parent]
        axis, forward = _axis(world, joint), name == joint.object
        if any(isinstance(k.joint, Hinge) and k.axis @ axis < 0.0 for k in found[number]):
            axis, forward = -axis, not forward  # angles of one tree count one way round
        item, base = world.object(name), None if parent is None else world.object(parent)
        rate = _described_rate(joint, axis, item, base)
        link = Link(item, joint, above, axis, forward, rate, free=not isinstance(joint, Fixed))
        if name in tied or not _simple(link, found[number]):  # what a rope holds would be torn off it
            broken.add(number)
        found[number].append(link)
        placed[name] = (number, len(found[number]) - 1)
    return tuple(Linkage(tuple(links)) for i, links in enumerate(found) if i not in broken and links)


def _same_hinge(world: World, link: Link, joint: Joint) -> bool:
    """Return whether a joint lets a body that a link holds to the world turn as that does: its axis is the same
    line."""
    if not (isinstance(joint, Hinge) and isinstance(link.joint, Hinge) and link.parent < 0):
        return False
    offset = np.asarray(joint.anchor) - np.asarray(link.joint.anchor)
    off = (np.cross(_axis(world, joint), link.axis), np.cross(offset, link.axis))
    return all(float(np.linalg.norm(v)) < 1e-9 for v in off)


def _described_rate(joint: Joint, axis: Array, item: RigidObject, base: RigidObject | None) -> float:
    """Return how fast a joint's coordinate changes at the start in the world's description."""
    field = "velocity" if isinstance(joint, Slider) else "angular_velocity"
    own = np.asarray(getattr(item, field)) - (np.zeros(3) if base is None else np.asarray(getattr(base, field)))
    return float(own @ axis)


def _turns_between(stops: tuple[float, float], angle: float) -> float:
    """Return the full turns [rad] that bring an angle nearest to where stops let it be; of several the least."""
    whole = 2.0 * np.pi * np.array([0.0, 1.0, -1.0, 2.0, -2.0])
    beyond = np.maximum(stops[0] - (angle + whole), 0.0) + np.maximum(angle + whole - stops[1], 0.0)
    return float(whole[int(np.argmin(np.round(beyond, 9)))])


def is_held(world: World, name: str) -> bool:
    """Return whether joints other than springs hold an object."""
    return any(name in (j.object, j.other) for j in world.joints if not isinstance(j, Spring))


def _simple(link: Link, before: list[Link]) -> bool:
    """Return whether the link moves along or about an axis that no other of its tree turns."""
    if not isinstance(link.joint, Hinge | Slider | Fixed):
        return False
    hinges = [k.axis for k in before if isinstance(k.joint, Hinge)]
    return (
        not link.moves
        or all(float(np.linalg.norm(np.cross(link.axis, a))) < 1e-9 for a in hinges)
        or (isinstance(link.joint, Slider) and not _turned(link, before))
    )


def _turned(link: Link, before: list[Link]) -> bool:
    """Return whether a hinge lies between the link and the world."""
    above = link.parent
    while above >= 0:
        if isinstance(before[above].joint, Hinge):
            return True
        above = before[above].parent
    return False


def _axis(world: World, joint: Joint) -> Array:
    if not isinstance(joint, Hinge | Slider):
        return np.zeros(3)
    if world.planar and isinstance(joint, Hinge):
        normal: Array = geometry.plane_axes(world.environment.motion_plane)[2]
        return normal
    axis: Array = np.asarray(joint.axis, dtype=float) / np.linalg.norm(joint.axis)
    return axis


def _still(count: int) -> _Motion:
    zero = np.zeros((count, 3))
    return _Motion(np.zeros(count), np.repeat(np.eye(3)[None], count, axis=0), zero, zero, zero)


def _moved(link: Link, parent: _Motion, anchor: Array, q: Array, rate: Array) -> _Motion:
    """Return a link's motion: its parent's, and in its axes the joint's own by coordinates q (K,) with their rates
    (K,)."""
    axis = np.einsum("kij,j->ki", parent.turn, link.axis)
    if isinstance(link.joint, Slider):
        return _Motion(
            parent.angle,
            parent.turn,
            parent.shift + q[:, None] * axis,
            parent.spin,
            # The parent's own velocity field, at the point that is at the origin now.
            parent.velocity + rate[:, None] * axis,
        )
    pivot = parent.of(anchor)
    turn = geometry.quaternion_matrix(geometry.rotation_quaternion(q[:, None] * axis)) @ parent.turn
    spin = rate[:, None] * axis
    return _Motion(
        parent.angle + q,
        turn,
        pivot - np.einsum("kij,kj->ki", turn, np.broadcast_to(anchor, pivot.shape)),
        parent.spin + spin,
        parent.velocity - np.cross(spin, pivot),
    )


def _vectors(given: Mapping[str, Array], path: str, described: tuple[float, float, float], count: int) -> Array:
    """Return values (K, 3) of three components, as given where they are."""
    parts = [given.get(f"{path}.{axis}", np.full(count, described[i])) for i, axis in enumerate("xyz")]
    return np.stack(parts, axis=1)
