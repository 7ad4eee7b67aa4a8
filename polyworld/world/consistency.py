"""Check a world as a whole: unique names, references that resolve, representations that go together."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from polyworld.effects import CATALOGUE
from polyworld.expressions.effect import EXPRESSION, check_law, law_of
from polyworld.world.materials import material_of

if TYPE_CHECKING:
    from polyworld.world import World


def check_consistent(world: World) -> None:
    """Raise ValueError that names what does not fit and the valid choices."""
    _unique("names of objects, deformables and statics", (*world.moving_names, *(s.name for s in world.statics)))
    for part in ("effects", "joints", "attachments", "pulleys", "emitters", "drains", "containers"):
        _unique(f"names of {part}", (x.name for x in getattr(world, part)))
    _check_representations(world)
    _check_effects(world)
    _check_joints(world)
    _check_no_contact(world)
    _check_attachments(world)
    _check_pulleys(world)
    _check_fluids(world)


def _unique(what: str, names: Iterable[str]) -> None:
    listed = list(names)
    repeated = sorted({n for n in listed if listed.count(n) > 1})
    if repeated:
        raise ValueError(f"{what} must be unique; repeated: {repeated}")


def _check_representations(world: World) -> None:
    kinds = {o.representation for o in (*world.objects, *world.deformables)}
    planar = sorted(k for k in kinds if k.endswith("_planar"))
    spatial = sorted(kinds - set(planar))
    if planar and spatial:
        raise ValueError(
            f"planar and spatial objects cannot share one world: {planar} move in the motion plane, {spatial} in "
            "space; give all objects planar or all objects spatial representations (cloth is spatial)"
        )
    if planar:
        meshes = [s.name for s in world.statics if s.shape.kind == "triangle_mesh"]
        if meshes:
            raise ValueError(
                f"planar worlds take planes, walls and convex statics, not triangle meshes: {meshes}; "
                "use spatial representations instead"
            )
        compounds = [o.name for o in world.objects if o.shape.kind == "compound"]
        if compounds:
            raise ValueError(
                f"compound shapes move in space only: {compounds}; make the representation spatial, or them "
                "single convex shapes"
            )
    if planar and (world.deformables or world.joints):
        plane = world.environment.motion_plane
        normal = np.asarray(plane.normal) / np.linalg.norm(plane.normal)
        across = float(normal @ np.asarray(world.environment.gravity))
        if abs(across) > 1e-9 and plane.supports:
            raise ValueError(
                f"gravity has {across:.6g} m/s^2 across the motion plane (normal {plane.normal}): planar ropes, soft "
                "bodies, fluids and bodies on joints do not rub on a supporting plane; for a side view turn the motion "
                "plane's normal across gravity, for things on a table use spatial representations on a static plane"
            )


def _check_effects(world: World) -> None:
    rigid = {o.name for o in world.objects}
    soft = {d.name: d for d in world.deformables}
    for effect in world.effects:
        unknown = sorted(set(effect.objects or ()) - rigid - set(soft))
        if unknown:
            raise ValueError(
                f"effect {effect.name!r} names unknown objects {unknown}; objects: {sorted(world.moving_names)}"
            )
        check_law(effect)
        on_soft = sorted(soft if effect.objects is None else set(effect.objects) & set(soft))
        if on_soft and not law_of(effect).per_mass:
            choices = [*(kind for kind, law in CATALOGUE.items() if law.per_mass), EXPRESSION]
            raise ValueError(
                f"effect {effect.name!r}: {effect.kind} acts on rigid objects only, not on {on_soft}; effects that act "
                f"on deformable objects too: {choices}; name the rigid objects in `objects`: {sorted(rigid)}"
            )


def _check_joints(world: World) -> None:
    starts = {o.name: o.start_time for o in world.objects}
    for joint in world.joints:
        ends = [joint.object] + ([joint.other] if joint.other is not None else [])
        unknown = sorted(set(ends) - set(starts))
        if unknown:
            raise ValueError(
                f"joint {joint.name!r} names unknown objects {unknown}; rigid objects: {sorted(starts)}; "
                "to hang an object on the world or on a static, leave `other` out"
            )
        if joint.object == joint.other:
            raise ValueError(f"joint {joint.name!r} joins {joint.object!r} to itself")
        if len({starts[name] for name in ends}) > 1:
            raise ValueError(
                f"joint {joint.name!r} joins objects of different start_time: "
                f"{ {name: starts[name] for name in ends} }; give both the same"
            )
        if joint.kind in ("hinge", "slider") and np.linalg.norm(joint.axis) < 1e-9:
            raise ValueError(f"joint {joint.name!r}: its axis must not be zero")


def _check_no_contact(world: World) -> None:
    objects = {o.name for o in world.objects}
    statics = {s.name for s in world.statics}
    for pair in world.no_contact:
        unknown = sorted(set(pair) - objects - statics)
        if unknown or pair[0] == pair[1] or not set(pair) & objects:
            raise ValueError(
                f"no_contact {pair} must name two rigid objects, or one and a static; "
                f"objects: {sorted(objects)}; statics: {sorted(statics)}"
            )


def _check_attachments(world: World) -> None:
    holdable = {d.name: d for d in world.of_form("line", "sheet", "solid")}
    for attachment in world.attachments:
        name = attachment.name
        if attachment.object not in holdable:
            raise ValueError(
                f"attachment {name!r} holds {attachment.object!r}, which is no rope, cloth or soft body; "
                f"choices: {sorted(holdable)}"
            )
        choices = sorted((set(holdable) | {o.name for o in world.objects}) - {attachment.object})
        if attachment.to is not None and attachment.to not in choices:
            raise ValueError(
                f"attachment {name!r} is to {attachment.to!r}; choices: {choices}; for the world or a static, "
                "leave `to` out"
            )
        is_rope = material_of(holdable[attachment.object]).form == "line"
        if (attachment.end is not None or attachment.clamped) and not is_rope:
            raise ValueError(
                f"attachment {name!r}: `end` and `clamped` are for ropes; {attachment.object!r} is "
                f"{holdable[attachment.object].representation}: give nodes or region"
            )


def _check_pulleys(world: World) -> None:
    ropes = {d.name: d for d in world.of_form("line")}
    rigid = [o.name for o in world.objects]
    for pulley in world.pulleys:
        rope = ropes.get(pulley.rope)
        if rope is None:
            raise ValueError(f"pulley {pulley.name!r}: no rope is called {pulley.rope!r}; ropes: {sorted(ropes)}")
        if pulley.object is not None and pulley.object not in rigid:
            raise ValueError(f"pulley {pulley.name!r}: no rigid object is called {pulley.object!r}; objects: {rigid}")
        if pulley.after + 1 >= len(rope.points):
            raise ValueError(
                f"pulley {pulley.name!r}: after {pulley.after} needs points {pulley.after} and {pulley.after + 1} of "
                f"rope {pulley.rope!r}, which has {len(rope.points)}"
            )


def _check_fluids(world: World) -> None:
    fluids = [d.name for d in world.of_form("liquid")]
    if fluids and world.fluid_grid is None:
        raise ValueError(f"fluids {fluids} need a fluid_grid: the box they are computed in and the size of its cells")
    for emitter in world.emitters:
        if emitter.fluid not in fluids:
            raise ValueError(f"emitter {emitter.name!r}: no fluid is called {emitter.fluid!r}; fluids: {fluids}")
    rigid = [o.name for o in world.objects]
    for container in world.containers:
        if container.object is not None and container.object not in rigid:
            raise ValueError(
                f"container {container.name!r}: no rigid object is called {container.object!r}; objects: {rigid}"
            )
