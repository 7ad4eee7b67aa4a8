"""Which nodes attachments hold, and to what."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from polyworld.model import DeformableMesh
from polyworld.world import World
from polyworld.world.representations.attachment import Attachment

Array = NDArray[np.float64]
Ints = NDArray[np.int32]


@dataclass
class Held:
    """Nodes held by attachments; lists of equal length.

    node: row of the nodes; attachment: index among the world's. For other deformable objects also target (three
    node rows, the third -1 on a segment), weight (three) and offset (three; in the axes of the triangle).
    """

    node: list[int] = field(default_factory=list)
    attachment: list[int] = field(default_factory=list)
    target: list[Ints] = field(default_factory=list)
    weight: list[Array] = field(default_factory=list)
    offset: list[Array] = field(default_factory=list)


def held_nodes(meshes: dict[str, DeformableMesh], attachment: Attachment) -> Ints:
    """Indices, in its own object, of the nodes an attachment holds.

    Raises ValueError where it holds none, or names one that does not exist.
    """
    mesh = meshes[attachment.object]
    count = len(mesh.nodes)
    if attachment.end is not None:  # the direction of a clamped end is held by the rope's bending
        return np.array([0 if attachment.end == "start" else count - 1], dtype=np.int32)
    if attachment.nodes is not None:
        wrong = [n for n in attachment.nodes if not 0 <= n < count]
        if wrong:
            raise ValueError(
                f"attachment {attachment.name!r}: {attachment.object!r} has nodes 0..{count - 1}, not {wrong}"
            )
        return np.unique(np.array(attachment.nodes, dtype=np.int32))
    assert attachment.region is not None
    low, high = np.asarray(attachment.region.lower), np.asarray(attachment.region.upper)
    inside = np.all((mesh.nodes >= low - 1e-9) & (mesh.nodes <= high + 1e-9), axis=1)
    if not inside.any():
        a, b = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
        raise ValueError(
            f"attachment {attachment.name!r}: no node of {attachment.object!r} is in its region {tuple(low)} to "
            f"{tuple(high)} at the start; the nodes lie in {tuple(np.round(a, 4))} to {tuple(np.round(b, 4))}"
        )
    return np.flatnonzero(inside).astype(np.int32)


def held_by_rope_stage(attachment: Attachment, world: World) -> bool:
    """Check whether the rope's own solver holds it: the end of a rope on a rigid object."""
    return attachment.end is not None and any(o.name == attachment.to for o in world.objects)


def nearest_on(mesh: DeformableMesh, p: Array) -> tuple[Ints, Array, Array]:
    """Nodes (3,), weights (3,) and offset (3,) of the point of an object that is nearest to p; see `Held`."""
    x = mesh.nodes
    if len(mesh.triangles) == 0:
        a, b = x[mesh.segments[:, 0]], x[mesh.segments[:, 1]]
        edge = b - a
        t = np.clip(((p - a) * edge).sum(axis=1) / (edge**2).sum(axis=1), 0.0, 1.0)
        points = a + t[:, None] * edge
        k = int(np.argmin(((points - p) ** 2).sum(axis=1)))
        nodes = np.array([*mesh.segments[k], -1], dtype=np.int32)
        return nodes, np.array([1.0 - t[k], t[k], 0.0]), p - points[k]
    corners = x[mesh.triangles]
    weights = _closest_weights(corners, p)
    points = (weights[:, :, None] * corners).sum(axis=1)
    k = int(np.argmin(((points - p) ** 2).sum(axis=1)))
    a, b, c = corners[k]
    along = (b - a) / np.linalg.norm(b - a)
    normal = np.cross(along, c - a)
    normal /= np.linalg.norm(normal)
    axes = np.stack([along, np.cross(normal, along), normal])
    return mesh.triangles[k].astype(np.int32), weights[k], axes @ (p - points[k])


def _closest_weights(corners: Array, p: Array) -> Array:
    """Barycentric weights (T, 3) of the points of triangles (T, 3, 3) that are closest to p."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    u, v, r = b - a, c - a, p - a
    uu, uv, vv = (u * u).sum(1), (u * v).sum(1), (v * v).sum(1)
    ur, vr = (u * r).sum(1), (v * r).sum(1)
    det = np.maximum(uu * vv - uv * uv, 1e-300)
    s, t = (vv * ur - uv * vr) / det, (uu * vr - uv * ur) / det
    best = np.stack([1 - s - t, s, t], axis=1)
    inside = (best >= 0).all(axis=1)
    nearest = np.where(inside, ((r - s[:, None] * u - t[:, None] * v) ** 2).sum(1), np.inf)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        start, side = corners[:, i], corners[:, j] - corners[:, i]
        f = np.clip(((p - start) * side).sum(1) / (side**2).sum(1), 0.0, 1.0)
        distance = ((start + f[:, None] * side - p) ** 2).sum(1)
        closer = distance < nearest
        edge = np.zeros_like(best)
        edge[:, i], edge[:, j] = 1 - f, f
        best = np.where(closer[:, None], edge, best)
        nearest = np.where(closer, distance, nearest)
    return best
