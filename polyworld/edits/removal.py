"""Taking parts out of a world, with everything that refers to them."""

from __future__ import annotations

from typing import Any

from polyworld.world import World
from polyworld.world.materials import material

# Parts of a world, by the word an agent uses for one of them; the first three are objects.
PARTS = {
    "object": "objects",
    "deformable": "deformables",
    "static": "statics",
    "joint": "joints",
    "attachment": "attachments",
    "pulley": "pulleys",
    "emitter": "emitters",
    "drain": "drains",
    "container": "containers",
}
SLACK = "collision_slack"  # effect that a fit adds for a collision, at one time for all bodies
MET = "slack_"  # begins the names of those of the bodies that take part in it
OBJECTS = ("objects", "deformables", "statics")


def without(world: World, name: str, part: str | None = None) -> World:
    """The world without what is called `name`: an object, deformable or static, else one of the other parts.

    part: the word of `PARTS` for which is meant. What refers to it goes with it: joints, attachments, pulleys,
    emitters of a fluid, containers carried along, effects that acted on nothing else. The last fluid takes the grid
    and the drains with it. Raises ValueError naming what there is.
    """
    kinds = [PARTS[part]] if part is not None else list(PARTS.values())
    found = [kind for kind in kinds if any(x.name == name for x in getattr(world, kind))]
    if not found:
        there = {kind: [x.name for x in getattr(world, kind)] for kind in kinds}
        listed = "; ".join(f"{kind}: {names}" for kind, names in there.items() if names or kind in OBJECTS[::2])
        raise ValueError(f"no {part or 'object or static'} is called {name!r}; {listed}")
    data: dict[str, Any] = world.model_dump()
    kind = found[0]
    data[kind] = [d for d in data[kind] if d["name"] != name]
    if kind in OBJECTS:
        _forget(data, name)
    return World.model_validate(data)


def without_pulses(world: World) -> World:
    """The world without the pulses that a fit added at collisions: as it was before that fit."""
    return world.model_copy(update={"effects": tuple(e for e in world.effects if e.kind != SLACK)})


def _forget(data: dict[str, Any], name: str) -> None:
    """Take out of a world's description what refers to an object that is gone."""
    effects = []
    slack = [e for e in data["effects"] if e["kind"] == SLACK and e["name"].startswith(MET)]
    met = {e["parameters"].get("time") for e in slack if name in (e["objects"] or ())}
    for effect in data["effects"]:
        if effect["kind"] == SLACK and effect["parameters"].get("time") in met:
            continue  # the collision that left it does not happen
        if effect["objects"] is not None:
            effect["objects"] = [o for o in effect["objects"] if o != name]
            if not effect["objects"]:
                continue
        effects.append(effect)
    data["effects"] = effects
    data["joints"] = [j for j in data["joints"] if name not in (j["object"], j["other"])]
    data["no_contact"] = [pair for pair in data["no_contact"] if name not in pair]
    data["attachments"] = [a for a in data["attachments"] if name not in (a["object"], a["to"])]
    data["pulleys"] = [p for p in data["pulleys"] if name not in (p["rope"], p["object"])]
    data["emitters"] = [e for e in data["emitters"] if e["fluid"] != name]
    data["containers"] = [c for c in data["containers"] if c["object"] != name]
    if not any(material(d["representation"]).form == "liquid" for d in data["deformables"]):
        data["fluid_grid"], data["drains"] = None, []
