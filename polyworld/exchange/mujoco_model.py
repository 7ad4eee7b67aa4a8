"""A compiled MuJoCo model, of MJCF or URDF, as a world."""

from __future__ import annotations

from typing import Any

import numpy as np

from polyworld.exchange.bodies import MovingBody, colour_of, moving_bodies
from polyworld.exchange.geoms import quaternion, static_geom, vector
from polyworld.exchange.joints import JointReader
from polyworld.exchange.names import Names
from polyworld.exchange.reading import Imported
from polyworld.exchange.surfaces import as_static, of_pair, surface_of
from polyworld.world import Effect, Environment, StaticObject, TimeBase, World

LONGEST_STEP = 0.05  # [s]
# Parts of a model that have no counterpart, by the name of their number in it.
_ABSENT = {
    "ntendon": "tendons",
    "nflex": "flexible bodies",
    "nskin": "skins",
    "npair": "contact parameters of pairs of geoms",
    "nplugin": "plugins",
    "nsensor": "sensors",
    "ncam": "cameras",
}


def world_of_model(model: Any, data: Any) -> Imported:
    """Return the world of a compiled model in the state of `data`, for which `mj_forward` was called."""
    names = Names()
    bodies = moving_bodies(model, data, names)
    reader = JointReader(model, data, bodies, names)
    reader.read()
    notes = [note for body in bodies for note in body.notes]
    geoms = _statics(model, data, names, bodies, notes)
    statics = [static for _, static in geoms]
    apart = _no_contact(model, bodies, geoms, reader, notes)
    carried = [carrier.name for carrier in reader.carriers]
    solid = [*(body.item.name for body in bodies), *(static.name for static in statics)]
    apart += [(name, other) for i, name in enumerate(carried) for other in (*solid, *carried[:i])]
    notes += reader.notes
    notes += _mixed(bodies)
    world = World(
        objects=(*(b.item for b in bodies), *reader.carriers),
        statics=tuple(statics),
        joints=tuple(reader.joints),
        no_contact=tuple(sorted(apart)),
        effects=tuple(_held_up(model, bodies)),
        environment=Environment(gravity=vector(model.opt.gravity)),
        time=TimeBase(substep=min(float(model.opt.timestep), LONGEST_STEP)),
    )
    return Imported(world, tuple(notes + _absent(model) + names.changed))


def _statics(
    model: Any, data: Any, names: Names, bodies: list[MovingBody], notes: list[str]
) -> list[tuple[int, StaticObject]]:
    """Return what does not move, with the geom of each."""
    statics = []
    for geom in range(model.ngeom):
        if model.body_weldid[model.geom_bodyid[geom]] != 0:
            continue
        label = model.geom(geom).name or model.body(model.geom_bodyid[geom]).name
        if not (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            notes.append(f"{label or f'geom {geom}'} is left out: it touches nothing and does not move")
            continue
        found = static_geom(model, data, geom)
        if isinstance(found, str):
            notes.append(f"{label or f'geom {geom}'} is left out: {found}")
            continue
        name = names.take("" if label == "world" else label, f"geom{geom}")
        own = surface_of(model, geom)
        near = [b.surface for b in bodies if _meet(model, b.geoms, [geom], apart=False)]
        fields, exact = as_static(own, near)
        if not exact:
            notes.append(f"{name}: its contacts have the objects' own friction or rebound, not MuJoCo's mixture")
        if found.said:
            notes.append(f"{name} is {found.said}")
        static = StaticObject(
            name=name,
            shape=found.shape,
            appearance=colour_of(model, geom),
            position=vector(found.position),
            orientation=quaternion(found.rotation),
            **fields,
        )
        statics.append((geom, static))
    mocap = [model.body(b).name or f"body {b}" for b in range(model.nbody) if model.body_mocapid[b] >= 0]
    if mocap:
        notes.append(f"bodies that are moved from outside stand still: {', '.join(mocap)}")
    return statics


def _meet(model: Any, first: list[int], second: list[int], apart: bool) -> bool:
    """Whether any geom of one list may touch one of another: as a pair of their own, or by masks unless `apart`."""
    own = zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True)
    if any((a in first and b in second) or (b in first and a in second) for a, b in own):
        return True
    types, affinities = model.geom_contype, model.geom_conaffinity
    by_mask = ((types[a] & affinities[b]) or (types[b] & affinities[a]) for a in first for b in second)
    return not apart and any(by_mask)


def _no_contact(
    model: Any,
    bodies: list[MovingBody],
    statics: list[tuple[int, StaticObject]],
    reader: JointReader,
    notes: list[str],
) -> list[tuple[str, str]]:
    """Return the pairs that do not touch in the model, but for those that joints keep apart anyway."""
    excluded = {(int(s) >> 16, int(s) & 0xFFFF) for s in model.exclude_signature}
    joined = {frozenset((j.object, j.other)) for j in reader.joints}
    found: list[tuple[str, str]] = []
    for i, a in enumerate(bodies):
        for b in bodies[:i]:
            named = frozenset((a.item.name, b.item.name))
            apart = _excluded(model, excluded, a.root, b.root) or _parent_and_child(model, a.root, b.root)
            meet = _meet(model, a.geoms, b.geoms, apart)
            if named not in joined:
                found += [] if meet else [(b.item.name, a.item.name)]
            elif meet:
                notes.append(f"{a.item.name} and {b.item.name}, held together, do not collide; in MuJoCo they do")
    for a in bodies:
        for geom, static in statics:
            body = int(model.geom_bodyid[geom])
            if not _meet(model, a.geoms, [geom], _excluded(model, excluded, a.root, body)):
                found.append((a.item.name, static.name))
    return found


def _parent_and_child(model: Any, a: int, b: int) -> bool:
    weld, parent = model.body_weldid, model.body_parentid
    return bool(weld[parent[a]] == b or weld[parent[b]] == a)


def _excluded(model: Any, excluded: set[tuple[int, int]], a: int, b: int) -> bool:
    weld = model.body_weldid
    return any({int(weld[p]), int(weld[q])} == {int(weld[a]), int(weld[b])} for p, q in excluded)


def _mixed(bodies: list[MovingBody]) -> list[str]:
    """Pairs of objects whose friction or rebound is mixed otherwise than in MuJoCo."""
    found = set()
    for i, a in enumerate(bodies):
        for b in bodies[:i]:
            if not a.geoms or not b.geoms:
                continue
            friction, restitution = of_pair(a.surface, b.surface)
            here = tuple(
                float(np.sqrt(p * q))
                for p, q in ((a.surface.friction, b.surface.friction), (a.surface.restitution, b.surface.restitution))
            )
            if max(abs(here[0] - friction), abs(here[1] - restitution)) > 1e-9:
                found.add(
                    f"contacts of surfaces with friction {a.surface.friction:g} and {b.surface.friction:g}, "
                    f"restitution {a.surface.restitution:g} and {b.surface.restitution:g} have {here[0]:.3g} and "
                    f"{here[1]:.3g}, in MuJoCo {friction:.3g} and {restitution:.3g}"
                )
    return sorted(found)


def _held_up(model: Any, bodies: list[MovingBody]) -> list[Effect]:
    """Compensation of gravity as forces."""
    found = []
    for body in bodies:
        share = float(model.body_gravcomp[body.root])
        if share:
            force = -share * float(body.item.mass or 0.0) * np.array(model.opt.gravity)
            values = {axis: float(v) for axis, v in zip("xyz", force, strict=True)}
            name = f"gravcomp-{body.item.name}"[:64]
            found.append(Effect(name=name, kind="uniform_force", parameters=values, objects=(body.item.name,)))
    return found


def _absent(model: Any) -> list[str]:
    counts = {words: int(getattr(model, number)) for number, words in _ABSENT.items()}
    found = [f"{count} {words} are left out" for words, count in counts.items() if count]
    if model.opt.density or model.opt.viscosity:
        found.append("the drag of the medium (density, viscosity) is left out: add an effect such as quadratic_drag")
    if np.any(model.opt.wind):
        found.append("the wind is left out: add the effect wind")
    return found
