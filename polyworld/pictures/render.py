"""Pictures of a world through a camera: which object each pixel shows, how far away, and in what colour."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.pictures.deformable_pictures import View, drawn_deformable, starting_points
from polyworld.pictures.liquid_shading import WATER, with_liquid
from polyworld.pictures.rigid_pictures import drawn_solids, pulley_pose
from polyworld.pictures.scene import Drawn, Hits, Surface, cast_rays
from polyworld.world import World, geometry
from polyworld.world.camera import Camera
from polyworld.world.colors import display_color, rgb
from polyworld.world.shapes import Compound, Plane

Array = NDArray[np.float64]

GLASS, PANE = "glass", 0.3  # the material that is seen through, and the weight of its own colour
MARGIN = 0.06  # of the picture that a camera leaves free at each side


@dataclass(frozen=True)
class Picture:
    """Image of a world through a camera.

    labels (H, W), of n objects, rigid ones and then deformable ones: index of the object, n + index of the static,
    n + number of statics for the plane on which a planar world slides, one more + index for a pulley, or -1 where
    the ray meets nothing; things of material glass only where nothing is behind them. depth (H, W): distance along
    the camera's axis [m], inf where nothing. color (H, W, 3): shaded red, green, blue in 0..255. Walls and hollow
    bodies let a fluid behind them be seen in the colour alone.
    """

    labels: NDArray[np.int32]
    depth: NDArray[np.float32]
    color: NDArray[np.uint8]

    def mask(self, index: int) -> NDArray[np.bool_]:
        """The visible pixels (H, W) of one object or static."""
        seen: NDArray[np.bool_] = self.labels == index
        return seen


def render(
    world: World,
    positions: Array,
    orientations: Array,
    camera: Camera | None = None,
    *,
    points: Mapping[str, Array] | None = None,
    visible: Sequence[bool] | None = None,
) -> Picture:
    """Draw a world with its n objects at positions (n, 3) [m] and orientations (n, 4) w, x, y, z.

    Objects in the order of `World.moving_names`; rows of deformable ones are not looked at. points: nodes or
    particles (k, 3) [m] of the deformable objects by name, NaN for particles that are not there; default: as they
    start. camera: default the world's own, else `default_camera`. visible (n,): objects not drawn, for instance
    before they join. Pixel (column u, row v) shows the ray through image point (u, v), as `Camera.project` and
    OpenCV count. Ropes too thin to be seen are drawn a pixel or two wide. Raises ValueError for arrays that do not
    fit the world.
    """
    positions, orientations = np.asarray(positions, dtype=float), np.asarray(orientations, dtype=float)
    n = len(world.moving_names)
    if positions.shape != (n, 3) or orientations.shape != (n, 4):
        raise ValueError(
            f"the world has {n} objects: positions must be ({n}, 3) and orientations ({n}, 4), "
            f"got {positions.shape} and {orientations.shape}"
        )
    if visible is not None and len(visible) != n:
        raise ValueError(f"visible must have one entry for each of the {n} objects, got {len(visible)}")
    places = {**(starting_points(world) if world.deformables else {}), **(points or {})}
    unknown = sorted(set(places) - {item.name for item in world.deformables})
    if unknown:
        raise ValueError(f"points of {unknown}: deformable objects are {[d.name for d in world.deformables]}")
    everything = np.concatenate([positions[: len(world.objects)], *places.values()])
    camera = camera or world.camera or default_camera(world, everything)
    things = [
        *drawn_solids(world, positions, orientations, camera.centre),
        *_drawn_deformables(world, positions, orientations, places, camera),
    ]
    if visible is not None:
        things = [thing for thing in things if thing.label >= n or visible[thing.label]]
    glass = _glass(world)
    panes = [thing for thing in things if thing.label in glass]
    liquids = [thing for thing in things if isinstance(thing.form, Surface) and thing.form.liquid]
    clear = {thing.label for thing in (*panes, *liquids)}
    picture = cast_rays(camera, [thing for thing in things if thing.label not in clear])
    if liquids:
        picture = _with_liquids(world, camera, picture, liquids)
    if panes:
        picture = _behind_glass(picture, cast_rays(camera, panes))
    return Picture(picture.labels, picture.depth, np.clip(np.rint(picture.color * 255.0), 0, 255).astype(np.uint8))


def _drawn_deformables(
    world: World, positions: Array, orientations: Array, points: Mapping[str, Array], camera: Camera
) -> Iterator[Drawn]:
    """Yield the forms of a world's deformable objects."""
    wheels = []
    for pulley in world.pulleys:
        centre, axes = pulley_pose(world, pulley, positions, orientations)
        wheels.append(pulley.model_copy(update={"centre": tuple(centre), "axis": tuple(axes[:, 2])}))
    view = View(camera, wheels)
    for label, item in enumerate(world.deformables, start=len(world.objects)):
        form = drawn_deformable(world, item, points[item.name], view)
        color = display_color(item.appearance.color, label)
        if isinstance(form, Surface) and form.liquid:
            color = rgb(item.appearance.color) or WATER
        yield Drawn(label, color, form)


def _with_liquids(world: World, camera: Camera, solid: Hits, liquids: Sequence[Drawn]) -> Hits:
    """Lay liquids over what else is seen: they hide what is behind them, but for its colour."""
    assert world.fluid_grid is not None  # a world with a liquid has one
    liquid = cast_rays(camera, liquids)
    if not (liquid.labels >= 0).any():
        return solid
    n = len(world.moving_names)
    hollow = [i for i, o in enumerate(world.objects) if isinstance(o.shape, Compound)]
    walls = [n + i for i, s in enumerate(world.statics) if not isinstance(s.shape, Plane)]
    nearer = liquid.depth < solid.depth
    behind = (liquid.labels >= 0) & ~nearer & np.isin(solid.labels, hollow + walls)
    own = {thing.label: thing.color for thing in liquids}
    spacing = world.fluid_grid.cell / 2.0
    color = with_liquid(liquid, camera, solid.color, nearer, behind, own, spacing, planar=world.planar)
    return _chosen(nearer, liquid, solid, color)


def _glass(world: World) -> set[int]:
    """Labels of what is seen through: bodies and statics whose material is glass."""
    n = len(world.moving_names)
    bodies = {i for i, item in enumerate(world.objects) if item.appearance.material == GLASS}
    return bodies | {n + i for i, static in enumerate(world.statics) if static.appearance.material == GLASS}


def _behind_glass(seen: Hits, panes: Hits) -> Hits:
    """Lay panes over what is seen: what is behind them keeps its label and depth, if there is anything."""
    before = panes.depth < seen.depth
    color = seen.color.copy()
    color[before] = (1.0 - PANE) * seen.color[before] + PANE * panes.color[before]
    return _chosen(before & (seen.labels < 0), panes, seen, color)


def _chosen(first: NDArray[np.bool_], one: Hits, other: Hits, color: NDArray[np.float32]) -> Hits:
    """Labels and depths of one where `first` (H, W), of the other elsewhere."""
    labels, depth = np.where(first, one.labels, other.labels), np.where(first, one.depth, other.depth)
    return Hits(labels, depth, other.normals, color)


def default_camera(world: World, positions: Array, *, width: int | None = None, height: int | None = None) -> Camera:
    """A camera that sees every one of `positions` (..., 3) [m], from above and to the side.

    Objects moving in an upright plane are seen along its normal. The vertical field of view is 40 degrees. Worlds
    with deformable objects are seen less from above and as near as their positions and pulleys allow, in a larger
    picture (720 x 480 instead of 480 x 320).
    """
    width, height = width or (720 if world.deformables else 480), height or (480 if world.deformables else 320)
    points = np.asarray(positions, dtype=float).reshape(-1, 3)
    points = points[np.all(np.isfinite(points), axis=1)]
    rigid = [geometry.circumscribed_radius(o.shape) for o in world.objects]
    radius = max(rigid, default=0.0 if len(points) else 0.5)
    if world.pulleys:
        points = np.concatenate([points, [pulley.centre for pulley in world.pulleys]])
    if not len(points):
        points = np.zeros((1, 3))
    lower, upper = points.min(axis=0) - radius, points.max(axis=0) + radius
    target = (lower + upper) / 2
    reach = max(float(np.linalg.norm(upper - lower)) / 2, 1e-3)
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    upright = world.planar and abs(normal[2]) < 0.7
    direction = normal if upright else np.array([0.0, -0.8, 0.6])
    if world.deformables and not upright:
        direction = np.array([0.28, -0.88, 0.38])
    focal = height / 2 / np.tan(np.radians(20.0))
    distance = reach / np.sin(np.radians(20.0)) * 1.05
    far = look_at(target + distance * direction, target, focal=focal, width=width, height=height)
    if not world.deformables:
        return far
    return _nearer(far, target, points, radius, reach)


def _nearer(far: Camera, target: Array, points: Array, radius: float, least: float) -> Camera:
    """The camera moved along its axis, and across it, until balls of `radius` [m] about all points just fill it.

    least: it stays so far from the target [m].
    """
    focal, rotation = far.intrinsics[0][0], np.asarray(far.rotation)
    local = (points - target) @ rotation.T
    slopes = np.array([far.width, far.height]) * (1 - 2 * MARGIN) / 2 / focal
    margin = radius * np.sqrt(1.0 + slopes**2)
    shift, distance = np.zeros(2), 0.0
    for axis in range(2):
        # A point at depth z, x across is seen where |x - shift| + margin <= slope (z + distance).
        right = (local[:, axis] + margin[axis] - slopes[axis] * local[:, 2]).max()
        left = (-local[:, axis] + margin[axis] - slopes[axis] * local[:, 2]).max()
        shift[axis] = (right - left) / 2
        distance = max(distance, float(right + left) / 2 / slopes[axis])
    middle = target + shift @ rotation[:2]
    eye = middle - max(distance, 0.2 * least) * rotation[2]
    return look_at(eye, eye + rotation[2], focal=focal, width=far.width, height=far.height)


def look_at(eye: Array, target: Array, *, focal: float, width: int, height: int) -> Camera:
    """A camera at `eye` (3,) whose middle pixel shows `target` (3,), with world z up in the picture.

    focal [px]. Raises ValueError when eye and target coincide.
    """
    forward = np.asarray(target, dtype=float) - np.asarray(eye, dtype=float)
    length = float(np.linalg.norm(forward))
    if length < 1e-12:
        raise ValueError("a camera's eye and target must differ")
    forward /= length
    up = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    k = ((focal, 0.0, (width - 1) / 2), (0.0, focal, (height - 1) / 2), (0.0, 0.0, 1.0))
    translation = -rotation @ np.asarray(eye, dtype=float)
    return Camera.model_validate(
        {
            "width": width,
            "height": height,
            "intrinsics": k,
            "rotation": rotation.tolist(),
            "translation": translation.tolist(),
        }
    )
