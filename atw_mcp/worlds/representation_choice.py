"""Planar or spatial: which representation a world built from an observation gets, and why."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np

from atw_mcp.worlds.parts import Parts
from polyworld.data.tracks import ObservedTracks
from polyworld.world import MotionPlane, StaticObject
from polyworld.world.geometry import quaternion_matrix
from polyworld.world.materials import material
from polyworld.world.representations.joint import Hinge, Joint
from polyworld.world.shapes import BodyShape

Representation = Literal["auto", "planar", "spatial"]
Chosen = Literal["planar", "spatial"]

# An object stays on its plane while its height varies by less than this share of its half height, or scatters by no
# more than its noise: the scatter of n samples has an error of 1/sqrt(2n), of which this many are allowed.
HEIGHT_SHARE, SCATTER_ERRORS = 0.25, 4.0
LYING = 0.5  # cosine of the angle between the vertical and the axis of what lies on its side


class Choice(NamedTuple):
    """kind: the representation; why: in words; alternative: another that the tracks suit as well, None without."""

    kind: Chosen
    why: str
    alternative: Chosen | None = None


def choose(
    asked: Representation,
    tracks: ObservedTracks,
    half_heights: Mapping[str, float],
    shapes: Mapping[str, BodyShape],
    *,
    statics: tuple[StaticObject, ...],
    plane: MotionPlane | None,
    gravity: tuple[float, float, float],
    parts: Parts,
    heights_assumed: bool,
    airborne: frozenset[str] = frozenset(),
) -> Choice:
    """Choose the representation of all objects of a world.

    tracks: those of the rigid objects that were observed. half_heights [m], shapes: of all rigid objects. plane: the
    plane of motion where one is given or the camera looks along it. airborne: objects seen in flight or on an obstacle.
    """
    if asked != "auto":
        return Choice(asked, "as asked")
    reason = _needs_space(shapes, statics, parts)
    if reason is not None:
        return Choice("spatial", reason)
    if parts.deformables:
        return Choice(*_of_deformables(plane, gravity, parts))
    if parts.joints and (plane is None or not _along(plane, gravity)):
        return Choice("spatial", "bodies on joints do not rub on a plane of motion that gravity presses them on")
    if plane is not None and _swings_in_view(shapes, plane, gravity, parts):
        return Choice(
            "spatial",
            "bodies that swing on hinges alone keep to their plane in space, where a wrong length is found, too",
        )
    if plane is not None:
        return Choice("planar", "a motion plane was given")
    off_floor = [name for name in tracks.names if name in airborne]
    if off_floor:
        return Choice("spatial", f"{', '.join(off_floor)} seen in flight or on an obstacle")
    kind, why = _level(tracks, half_heights, heights_assumed=heights_assumed)
    rolling = rolling_bodies(tracks, shapes)
    if rolling and kind == "planar":
        why = f"{', '.join(rolling)} can roll, about level axes that a planar world has not"
        return Choice("spatial", why, "planar" if parts == Parts() else None)
    return Choice(kind, why)


def _level(tracks: ObservedTracks, half_heights: Mapping[str, float], *, heights_assumed: bool) -> tuple[Chosen, str]:
    """Planar where every tracked object keeps its height, and why."""
    if heights_assumed:
        return "planar", "positions were measured by assuming that objects stay on the floor"
    for column, name in enumerate(tracks.names):
        rows = tracks.confidence[:, column] > 0
        height = tracks.positions[rows, column, 2]
        swing = float(np.ptp(height))
        sigma = float(np.median(tracks.height_sigma[rows, column]))
        noise = sigma * (1.0 + SCATTER_ERRORS / np.sqrt(2.0 * max(len(height) - 1, 1)))
        if swing > HEIGHT_SHARE * half_heights[name] and height.std() > noise:
            return "spatial", f"{name} rises or falls by {swing:.3g} m, more than its size and its noise allow"
    if not tracks.names:
        return "spatial", "nothing was observed that would confine it to a plane"
    return "planar", "every object keeps its height"


def rolling_bodies(tracks: ObservedTracks, shapes: Mapping[str, BodyShape]) -> list[str]:
    """Names of tracked balls, and of cylinders and capsules that are seen to lie on their side."""
    found = []
    for column, name in enumerate(tracks.names):
        if shapes[name].kind == "sphere":
            found.append(name)
        elif shapes[name].kind in ("cylinder", "capsule"):
            rows = np.flatnonzero(tracks.orientation_confidence[:, column] > 0)
            seen = tracks.orientations[rows, column]
            upright = [abs(float(quaternion_matrix(q)[2, 2])) for q in seen if np.isfinite(q).all()]
            if upright and np.median(upright) < LYING:
                found.append(name)
    return found


def _needs_space(shapes: Mapping[str, BodyShape], statics: tuple[StaticObject, ...], parts: Parts) -> str | None:
    """Why a world can only be spatial, or None."""
    if any(static.shape.kind == "triangle_mesh" for static in statics):
        return "a triangle mesh can only be touched in a spatial world"
    for item in parts.deformables:
        if not material(item["representation"]).planar:
            kind = item["representation"]
            named = [str(d["name"]) for d in parts.deformables if d["representation"] == kind]
            return f"{kind} moves in space ({', '.join(named)})"
    compounds = [name for name, shape in shapes.items() if shape.kind == "compound"]
    if compounds:
        return f"compound shapes move in space ({', '.join(compounds)})"
    twisting = [str(d["name"]) for d in parts.deformables if d.get("twist_stiffness")]
    if twisting:
        return f"ropes that twist move in space ({', '.join(twisting)})"
    return None


def _swings_in_view(
    shapes: Mapping[str, BodyShape], plane: MotionPlane, gravity: tuple[float, float, float], parts: Parts
) -> bool:
    """Whether all objects hang on hinges, in a plane along which gravity pulls, on which nothing can lie."""
    held = {name for joint in parts.joints for name in (joint.object, joint.other)}
    return bool(shapes) and set(shapes) <= held and _along(plane, gravity)


def _along(plane: MotionPlane, gravity: tuple[float, float, float]) -> bool:
    """Whether gravity pulls along a plane alone."""
    normal = np.asarray(plane.normal) / np.linalg.norm(plane.normal)
    return bool(abs(float(normal @ np.asarray(gravity))) <= 1e-6 * float(np.linalg.norm(gravity)))


def with_axes_across(joints: tuple[Joint, ...], plane: MotionPlane) -> tuple[Joint, ...]:
    """Joints, with the plane's normal for the axis of each hinge that was given none."""
    return tuple(
        joint.model_copy(update={"axis": plane.normal})
        if isinstance(joint, Hinge) and "axis" not in joint.model_fields_set
        else joint
        for joint in joints
    )


def _of_deformables(plane: MotionPlane | None, gravity: tuple[float, float, float], parts: Parts) -> tuple[Chosen, str]:
    names = ", ".join(str(d["name"]) for d in parts.deformables)
    stated = [str(d["name"]) for d in parts.deformables if str(d["representation"]).endswith("_planar")]
    if stated:
        return "planar", f"{', '.join(stated)} given as planar"
    if plane is None:
        return (
            "spatial",
            f"{names} may move anywhere; give motion_plane, or representation='planar', to keep to a plane",
        )
    if not _along(plane, gravity):
        return (
            "spatial",
            "gravity pulls across the motion plane, on which deformable objects cannot lie in a planar world",
        )
    return "planar", f"{names} and all that touches them move in the given plane"
