"""From an observation to a world: which representation, which shapes, where everything starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from polyworld.camera import Camera
from polyworld.description import Appearance
from polyworld.geometry import hull, planar_outline
from polyworld.initial_states import initial_states, with_initial_states
from polyworld.representations.rigid import RigidObject
from polyworld.shapes import BodyShape, Box, Capsule, Compound, ConvexMesh, Cylinder, Plane, Sphere
from polyworld.tracks import ObservedTracks
from polyworld.world import Effect, Environment, MotionPlane, StaticObject, TimeBase, World

Representation = Literal["auto", "planar", "spatial"]

# An object counts as staying on its plane while its height varies less than this share of its half height,
# or than this many standard deviations of its measured position.
HEIGHT_SHARE, HEIGHT_SIGMAS = 0.25, 4.0
MOST_VERTICES = 256  # of a convex mesh
TRUST = 0.5  # an object begins at the first sample with this share of its median confidence


@dataclass(frozen=True)
class ObservedObject:
    """What was seen of an object beside its motion; None where it was not."""

    name: str
    shape: BodyShape | None = None
    color: str | None = None
    material: str | None = None


@dataclass(frozen=True)
class Given:
    """What the agent says about one object; None leaves it to the observation or to the default."""

    shape: BodyShape | None = None
    mass: float | None = None
    density: float | None = None
    friction: float | None = None
    restitution: float | None = None
    rolling_resistance: float | None = None
    linear_damping: float | None = None
    angular_damping: float | None = None
    color: str | None = None
    material: str | None = None


@dataclass(frozen=True)
class Scene:
    """What surrounds the objects. floor_height [m] is where they rest; None: nothing supports them."""

    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    floor_height: float | None = 0.0
    motion_plane: MotionPlane | None = None
    statics: tuple[StaticObject, ...] = ()
    effects: tuple[Effect, ...] = ()


@dataclass(frozen=True)
class Built:
    """A world, and every choice made on the way that the agent did not make itself."""

    world: World
    representation: Literal["planar", "spatial"]
    why: str
    assumed: tuple[str, ...] = field(default=())
    left_out: tuple[str, ...] = field(default=())


def build_world(
    tracks: ObservedTracks,
    objects: Sequence[ObservedObject],
    *,
    given: Mapping[str, Given],
    chosen: Sequence[str] | None = None,
    scene: Scene,
    representation: Representation = "auto",
    heights_assumed: bool = False,
    time: TimeBase,
    camera: Camera | None = None,
) -> Built:
    """A world of the tracked objects, each placed and set in motion as its track begins.

    chosen: names of the tracks to model (default all). heights_assumed: the tracks were got by assuming that
    objects stay on the floor, so their height says nothing. Raises ValueError or KeyError for unknown names and
    for objects whose shape is neither observed nor given.
    """
    seen = {item.name: item for item in objects}
    names = list(tracks.names if chosen is None else chosen)
    unknown = sorted((set(names) | set(given)) - set(tracks.names))
    if unknown:
        raise ValueError(f"no tracks {unknown}; tracks: {list(tracks.names)}")
    tracks = from_trusted_start(tracks)
    states = initial_states(tracks, seconds_per_frame=time.seconds_per_frame)
    left_out = tuple(f"{name}: observed in fewer than two frames" for name in names if name not in states)
    names = [name for name in names if name in states]
    if not names:
        raise ValueError(f"there is no object to place: {'; '.join(left_out) or 'no track was chosen'}")
    shapes = _shapes(names, seen, given)
    kind, why = _representation(representation, tracks.select(names), shapes, scene, heights_assumed)
    bodies = tuple(
        _body(name, shapes[name], seen.get(name), given.get(name, Given()), kind, scene, states[name].position)
        for name in names
    )
    floor: tuple[StaticObject, ...] = ()
    plane = scene.motion_plane
    if plane is None:
        # Without a floor the plane is still where the objects move; it just does not press back.
        plane = MotionPlane(point=(0.0, 0.0, scene.floor_height or 0.0), supports=scene.floor_height is not None)
    if scene.floor_height is not None and (kind == "spatial" or _upright(plane)):
        floor = (StaticObject(name="floor", shape=Plane(offset=scene.floor_height)),)
    world = World(
        objects=bodies,
        statics=(*floor, *scene.statics),
        environment=Environment(gravity=scene.gravity, motion_plane=plane),
        effects=scene.effects,
        time=time,
        camera=camera,
    )
    return Built(
        world=with_initial_states(world, tracks.select(names)),
        representation=kind,
        why=why,
        assumed=_assumed(names, given, scene, kind),
        left_out=left_out,
    )


def _upright(plane: MotionPlane) -> bool:
    """Whether the plane of motion is seen from the side, so that a floor is a line in it."""
    return abs(plane.normal[2]) < 0.5 * float(np.linalg.norm(plane.normal))


def from_trusted_start(tracks: ObservedTracks) -> ObservedTracks:
    """The tracks without the leading samples of each object that are much less sure than the rest of it.

    An object that enters through the image border is seen in part at first, and its place is biased until most of
    it is in view; a world that began it there would be wrong for good.
    """
    confidence = tracks.confidence.copy()
    for column in range(len(tracks.names)):
        seen = confidence[:, column] > 0
        if not seen.any():
            continue
        trusted = confidence[:, column] >= TRUST * np.median(confidence[seen, column])
        confidence[: int(np.argmax(trusted)), column] = 0.0
    return replace(
        tracks,
        confidence=confidence,
        orientation_confidence=np.where(confidence > 0, tracks.orientation_confidence, 0.0),
    )


def _shapes(
    names: Sequence[str], seen: Mapping[str, ObservedObject], given: Mapping[str, Given]
) -> dict[str, BodyShape]:
    shapes: dict[str, BodyShape] = {}
    for name in names:
        said = given[name].shape if name in given else None
        observed = seen[name].shape if name in seen else None
        shape = said or observed
        if shape is not None:
            shapes[name] = shape
    missing = [name for name in names if name not in shapes]
    if missing:
        raise ValueError(
            f"the shape and size of {missing} are not known: give objects=[{{name, shape}}] or default_shape, "
            'e.g. {"kind": "sphere", "radius": 0.2}'
        )
    return shapes


def _representation(
    asked: Representation,
    tracks: ObservedTracks,
    shapes: Mapping[str, BodyShape],
    scene: Scene,
    heights_assumed: bool,
) -> tuple[Literal["planar", "spatial"], str]:
    if asked != "auto":
        return asked, "as asked"
    if any(static.shape.kind == "triangle_mesh" for static in scene.statics):
        return "spatial", "a triangle mesh can only be touched in a spatial world"
    if scene.motion_plane is not None:
        return "planar", "a motion plane was given"
    if heights_assumed:
        return "planar", "positions were measured by assuming that objects stay on the floor"
    for column, name in enumerate(tracks.names):
        rows = tracks.confidence[:, column] > 0
        height = tracks.positions[rows, column, 2]
        swing = float(np.ptp(height))
        sigma = float(np.median(tracks.position_sigma[rows, column]))
        allowed = max(HEIGHT_SHARE * half_height(shapes[name]), HEIGHT_SIGMAS * sigma)
        if swing > allowed:
            return "spatial", f"{name} rises or falls by {swing:.3g} m, more than the {allowed:.3g} m of level motion"
    return "planar", "every object keeps its height"


def half_height(shape: BodyShape) -> float:
    """Half the vertical extent of a shape in its rest orientation [m]: how high its centre is above the floor."""
    if isinstance(shape, Sphere):
        return shape.radius
    if isinstance(shape, Box):
        return shape.half_extents[2]
    if isinstance(shape, Cylinder):
        return shape.half_height
    if isinstance(shape, Capsule):
        return shape.half_height + shape.radius
    if isinstance(shape, Compound):
        return _compound_half_height(shape)
    return _mesh_half_height(shape)


def hull_vertices(points: NDArray[np.float64]) -> tuple[tuple[float, float, float], ...]:
    """At most 256 vertices of the convex hull of points (k, 3): all of them, or the extreme ones of even directions.

    Raises ValueError for points that span no volume.
    """
    try:
        corners = points[ConvexHull(points).vertices]
    except QhullError as error:
        raise ValueError("the mesh is flat: its convex hull has no volume") from error
    if len(corners) > MOST_VERTICES:
        # Directions on a Fibonacci lattice: nearly even over the sphere at any number.
        number = np.arange(MOST_VERTICES) + 0.5
        z, turn = 1.0 - 2.0 * number / MOST_VERTICES, np.pi * (1.0 + 5.0**0.5) * number
        level = np.sqrt(1.0 - z**2)
        directions = np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1)
        corners = corners[np.unique(np.argmax(corners @ directions.T, axis=0))]
    return tuple((float(x), float(y), float(z)) for x, y, z in corners)


def _mesh_half_height(shape: ConvexMesh) -> float:
    return float(-np.asarray(hull(shape).vertices)[:, 2].min())


def _compound_half_height(shape: Compound) -> float:
    sideways = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # z is the second axis of the outline
    outline, radius = planar_outline(shape, np.eye(3), sideways)
    return radius - float(outline[:, 1].min())


def _body(
    name: str,
    shape: BodyShape,
    seen: ObservedObject | None,
    given: Given,
    kind: Literal["planar", "spatial"],
    scene: Scene,
    position: np.ndarray,
) -> RigidObject:
    values = {
        key: value
        for key in (
            "mass", "density", "friction", "restitution", "rolling_resistance", "linear_damping", "angular_damping"
        )
        if (value := getattr(given, key)) is not None
    }  # fmt: skip
    x, y, z = (float(v) for v in position)
    if kind == "planar" and scene.motion_plane is None:
        z = (scene.floor_height or 0.0) + half_height(shape)  # it stands on the floor, whatever a track says
    return RigidObject(
        name=name,
        representation="rigid_planar" if kind == "planar" else "rigid_spatial",
        shape=shape,
        appearance=Appearance(
            color=given.color or (seen.color if seen else None),
            material=given.material or (seen.material if seen else None),
        ),
        position=(x, y, z),
        **values,
    )


def _assumed(
    names: Sequence[str], given: Mapping[str, Given], scene: Scene, kind: Literal["planar", "spatial"]
) -> tuple[str, ...]:
    defaults = RigidObject(name="x", shape=Sphere(radius=1.0), position=(0.0, 0.0, 0.0))
    said = {name: given.get(name, Given()) for name in names}
    notes = []
    for key in ("friction", "restitution"):
        open_ones = [name for name in names if getattr(said[name], key) is None]
        if open_ones:
            notes.append(f"{key} {getattr(defaults, key):g} for {', '.join(open_ones)}: FitWorld finds better")
    unweighed = [name for name in names if said[name].mass is None and said[name].density is None]
    if unweighed:
        notes.append(f"density {defaults.density:g} kg/m^3 for {', '.join(unweighed)}")
    if kind == "planar" and scene.motion_plane is None:
        notes.append("objects stay upright and on the floor")
    if scene.motion_plane is not None and _upright(scene.motion_plane) and scene.floor_height is None:
        notes.append("there is no floor: give floor=z if objects bounce or rest on one")
    return tuple(notes)
