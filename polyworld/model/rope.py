"""A rope divided into segments, and how it runs over its pulleys."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.model.mesh import DeformableMesh
from polyworld.world import World
from polyworld.world.representations.rope import Pulley, Rope

Array = NDArray[np.float64]

LEAST_GAP = 0.15  # between a node and the place where a wheel is touched, over the length of a segment
ARC_POINTS = 91  # at which the rope's way round a wheel is followed
PARALLEL = 1e-6  # square of the sine of an angle below which parts of a rope do not cross
TANGENT_PASSES = 60  # wheel-to-wheel tangents converge by a factor of a few a pass, at worst


@dataclass(frozen=True)
class Threading:
    """A rope as the sequence of nodes and wheels that it passes, with one link between consecutive ones.

    nodes (segments + 1, 3) [m]. pulleys (P,): the rope's pulleys in the order in which it passes them. order
    (segments + 1 + P,): what the rope passes: k >= 0 is node k, -1 - p is pulley p. rest (segments + P,): length
    without tension of each link [m]; one half of the arc that lies on a wheel belongs to each of its links.
    segment_length: rest length of a segment that touches no wheel. stretch: length of the way round its pulleys over
    that without tension, 1 for a slack rope and one without pulleys. wrap (P,): initial wrap angles [rad].
    arrives (P, 3): where the rope meets each wheel [m].
    """

    nodes: Array
    pulleys: tuple[Pulley, ...]
    order: NDArray[np.int32]
    rest: Array
    segment_length: float
    stretch: float
    wrap: Array
    arrives: Array


def rope_mesh(world: World, rope: Rope) -> DeformableMesh:
    """Nodes at equal distances along the rope, of which the arcs that lie on pulleys are left out.

    A node stands for half of each neighbouring segment; the rope on a wheel is moved by the wheel's equation
    (`polyworld.solver.rope`), and belongs to no node. Raises ValueError for pulleys that the rope cannot pass.
    """
    thread = threading(world, rope)
    count = len(thread.nodes)
    measure = np.full(count, thread.segment_length)
    measure[[0, -1]] *= 0.5
    ends = np.arange(count - 1, dtype=np.int32)
    return DeformableMesh(
        nodes=thread.nodes,
        measure=measure,
        radius=np.full(count, rope.radius),
        segments=np.stack([ends, ends + 1], axis=1),
    )


def pulleys_of(world: World, rope: Rope) -> tuple[Pulley, ...]:
    """Pulleys of a rope in the order in which it passes them."""
    return tuple(sorted((p for p in world.pulleys if p.rope == rope.name), key=lambda p: p.after))


def threading(world: World, rope: Rope) -> Threading:
    """How the rope lies at the start: straight between its points and the wheels it passes, round the wheels."""
    points = np.asarray(rope.points, dtype=float)
    pulleys = pulleys_of(world, rope)
    corners, arcs = _path(rope.name, points, pulleys)
    _check_crossings(rope, pulleys, corners, arcs)
    steps = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    steps[[k for k, _, _ in arcs]] = 0.0  # from the first tangent point of a wheel to the second
    along = np.concatenate([[0.0], np.cumsum(steps)])
    straight = float(along[-1])
    wrap = np.array([angle for _, angle, _ in arcs])
    hidden = np.array([angle * radius for _, angle, radius in arcs])
    total = straight + float(hidden.sum())
    wheels = [float(along[k]) for k, _, _ in arcs]
    places = _places(straight, rope.segments, wheels)
    nodes = np.stack([np.interp(places, along, corners[:, k]) for k in range(3)], axis=1)
    length = rope.length
    if length is None:  # of the chain itself, which cuts the corners: it begins without tension
        length = total if pulleys else float(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum())
    # A stretched rope is stretched uniformly; a slack one lies full length on its wheels.
    stretch = max(total / length, 1.0) if pulleys else 1.0
    on_wheels = hidden / stretch
    segment_length = (length - float(on_wheels.sum())) / rope.segments
    order, gaps = _order(rope, places, wheels)
    rest = gaps * (segment_length * rope.segments / straight)
    for p in range(len(pulleys)):
        k = int(np.flatnonzero(order == -1 - p)[0])
        rest[[k - 1, k]] += 0.5 * on_wheels[p]
    arrives = corners[[k for k, _, _ in arcs]]
    return Threading(nodes, pulleys, order, rest, segment_length, stretch, wrap, arrives)


def round_wheels(thread: Threading) -> Array:
    """Points (k, 3) of a rope's way round its wheels, on which it has no nodes [m]."""
    points = [np.zeros((0, 3))]
    for pulley, start, angle in zip(thread.pulleys, thread.arrives, thread.wrap, strict=True):
        centre, axis = np.asarray(pulley.centre, dtype=float), unit_axis(pulley)
        out = start - centre
        turn = np.linspace(0.0, angle, ARC_POINTS)[:, None]
        points.append(centre + np.cos(turn) * out + np.sin(turn) * np.cross(axis, out))
    return np.concatenate(points)


def _path(name: str, points: Array, pulleys: tuple[Pulley, ...]) -> tuple[Array, list[tuple[int, float, float]]]:
    """Corners of the straight parts, and for each wheel (index of its first tangent point, wrap angle, radius)."""
    stops: list[Array | Pulley] = []
    for k, point in enumerate(points):
        stops.append(point)
        stops.extend(p for p in pulleys if p.after == k)
    arrives = [_place(s) for s in stops]
    leaves = [_place(s) for s in stops]
    for _ in range(TANGENT_PASSES if pulleys else 0):
        for i, stop in enumerate(stops):
            if isinstance(stop, Pulley):
                arrives[i] = tangent_point(name, stop, leaves[i - 1], 1.0)
                leaves[i] = tangent_point(name, stop, arrives[i + 1], -1.0)
    corners: list[Array] = []
    arcs: list[tuple[int, float, float]] = []
    for i, stop in enumerate(stops):
        corners.append(arrives[i])
        if isinstance(stop, Pulley):
            arcs.append((len(corners) - 1, _wrap_angle(stop, arrives[i], leaves[i]), stop.radius))
            corners.append(leaves[i])
    return np.asarray(corners), arcs


def _check_crossings(
    rope: Rope, pulleys: tuple[Pulley, ...], corners: Array, arcs: list[tuple[int, float, float]]
) -> None:
    """Raise ValueError where a rope that leaves a wheel runs through itself, as it does past one on its wrong side."""
    on_wheels = {k for k, _, _ in arcs}
    parts = [k for k in range(len(corners) - 1) if k not in on_wheels] if pulleys else []
    for i, j in itertools.combinations(parts, 2):
        place = _crossing(corners[i : i + 2], corners[j : j + 2], 2.0 * rope.radius)
        between = [(angle, p.name) for (k, angle, _), p in zip(arcs, pulleys, strict=True) if i < k < j]
        if place is not None and between:
            angle, name = max(between)
            raise ValueError(
                f"rope {rope.name!r} runs through itself at {np.round(place, 4).tolist()}, with a wrap of "
                f"{np.degrees(angle):.0f} degrees on pulley {name!r}: give that pulley the other turns_positive, or "
                f"lead the rope's parts past each other by more than its diameter, {2.0 * rope.radius:g} m"
            )


def _crossing(a: Array, b: Array, near: float) -> Array | None:
    """Where two straight parts (2, 3) come nearer to each other than `near` between their ends; None if nowhere."""
    u, v, apart = a[1] - a[0], b[1] - b[0], a[0] - b[0]
    across = float((u @ u) * (v @ v) - (u @ v) ** 2)
    if across < PARALLEL * float((u @ u) * (v @ v)):
        return None
    s = ((u @ v) * (v @ apart) - (v @ v) * (u @ apart)) / across
    t = ((u @ u) * (v @ apart) - (u @ v) * (u @ apart)) / across
    inner = 0.0 < s < 1.0 and 0.0 < t < 1.0
    return a[0] + s * u if inner and np.linalg.norm(apart + s * u - t * v) < near else None


def _place(stop: Array | Pulley) -> Array:
    return np.asarray(stop.centre, dtype=float) if isinstance(stop, Pulley) else stop


def unit_axis(pulley: Pulley) -> Array:
    """The wheel's axis as a unit vector, turned so that the rope goes round it counter-clockwise."""
    axis = np.asarray(pulley.axis, dtype=float)
    unit: Array = axis / np.linalg.norm(axis) * (1.0 if pulley.turns_positive else -1.0)
    return unit


def tangent_point(rope: str, pulley: Pulley, point: Array, side: float) -> Array:
    """Where the straight line from a point meets the wheel: side 1 arrives at it, -1 leaves it.

    Raises ValueError for a point inside the wheel.
    """
    axis, centre = unit_axis(pulley), np.asarray(pulley.centre, dtype=float)
    out = point - centre
    out = out - axis * (out @ axis)
    distance = float(np.linalg.norm(out))
    if pulley.radius == 0.0:
        return centre
    beside = abs(float(axis @ (point - centre)))
    if beside > max(distance, pulley.radius):  # beyond 45 degrees no rope stays on a wheel
        raise ValueError(
            f"rope {rope!r} passes {point.tolist()}, {beside:.3g} m beside the wheel of pulley {pulley.name!r} along "
            f"its axis and {distance:.3g} m from that axis: put its centre, {centre.tolist()}, where the rope runs"
        )
    if distance <= pulley.radius:
        raise ValueError(
            f"rope {rope!r} passes {point.tolist()}, which is inside the wheel of pulley {pulley.name!r} (radius "
            f"{pulley.radius:g} m about {centre.tolist()}): move the rope's points away from it"
        )
    radial = out / distance
    cosine = pulley.radius / distance
    sine = side * np.sqrt(1.0 - cosine**2)
    offset: Array = pulley.radius * (cosine * radial + sine * np.cross(axis, radial))
    return centre + offset


def _wrap_angle(pulley: Pulley, arrives: Array, leaves: Array) -> float:
    if pulley.radius == 0.0:
        return 0.0
    centre, axis = np.asarray(pulley.centre, dtype=float), unit_axis(pulley)
    a, b = arrives - centre, leaves - centre
    angle = float(np.arctan2(axis @ np.cross(a, b), a @ b)) % (2.0 * np.pi)
    return 0.0 if angle > 2.0 * np.pi - 1e-9 else angle


def _places(straight: float, segments: int, wheels: list[float]) -> Array:
    """Distances of the nodes along the straight parts: equal, but that no node lies just where a wheel is touched."""
    places: Array = np.linspace(0.0, straight, segments + 1)
    least = LEAST_GAP * straight / segments
    for at in wheels:
        near = np.abs(places - at) < least
        near[[0, -1]] = False
        places[near] = at - least
    return places


def _order(rope: Rope, places: Array, wheels: list[float]) -> tuple[NDArray[np.int32], Array]:
    """Order of nodes and wheels, and the straight lengths between them."""
    order = [*range(len(places)), *(-1 - p for p in range(len(wheels)))]
    at = np.concatenate([places, wheels])
    ranked = np.argsort(at, kind="stable")
    passed = np.asarray(order, dtype=np.int32)[ranked]
    close = np.flatnonzero((passed[:-1] < 0) & (passed[1:] < 0))
    if len(close):
        gap = float(np.diff(at[ranked])[close].min())
        enough = f"at least {int(np.ceil(places[-1] / gap)) + 1} segments" if gap > 0 else "a point between them"
        raise ValueError(
            f"rope {rope.name!r}: two of its pulleys lie on one of its {rope.segments} segments; give it {enough}"
        )
    if passed[0] < 0 or passed[-1] < 0:
        raise ValueError(f"rope {rope.name!r}: a pulley lies at an end of it; let it begin and end away from wheels")
    return passed, np.diff(at[ranked])
