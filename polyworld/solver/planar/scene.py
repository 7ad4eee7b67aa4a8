"""A planar world as the arrays of `records.Scene`: outlines, and pairs that can meet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.model import Model
from polyworld.solver.planar.records import Scene
from polyworld.world import StaticObject, geometry
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Plane, Wall

Array = NDArray[np.float64]

TOUCH = 1e-6  # contact band, in radii of the smallest body: far below what an observation resolves
SKIN = 0.25  # margin of the near list, in mean radii


@dataclass(frozen=True)
class Outline:
    """A body's or static's cross-section: convex polygon (k, 2) about `pose`, swept by a disc.

    k = 0 marks a half plane; `pose` is then its outward normal and offset. low, high: extent along the
    normal of the motion plane [m].
    """

    vertices: Array
    sweep: float
    pose: tuple[float, float, float]
    low: float
    high: float


def body_outline(item: RigidObject, axes: Array) -> Outline:
    """Cross-section of an object in its initial orientation."""
    rotation = geometry.quaternion_matrix(np.asarray(item.orientation))
    vertices, sweep = geometry.planar_outline(item.shape, rotation, axes)
    low, high = _extent(item.shape, rotation, np.asarray(item.position), axes[2])
    return Outline(vertices, sweep, (0.0, 0.0, 0.0), low, high)


def static_outline(item: StaticObject, axes: Array, point: Array) -> Outline | None:
    """Cross-section of a static; None for a plane parallel to the motion plane, which nothing can run into."""
    if isinstance(item.shape, Plane):
        rotation = geometry.quaternion_matrix(np.asarray(item.orientation))
        normal = np.asarray(item.shape.normal, dtype=float)
        normal = rotation @ (normal / np.linalg.norm(normal))
        offset = item.shape.offset + normal @ np.asarray(item.position)
        flat = axes[:2] @ normal
        length = float(np.linalg.norm(flat))
        if length < 1e-6:
            return None
        # Where the plane cuts the motion plane, which passes through `point`.
        rest = offset - (axes[2] @ normal) * (axes[2] @ point)
        return Outline(
            np.zeros((0, 2)), 0.0, (flat[0] / length, flat[1] / length, float(rest) / length), -np.inf, np.inf
        )
    if isinstance(item.shape, Wall):
        shape: Any
        shape, centre, rotation = geometry.wall_box(item.shape)
        orientation = geometry.quaternion_matrix(np.asarray(item.orientation))
        centre, rotation = orientation @ centre + np.asarray(item.position), orientation @ rotation
    else:
        shape, centre = item.shape, np.asarray(item.position, dtype=float)
        rotation = geometry.quaternion_matrix(np.asarray(item.orientation))
    vertices, sweep = geometry.planar_outline(shape, rotation, axes)
    low, high = _extent(shape, rotation, centre, axes[2])
    x, y = axes[:2] @ centre
    return Outline(vertices, sweep, (float(x), float(y), 0.0), low, high)


def build_scene(model: Model) -> tuple[Scene, Array]:
    """Build the scene of a planar world without its schedule and effects; also return the statics' poses (s, 3)."""
    world, axes = model.world, model.plane_axes
    plane = world.environment.motion_plane
    bodies = [body_outline(o, axes) for o in world.objects]
    statics = [static_outline(s, axes, np.asarray(plane.point)) for s in world.statics]
    absent = Outline(np.zeros((0, 2)), 0.0, (1.0, 0.0, -np.inf), np.inf, -np.inf)
    outlines = bodies + [absent if s is None else s for s in statics]
    n = len(bodies)
    bound = [o.sweep + float(np.linalg.norm(o.vertices, axis=1).max(initial=0.0)) for o in outlines]
    collides = _overlaps(outlines, n)
    collides[world.passing()] = 0
    volumes = [solid.volume for solid in model.solids]
    scene = Scene()
    scene.bodies = n
    scene.statics = len(statics)
    scene.supports = int(plane.supports)
    scene.level = float(axes[2] @ np.asarray(plane.point))
    vertices = np.concatenate([o.vertices for o in outlines]) if outlines else np.zeros((0, 2))
    normals = np.concatenate([edge_normals(o.vertices) for o in outlines]) if outlines else np.zeros((0, 2))
    scene.vertices = buffers.array(vertices, wp.vec2d)
    scene.normals = buffers.array(normals, wp.vec2d)
    scene.first = buffers.ints(np.concatenate([[0], np.cumsum([len(o.vertices) for o in outlines])]))
    scene.sweep = buffers.doubles([o.sweep for o in outlines])
    scene.bound = buffers.doubles(bound)
    scene.depth = buffers.doubles([leap_limit(o) for o in outlines])
    scene.collides = buffers.ints(collides)
    scene.touch = TOUCH * min(bound[:n])
    scene.skin = SKIN * float(np.mean(bound[:n]))
    scene.axes = wp.mat33d(*axes.ravel())
    scene.effect_radius = buffers.doubles([(0.75 * v / np.pi) ** (1 / 3) for v in volumes])
    poses = np.array([o.pose for o in outlines[n:]]).reshape(-1, 3)
    return scene, poses


def edge_normals(vertices: Array) -> Array:
    """Outward normals (k, 2) of a counter-clockwise polygon's edges; a disc has none (one zero row)."""
    if len(vertices) < 2:
        return np.zeros((len(vertices), 2))
    edge = np.roll(vertices, -1, axis=0) - vertices
    normals: Array = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.linalg.norm(edge, axis=1, keepdims=True)
    return normals


def leap_limit(outline: Outline) -> float:
    """Half the radius of the largest circle about the centre that fits inside [m]."""
    if len(outline.vertices) < 3:
        return 0.5 * outline.sweep
    inner = np.einsum("ij,ij->i", edge_normals(outline.vertices), outline.vertices).min()
    return 0.5 * (outline.sweep + max(float(inner), 0.0))


def _extent(shape: Any, rotation: Array, centre: Array, normal: Array) -> tuple[float, float]:
    # The outline seen from the side: project on a plane that contains the normal.
    aside = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    aside = aside - (aside @ normal) * normal
    aside /= np.linalg.norm(aside)
    side = np.stack([aside, normal, np.cross(aside, normal)])
    vertices, sweep = geometry.planar_outline(shape, rotation, side)
    height = float(normal @ centre)
    return height + float(vertices[:, 1].min()) - sweep, height + float(vertices[:, 1].max()) + sweep


def _overlaps(outlines: list[Outline], n: int) -> NDArray[np.int32]:
    """Return whether the extents of the first n outlines along the plane's normal overlap those of all (n, n + s)."""
    slack = 1e-9
    low = np.array([o.low for o in outlines]).reshape(1, -1)
    high = np.array([o.high for o in outlines]).reshape(1, -1) - slack
    above, below = low < high[:, :n].T, high > low[:, :n].T
    found: NDArray[np.int32] = (above & below).astype(np.int32)
    return found
