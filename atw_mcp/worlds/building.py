"""From an observation to a world: which representation, which shapes, where everything starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from atw_mcp.calls.limits import DEFAULT, Limits
from atw_mcp.worlds.heights import half_height
from atw_mcp.worlds.parts import Parts, read_part
from atw_mcp.worlds.representation_choice import Chosen, Representation, choose, with_axes_across
from atw_mcp.worlds.sizes import check_sizes
from atw_mcp.worlds.warnings import attachment_warnings, fluid_warnings, without_covering_walls
from polyworld.data.initial_states import InitialState, initial_states, with_initial_states
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.support import with_supports
from polyworld.model.notes import model_notes
from polyworld.world import Effect, Environment, MotionPlane, StaticObject, TimeBase, World
from polyworld.world.camera import Camera
from polyworld.world.description import Appearance
from polyworld.world.materials import material
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import BodyShape, Plane, Sphere

# Where planar ropes, soft bodies and fluids move when nobody says otherwise.
ACROSS = MotionPlane(point=(0.0, 0.0, 0.0), normal=(0.0, -1.0, 0.0), supports=False)
TRUST = 0.5  # an object begins at the first sample with this share of its median confidence


@dataclass(frozen=True)
class ObservedObject:
    """Observed properties of an object beside its motion; None where one was not observed."""

    name: str
    shape: BodyShape | None = None
    color: str | None = None
    material: str | None = None


@dataclass(frozen=True)
class Given:
    """Statements of the agent about one object; None leaves a field to the observation or to the default. An object
    without a track needs a shape and a position."""

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
    position: tuple[float, float, float] | None = None
    orientation: tuple[float, float, float, float] | None = None
    velocity: tuple[float, float, float] | None = None
    angular_velocity: tuple[float, float, float] | None = None
    start_time: float | None = None


@dataclass(frozen=True)
class Scene:
    """Surroundings of the objects. floor_height [m] is where they rest; None: nothing supports them."""

    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    floor_height: float | None = 0.0
    motion_plane: MotionPlane | None = None
    statics: tuple[StaticObject, ...] = ()
    effects: tuple[Effect, ...] = ()
    parts: Parts = field(default_factory=Parts)
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    air_density: float | None = None


@dataclass(frozen=True)
class Built:
    """A world, and every choice made on the way that the agent did not make itself.

    alternative: the representation that the tracks would suit as well.
    """

    world: World
    representation: Literal["planar", "spatial"]
    why: str
    alternative: Literal["planar", "spatial"] | None = None
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
    airborne: frozenset[str] = frozenset(),
    time: TimeBase,
    camera: Camera | None = None,
    limits: Limits = DEFAULT,
) -> Built:
    """A world of the tracked objects, each placed and set in motion as its track begins, and of what was described.

    chosen: names of the tracks to model (default all; a deformable object of the same name takes a track's place).
    heights_assumed: the tracks were got by assuming that objects stay on the floor, so their height says nothing.
    airborne: objects that were seen in flight or on an obstacle.
    Raises ValueError or KeyError for unknown names and for objects whose shape is neither observed nor given.
    """
    seen = {item.name: item for item in objects}
    soft = {str(item["name"]) for item in scene.parts.deformables}
    names = [name for name in (tracks.names if chosen is None else chosen) if name not in soft]
    _check_names(names, given, tracks, soft)
    tracks = from_trusted_start(tracks)
    states = initial_states(tracks, seconds_per_frame=time.seconds_per_frame)
    left_out = tuple(f"{name}: observed in fewer than two frames" for name in names if name not in states)
    names = [name for name in names if name in states]
    described = [name for name in given if name not in tracks.names and name not in soft]
    if not names and not described and not soft:
        raise ValueError(f"there is no object to place: {'; '.join(left_out) or 'no track was chosen'}")
    shapes = _shapes([*names, *described], seen, given)
    kind, why, alternative = choose(
        representation,
        tracks.select(names),
        {name: half_height(shape) for name, shape in shapes.items()},
        shapes,
        statics=scene.statics,
        plane=scene.motion_plane,
        gravity=scene.gravity,
        parts=scene.parts,
        heights_assumed=heights_assumed,
        airborne=airborne,
    )
    if kind == "planar" and scene.motion_plane is None and scene.parts.deformables:
        scene = replace(scene, motion_plane=ACROSS)
        why += "; the plane is y = 0, seen along +y, as no motion_plane was given"
    notes: list[str] = []
    if kind == "planar" and scene.motion_plane is not None:
        kept, dropped = without_covering_walls(scene.statics, scene.motion_plane)
        scene = replace(scene, statics=kept)
        if dropped:
            notes.append(f"{', '.join(dropped)} left out: ahead of or behind the motion plane, they would cover it")
    if kind == "spatial" and scene.motion_plane is not None:
        joints = with_axes_across(scene.parts.joints, scene.motion_plane)
        if joints != scene.parts.joints:
            notes.append("hinges that were given no axis turn about the motion plane's normal")
        scene = replace(scene, parts=replace(scene.parts, joints=joints))
    if kind == "spatial" and scene.motion_plane is not None and representation == "auto":
        notes.append(
            f"the world is spatial although there is a motion plane, which confines nothing in it: {why}; for a planar "
            "world give representation='planar', what does not move as obstacles and moving things as single solids"
        )
    bodies = []
    for name in [*names, *described]:
        own = given.get(name, Given())
        place = states[name].position if name in states and name in names else np.asarray(own.position)
        if name in names and scene.motion_plane is not None and _upright(scene.motion_plane):
            own = replace(own, orientation=own.orientation or _lying_across(tracks, name, states[name]))
        bodies.append(_body(name, shapes[name], seen.get(name), own, kind, scene, place, tracked=name in names))
    plane = scene.motion_plane
    if plane is None:
        # Without a floor the plane is still where the objects move; it just does not press back.
        plane = MotionPlane(point=(0.0, 0.0, scene.floor_height or 0.0), supports=scene.floor_height is not None)
    floor: tuple[StaticObject, ...] = ()
    if scene.floor_height is not None and (kind == "spatial" or _upright(plane)):
        floor = (StaticObject(name="floor", shape=Plane(offset=scene.floor_height)),)
    air = {} if scene.air_density is None else {"air_density": scene.air_density}
    parts = scene.parts
    world = World(
        objects=tuple(bodies),
        statics=(*floor, *scene.statics),
        environment=Environment(gravity=scene.gravity, motion_plane=plane, wind=scene.wind, **air),
        effects=scene.effects,
        deformables=tuple(_deformable(item, kind, tracks, time) for item in parts.deformables),
        joints=parts.joints,
        attachments=parts.attachments,
        pulleys=parts.pulleys,
        fluid_grid=parts.fluid_grid,
        emitters=parts.emitters,
        drains=parts.drains,
        containers=parts.containers,
        time=time,
        camera=camera,
    )
    check_sizes(world, limits)
    notes += [*fluid_warnings(world), *model_notes(world), *_overruled(names, given)]
    if names:
        tracked = tracks.select(names)
        world = with_supports(with_initial_states(world, tracked), tracked)
    return Built(
        world=world,
        representation=kind,
        why=why,
        alternative=alternative,
        assumed=(*attachment_warnings(world), *notes, *_assumed([*names, *described], given, scene, kind)),
        left_out=left_out,
    )


def _check_names(names: Sequence[str], given: Mapping[str, Given], tracks: ObservedTracks, soft: set[str]) -> None:
    """Raise ValueError for a name that is neither tracked nor fully described."""
    twice = sorted(soft & set(given))
    if twice:
        raise ValueError(f"{twice} are in objects, for rigid bodies, and in parts: give each in one of the two")
    unknown = sorted(set(names) - set(tracks.names))
    if unknown:
        raise ValueError(f"no tracks {unknown}; tracks: {list(tracks.names)}")
    vague = sorted(name for name, own in given.items() if name not in tracks.names and own.position is None)
    if vague:
        raise ValueError(
            f"no tracks {vague}; tracks: {list(tracks.names)}. An object that was not observed needs a shape and a "
            "position"
        )


def _deformable(item: dict[str, Any], kind: Chosen, tracks: ObservedTracks, time: TimeBase) -> Any:
    """A deformable object as described, completed by what was observed of it, in the world's representation."""
    kind_of_part = str(item["representation"]).removesuffix("_planar")
    fields = {key: value for key, value in item.items() if key != "representation"}
    fields = {**_observed_start(str(item["name"]), kind_of_part, fields, tracks, time), **fields}
    made = read_part(kind_of_part, fields)
    if kind == "planar" and material(kind_of_part).planar:
        return made.model_copy(update={"representation": f"{kind_of_part}_planar"})
    return made


def _observed_start(
    name: str, kind: str, fields: Mapping[str, Any], tracks: ObservedTracks, time: TimeBase
) -> dict[str, Any]:
    """Where a deformable object was first seen: the centreline of a rope, the centre of a soft body."""
    if kind == "rope" and "points" not in fields:
        for series in tracks.shapes:
            if series.object != name or series.readout.kind != "centreline" or series.readout.view != "world":
                continue
            whole = np.flatnonzero(np.all(series.confidence > 0.0, axis=1))
            if len(whole):
                start = float(tracks.moments[whole[0]]) * time.seconds_per_frame
                return {"points": series.values[whole[0]].tolist(), "start_time": start}
    if kind == "soft" and "position" not in fields and name in tracks.names:
        state = initial_states(tracks.select([name]), seconds_per_frame=time.seconds_per_frame).get(name)
        if state is not None:
            start = state.frame * time.seconds_per_frame
            return {"position": state.position.tolist(), "velocity": state.velocity.tolist(), "start_time": start}
    return {}


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


def _lying_across(tracks: ObservedTracks, name: str, state: InitialState) -> tuple[float, float, float, float] | None:
    """Return the orientation of what looks the same at any angle about an upright plane's normal, where it is seen."""
    if state.orientation is None or tracks.symmetry[tracks.index(name)] != 0:
        return None
    w, x, y, z = (float(v) for v in state.orientation)
    return w, x, y, z


def _body(
    name: str,
    shape: BodyShape,
    seen: ObservedObject | None,
    given: Given,
    kind: Chosen,
    scene: Scene,
    position: np.ndarray,
    *,
    tracked: bool,
) -> RigidObject:
    values = {
        key: value
        for key in (
            "mass", "density", "friction", "restitution", "rolling_resistance", "linear_damping", "angular_damping",
            "orientation", "velocity", "angular_velocity", "start_time",
        )
        if (value := getattr(given, key)) is not None
    }  # fmt: skip
    x, y, z = (float(v) for v in position)
    if kind == "planar" and scene.motion_plane is None and tracked:
        z = (scene.floor_height or 0.0) + half_height(shape)  # it stands on the floor, whatever a track says
    return RigidObject(
        name=name,
        representation="rigid_planar" if kind == "planar" else "rigid_spatial",
        shape=shape,
        appearance=Appearance(
            color=given.color or (seen.color if seen else None),
            material=given.material,  # the same look may rub differently: fits tie constants by it
        ),
        position=(x, y, z),
        **values,
    )


def _overruled(names: Sequence[str], given: Mapping[str, Given]) -> list[str]:
    """Name what was given of the start of tracked objects, which begin as their tracks do."""
    found = []
    for name in names:
        fields = ("position", "velocity", "angular_velocity", "start_time")
        said = [key for key in fields if name in given and getattr(given[name], key) is not None]
        if said:
            found.append(f"{' and '.join(said)} given for {name}: not used, it begins as its track does")
    return found


def _assumed(names: Sequence[str], given: Mapping[str, Given], scene: Scene, kind: Chosen) -> tuple[str, ...]:
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
    if kind == "planar" and scene.motion_plane is None and names:
        notes.append("objects stay upright and on the floor")
    if scene.motion_plane is not None and _upright(scene.motion_plane) and scene.floor_height is None:
        notes.append("there is no floor: give floor=z if objects bounce or rest on one")
    return tuple(notes)
