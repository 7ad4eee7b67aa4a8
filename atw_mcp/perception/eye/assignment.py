"""Assignment: which look-alike is which over the whole clip, by the motion before and after each meeting."""

from __future__ import annotations

import itertools

import numpy as np

from atw_mcp.perception.eye.colours import Colours
from atw_mcp.perception.eye.follow import States
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.pixels import Floats

Order = tuple[int, ...]
"""For each body the number of the piece of track that is its own."""


def reassign(scene: Scene, states: list[States], seeds: list[dict[int, Floats]]) -> list[States]:
    """Exchange tracks of bodies of one kind after meetings where that makes all motion smoothest; seeds hold.

    Dynamic programming over the meetings in their order: each continues the tracks that met in any permutation, at the
    price of the change of motion across it, in squared standard deviations. The scene's poses are set.
    """
    alike = _kinds(scene)
    meetings = [m for m in _meetings(scene, states) if alike[m[2]] == alike[m[3]]]
    if not meetings:
        return states
    same: Order = tuple(range(len(states)))
    best: dict[Order, tuple[float, list[Order]]] = {same: (0.0, [])}
    for first, last, a, b in meetings:
        following: dict[Order, tuple[float, list[Order]]] = {}
        for order, (price, history) in best.items():
            for exchanged in (False, True):
                after = list(order)
                if exchanged:
                    after[order.index(a)], after[order.index(b)] = b, a
                cost = price + _bend(scene, states, a, b if exchanged else a, first, last)
                cost += _bend(scene, states, b, a if exchanged else b, first, last)
                key = tuple(after)
                if key not in following or cost < following[key][0]:
                    following[key] = (cost, [*history, key])
        kept = sorted(following.items(), key=lambda item: item[1][0])[: scene.settings.orders]
        best = dict(kept)
    allowed = [c for c in best.values() if _holds(meetings, c[1], seeds, same)]
    if not allowed:
        return states
    orders = min(allowed, key=lambda c: c[0])[1]
    found: list[States] = [{} for _ in states]
    for i, k in itertools.product(range(len(states)), range(scene.film.count)):
        piece = _order_at(meetings, orders, same, k)[i]
        if k in states[piece]:
            found[i][k] = states[piece][k]
        scene.poses[i, k] = found[i][k].fit.pose if k in found[i] else np.nan
    return found


def _kinds(scene: Scene) -> list[int]:
    """Number of each body's kind: bodies of one kind have about the same size and explain each other's colours."""
    kinds: list[int] = []
    for i, body in enumerate(scene.bodies):
        kind = i
        for j in range(i):
            own, other = scene.colours[i], scene.colours[j]
            seen = [np.flatnonzero(np.isfinite(scene.poses[m, :, 0])) for m in (i, j)]
            if own is None or other is None or type(body) is not type(scene.bodies[j]) or not all(len(s) for s in seen):
                continue
            sizes = [scene.bodies[m].unit[0] for m in (i, j)]
            shape = [getattr(scene.bodies[m], "kind", "outline") for m in (i, j)]
            apart = min(_apart(own, other), _apart(other, own))
            if abs(np.log(sizes[0] / sizes[1])) < 0.25 and shape[0] == shape[1] and apart < 2.0:
                kind = kinds[j]
                break
        kinds.append(kind)
    return kinds


def _apart(one: Colours, other: Colours) -> float:
    """Mean distance [standard deviations] of a body's colours from the nearest of another's."""
    away = np.abs((one.means[:, None] - other.means) / np.hypot(one.spreads[:, None], other.spreads))
    return float(away.max(-1).min(1).mean())


def _meetings(scene: Scene, states: list[States]) -> list[tuple[int, int, int, int]]:
    """Meetings (first frame, last frame, body, body) of bodies whose silhouettes touch or nearly do, in their order."""
    found = []
    for a, b in itertools.combinations(range(len(states)), 2):
        near = []
        for k in sorted(set(states[a]) & set(states[b])):
            one, other = states[a][k].fit.pose, states[b][k].fit.pose
            reach = scene.bodies[a].radius(one) + scene.bodies[b].radius(other)
            if (
                np.linalg.norm(scene.bodies[a].centre(one) - scene.bodies[b].centre(other))
                < scene.settings.meeting * reach
            ):
                near.append(k)
        for group in np.split(np.array(near), np.flatnonzero(np.diff(near) > 2) + 1) if near else []:
            found.append((int(group[0]), int(group[-1]), a, b))
    return sorted(found)


def _bend(scene: Scene, states: list[States], before: int, after: int, first: int, last: int) -> float:
    """Squared change [standard deviations] of motion from a track before a meeting to one after it."""
    s = scene.settings
    body = scene.bodies[before]
    ahead = [k for k in sorted(states[before]) if k < first][-s.gap :]
    behind = [k for k in sorted(states[after]) if k > last][: s.gap]
    if len(ahead) < 2 or len(behind) < 2:
        return 0.0
    lines = []
    for frames, track in ((ahead, before), (behind, after)):
        places = np.array([scene.bodies[track].centre(states[track][k].fit.pose) for k in frames])
        lines.append(np.polyfit(np.array(frames, float), places, 1))
    middle = 0.5 * (first + last)
    radius = body.radius(states[before][ahead[-1]].fit.pose)
    turn = (lines[0][0] - lines[1][0]) / (s.motion * radius)
    gap = (lines[0][0] - lines[1][0]) * middle + lines[0][1] - lines[1][1]
    return float(np.log1p((turn**2).sum()) + np.log1p(((gap / radius) ** 2).sum()))


def _order_at(meetings: list[tuple[int, int, int, int]], orders: list[Order], same: Order, frame: int) -> Order:
    """Pieces of all bodies in a frame: the order after the last meeting whose middle has passed."""
    order = same
    for (first, last, _, _), after in zip(meetings, orders, strict=True):
        if 2 * frame > first + last:
            order = after
    return order


def _holds(
    meetings: list[tuple[int, int, int, int]], orders: list[Order], seeds: list[dict[int, Floats]], same: Order
) -> bool:
    """Whether every body keeps its own track in the frames of its seeds."""
    return all(_order_at(meetings, orders, same, k)[i] == i for i, own in enumerate(seeds) for k in own)
