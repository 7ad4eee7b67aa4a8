"""Pictures of a world through a camera: which object each pixel shows, how far away, and in what colour."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.pictures import raycast
from polyworld.pictures.deformable_pictures import Raster, draw_solids, starting_points
from polyworld.pictures.liquid_shading import liquid_seen, with_liquid
from polyworld.pictures.raycast_mesh import cast_mesh
from polyworld.world import World, geometry
from polyworld.world.camera import Camera
from polyworld.world.colors import display_color
from polyworld.world.representations.rope import Pulley
from polyworld.world.shapes import Box, Capsule, Compound, ConvexMesh, Cylinder, Plane, Sphere, TriangleMesh, Wall

Array = NDArray[np.float64]
Shape = Sphere | Box | Cylinder | Capsule | ConvexMesh | Plane | Wall | TriangleMesh

BACKGROUND = (222, 226, 232)
STATIC_COLOR = "silver"
PULLEY_COLOR = "gray"
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


@dataclass
class _Placed:
    """Shapes to draw: label, kind, pose, size, bounding radius (inf where unbounded), half spaces."""

    label: list[int]
    kind: list[int]
    position: list[Array]
    rotation: list[Array]
    size: list[tuple[float, float, float]]
    bound: list[float]
    faces: list[Array]
    color: list[tuple[int, int, int]]
    meshes: list[tuple[int, TriangleMesh]]


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
    placed = _place(world, positions, orientations)
    rectangles = np.array([_rectangle(camera, p, b) for p, b in zip(placed.position, placed.bound, strict=True)])
    rectangles = rectangles.reshape(-1, 4)
    drawn = [visible is None or bool(visible[i]) for i in range(n)]
    for row, label in enumerate(placed.label):
        if label < n and not (drawn[label] and np.all(np.isfinite(positions[label]))):
            rectangles[row] = (0, -1, 0, -1)
    hidden = {name for name, shown in zip(world.moving_names, drawn, strict=True) if not shown}
    poses = [pulley_pose(world, pulley, positions, orientations) for pulley in world.pulleys]
    wheels = [
        pulley.model_copy(update={"centre": tuple(centre), "axis": tuple(axes[:, 2])})
        for pulley, (centre, axes) in zip(world.pulleys, poses, strict=True)
    ]
    glass = np.isin(placed.label, _glass(world))
    nothing = np.array([0, -1, 0, -1])
    picture = _cast(world, camera, placed, np.where(glass[:, None], nothing, rectangles), places, wheels, hidden)
    if not glass.any():
        return picture
    nobody = set(world.moving_names)
    panes = _cast(
        world, camera, placed, np.where(glass[:, None], rectangles, nothing), places, [], nobody, meshes=False
    )
    return _behind_glass(picture, panes)


def _glass(world: World) -> list[int]:
    """Labels of what is seen through: bodies and statics whose material is glass."""
    n = len(world.moving_names)
    bodies = [i for i, item in enumerate(world.objects) if item.appearance.material == GLASS]
    return bodies + [n + i for i, static in enumerate(world.statics) if static.appearance.material == GLASS]


def _behind_glass(picture: Picture, panes: Picture) -> Picture:
    """A picture with panes over it: what is behind them keeps its label and depth, if there is anything."""
    seen = (panes.labels >= 0) & (panes.depth < picture.depth)
    color = picture.color.astype(float)
    color[seen] = (1.0 - PANE) * color[seen] + PANE * panes.color[seen]
    alone = seen & (picture.labels < 0)
    return Picture(
        labels=np.where(alone, panes.labels, picture.labels),
        depth=np.where(alone, panes.depth, picture.depth),
        color=np.rint(color).astype(np.uint8),
    )


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


def _place(world: World, positions: Array, orientations: Array) -> _Placed:
    placed = _Placed([], [], [], [], [], [], [], [], [])
    rotations = geometry.quaternion_matrix(orientations)
    n = len(world.moving_names)
    for index, item in enumerate(world.objects):
        color = display_color(item.appearance.color, index)
        for piece in geometry.pieces(item.shape):
            place = positions[index] + rotations[index] @ piece.position
            _add(placed, index, piece.shape, place, rotations[index] @ piece.rotation, color)
    for index, static in enumerate(world.statics):
        rotation = geometry.quaternion_matrix(np.asarray(static.orientation))
        color = display_color(static.appearance.color or STATIC_COLOR, 0)
        _add(placed, n + index, static.shape, np.asarray(static.position), rotation, color)
    first = n + len(world.statics)
    plane = world.environment.motion_plane
    if world.planar and plane.supports and float(np.dot(world.environment.gravity, plane.normal)) < 0.0:
        surface = Plane(normal=plane.normal, offset=0.0)
        _add(placed, first, surface, np.asarray(plane.point), np.eye(3), display_color(STATIC_COLOR, 0))
    for index, pulley in enumerate(world.pulleys):
        centre, axes = pulley_pose(world, pulley, positions, orientations)
        rope = world.deformable(pulley.rope)
        thick = float(getattr(rope, "radius", 0.0))
        wheel = Cylinder(
            radius=max(pulley.radius - thick, 1.5 * thick), half_height=max(2 * thick, 0.1 * pulley.radius)
        )
        _add(placed, first + 1 + index, wheel, centre, axes, display_color(PULLEY_COLOR, 0))
    return placed


def pulley_pose(world: World, pulley: Pulley, positions: Array, orientations: Array) -> tuple[Array, Array]:
    """Centre (3,) [m] of a pulley and axes (3, 3) whose third column is the wheel's, objects being as in `render`."""
    centre, axis = np.asarray(pulley.centre, dtype=float), np.asarray(pulley.axis, dtype=float)
    axes = _frame(axis / np.linalg.norm(axis))
    if pulley.object is None:
        return centre, axes
    item = world.object(pulley.object)
    index = world.moving_names.index(pulley.object)
    start = geometry.quaternion_matrix(np.asarray(item.orientation))
    turn = geometry.quaternion_matrix(np.asarray(orientations[index])) @ start.T
    return np.asarray(positions[index]) + turn @ (centre - np.asarray(item.position)), turn @ axes


def _add(
    placed: _Placed, label: int, shape: Shape, position: Array, rotation: Array, color: tuple[int, int, int]
) -> None:
    kind, size, faces = raycast.BOX, (0.0, 0.0, 0.0), np.zeros((0, 4))
    if isinstance(shape, Wall):
        box, centre, turn = geometry.wall_box(shape)
        position, rotation, shape = position + rotation @ centre, rotation @ turn, box
    if isinstance(shape, Plane):
        # Drawn in a frame whose z is the normal and whose origin lies on the surface.
        normal = np.asarray(shape.normal, dtype=float) / np.linalg.norm(shape.normal)
        position, rotation = position + rotation @ (normal * shape.offset), rotation @ _frame(normal)
        kind = raycast.PLANE
    elif isinstance(shape, Sphere):
        kind, size = raycast.SPHERE, (shape.radius, 0.0, 0.0)
    elif isinstance(shape, Box):
        size = shape.half_extents
    elif isinstance(shape, Cylinder | Capsule):
        kind = raycast.CYLINDER if isinstance(shape, Cylinder) else raycast.CAPSULE
        size = (shape.radius, shape.half_height, 0.0)
    elif isinstance(shape, ConvexMesh):
        kind, faces = raycast.CONVEX, _half_spaces(shape)
    else:
        placed.meshes.append((len(placed.kind), shape))
        kind = -1  # drawn by its own kernel
    placed.label.append(label)
    placed.kind.append(int(kind))
    placed.position.append(np.asarray(position, dtype=float))
    placed.rotation.append(np.asarray(rotation, dtype=float))
    placed.size.append(size)
    placed.bound.append(_bounding_radius(shape))
    placed.faces.append(faces)
    placed.color.append(color)


def _bounding_radius(shape: Shape) -> float:
    """Radius about the shape's origin that holds all of it; inf for what has no bound or its own test."""
    if isinstance(shape, Sphere):
        return shape.radius
    if isinstance(shape, Box):
        return float(np.linalg.norm(shape.half_extents))
    if isinstance(shape, Cylinder):
        return float(np.hypot(shape.radius, shape.half_height))
    if isinstance(shape, Capsule):
        return shape.radius + shape.half_height
    if isinstance(shape, ConvexMesh):
        return float(np.linalg.norm(geometry.hull(shape).vertices, axis=1).max())
    return float("inf")


@lru_cache(maxsize=512)
def _half_spaces(shape: ConvexMesh) -> Array:
    """Rows (normal, offset) of a hull's faces, shape (m, 4)."""
    solid = geometry.hull(shape)
    normals = np.asarray(solid.face_normals, dtype=float)
    offsets = np.einsum("ij,ij->i", normals, np.asarray(solid.triangles, dtype=float)[:, 0])
    rows: Array = np.unique(np.round(np.column_stack([normals, offsets]), 12), axis=0)  # coplanar triangles share one
    return rows


@lru_cache(maxsize=32)
def _mesh(shape: TriangleMesh) -> Any:
    points: Any = wp.array(np.asarray(shape.vertices, dtype=np.float32), dtype=wp.vec3, device="cpu")
    indices: Any = wp.array(np.asarray(shape.faces, dtype=np.int32).ravel(), dtype=wp.int32, device="cpu")
    return wp.Mesh(points=points, indices=indices)


def _frame(normal: Array) -> Array:
    """A rotation (3, 3) whose third column is the unit vector `normal`; the identity for +z."""
    helper = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = helper - (helper @ normal) * normal
    x /= np.linalg.norm(x)
    frame: Array = np.stack([x, np.cross(normal, x), normal], axis=1)
    return frame


def _rectangle(camera: Camera, centre: Array, bound: float) -> tuple[int, int, int, int]:
    """First and last column, first and last row, of the pixels that can show a ball; the whole image if unbounded."""
    whole = (0, camera.width - 1, 0, camera.height - 1)
    if not np.isfinite(bound) or not np.all(np.isfinite(centre)):
        return whole
    offsets = bound * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    corners = camera.to_camera(centre) + offsets
    if corners[:, 2].max() <= 0.0:
        return (0, -1, 0, -1)
    if corners[:, 2].min() <= 1e-6:
        return whole
    image = corners @ np.asarray(camera.intrinsics).T
    pixels = np.clip(image[:, :2] / image[:, 2:], -1e6, 1e6)
    first, last = np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0))
    return int(first[0]), int(last[0]), int(first[1]), int(last[1])


def _cast(
    world: World,
    camera: Camera,
    placed: _Placed,
    rectangles: NDArray[np.int64],
    points: Mapping[str, Array],
    wheels: Sequence[Pulley],
    hidden: set[str],
    *,
    meshes: bool = True,
) -> Picture:
    rotation = np.asarray(camera.rotation)
    pixel_to_ray = rotation.T @ np.linalg.inv(np.asarray(camera.intrinsics))
    origin = camera.centre
    light = rotation.T @ np.array([-0.35, -0.75, -0.56])  # over the viewer's left shoulder
    light /= np.linalg.norm(light)
    shape = (camera.height, camera.width)
    counts = [len(f) for f in placed.faces]
    first = np.concatenate([[0], np.cumsum(counts)])[:-1] if counts else np.zeros(0)
    faces = np.concatenate([*placed.faces, np.zeros((1, 4))])

    def array(values: Any, dtype: Any, numpy_type: Any, width: int = 0) -> Any:
        rows = np.asarray(values, dtype=numpy_type)
        return wp.array(rows.reshape(-1, width) if width else rows.reshape(-1), dtype=dtype, device="cpu")

    colors = np.asarray(placed.color, dtype=np.float32).reshape(-1, 3) / 255.0
    matrices = np.asarray(placed.rotation, dtype=np.float32).reshape(-1, 3, 3)
    labels: Any = wp.full(shape, -1, dtype=int, device="cpu")
    distance: Any = wp.full(shape, 1.0e30, dtype=float, device="cpu")
    color: Any = wp.full(shape, wp.vec3(*(c / 255.0 for c in BACKGROUND)), dtype=wp.vec3, device="cpu")
    view = [wp.vec3(*origin), wp.mat33(*pixel_to_ray.ravel())]
    wp.launch(
        raycast.cast,
        dim=shape,
        inputs=[
            *view,
            array(placed.label, int, np.int32),
            array(placed.kind, int, np.int32),
            array(placed.position, wp.vec3, np.float32, 3),
            wp.array(matrices, dtype=wp.mat33, device="cpu"),
            array(placed.size, wp.vec3, np.float32, 3),
            array(first, int, np.int32),
            array(counts, int, np.int32),
            array(faces, wp.vec4, np.float32, 4),
            wp.array(colors, dtype=wp.vec3, device="cpu"),
            array(rectangles, wp.vec4i, np.int32, 4),
            wp.vec3(*light),
            _tile_size(camera),
            labels,
            distance,
            color,
        ],
        device="cpu",
    )
    for row, mesh in placed.meshes if meshes else ():
        wp.launch(
            cast_mesh,
            dim=shape,
            inputs=[
                *view,
                _mesh(mesh).id,
                wp.vec3(*placed.position[row]),
                wp.mat33(*placed.rotation[row].ravel()),
                wp.vec3(*(c / 255.0 for c in placed.color[row])),
                placed.label[row],
                wp.vec3(*light),
                labels,
                distance,
                color,
            ],
            device="cpu",
        )
    raster = Raster(camera, pixel_to_ray, light, labels, distance, color)
    draw_solids(world, points, wheels, raster, hidden, len(world.objects))
    return _with_fluids(world, points, raster, hidden)


def _with_fluids(world: World, points: Mapping[str, Array], raster: Raster, hidden: set[str]) -> Picture:
    """The finished picture, fluids laid over what was drawn."""
    labels, distance = raster.labels.numpy().astype(np.int32), raster.distance.numpy()
    color = raster.color.numpy()
    liquid = liquid_seen(world, points, raster.camera, raster.pixel_to_ray, hidden)
    if liquid is not None:
        n = len(world.moving_names)
        hollow = [i for i, o in enumerate(world.objects) if isinstance(o.shape, Compound)]
        walls = [n + i for i, s in enumerate(world.statics) if not isinstance(s.shape, Plane)]
        color = with_liquid(
            liquid, raster, color.astype(float), distance.astype(float), np.isin(labels, hollow + walls)
        )
        nearer = liquid.distance < distance
        labels = np.where(nearer, len(world.objects) + liquid.nearest, labels).astype(np.int32)
        distance = np.where(nearer, liquid.distance, distance).astype(np.float32)
    return Picture(
        labels=labels,
        depth=_axial(raster.camera, distance),
        color=np.clip(np.rint(color * 255.0), 0, 255).astype(np.uint8),
    )


def _axial(camera: Camera, distance: NDArray[np.float32]) -> NDArray[np.float32]:
    """Distances along rays (H, W) to depths along the camera's axis; inf where nothing was hit."""
    inverse = np.linalg.inv(np.asarray(camera.intrinsics))
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ inverse.T
    depth = distance / np.linalg.norm(rays, axis=-1)
    return np.where(distance >= 1.0e30, np.inf, depth).astype(np.float32)


def _tile_size(camera: Camera) -> float:
    """Edge of the tiles of a plane [m]: the power of ten, or half of one, that puts a handful across the view."""
    across = 2.0 * float(np.linalg.norm(camera.centre)) * camera.width / 2.0 / camera.intrinsics[0][0]
    exponent = np.floor(np.log10(max(across, 1e-6) / 4.0))
    step = float(10.0**exponent)
    return 5.0 * step if across / (5.0 * step) > 4.0 else step
