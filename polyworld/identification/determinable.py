"""What tracks cannot tell, and why: reasons in words for parameters the motion does not depend on."""

from __future__ import annotations

from polyworld.identification.contacts import possible_contacts
from polyworld.identification.material_parameters import tied_bodies
from polyworld.initial_states import initial_states
from polyworld.parameter_tables import DEFORMABLE_PARAMETERS
from polyworld.tracks import ObservedTracks
from polyworld.world import World


def reasons_undeterminable(world: World, tracks: ObservedTracks) -> dict[str, str]:
    """Parameter path -> why the tracks say nothing about it: friction, damping, restitution, mass, and materials.

    From the tracks alone: who moves, and who comes near whom. A path that is absent may still be undetermined;
    the sensitivity of the fit decides.
    """
    states = initial_states(tracks, seconds_per_frame=world.time.seconds_per_frame)
    contacts = possible_contacts(world, tracks)
    bodies = {o.name for o in world.objects}
    touched = {n for c in contacts for n in c.participants}
    tied = tied_bodies(world)
    met = {n for c in contacts for n in c.participants if set(c.participants) <= bodies} | tied
    reasons: dict[str, str] = {}
    for item in world.objects:
        head = f"objects.{item.name}"
        moving = item.name in states and (states[item.name].moves or item.name in touched or item.name in tied)
        if item.name not in states:
            still = f"{item.name} was not observed"
        else:
            still = f"{item.name} never moves in the observed frames"
        if not moving:
            for field in ("friction", "linear_damping", "angular_damping", "rolling_resistance", "torsional_radius"):
                reasons[f"{head}.{field}"] = still
        if item.name not in touched:
            reasons[f"{head}.restitution"] = f"no contact involving {item.name} in the observed frames"
        if item.name not in met:
            reasons[f"{head}.mass"] = f"mass ratios enter through collisions only, and {item.name} meets no other body"
    known = set(tracks.observed_names)
    for soft in world.deformables:
        fastened = {a.to for a in world.attachments if a.object == soft.name}
        fastened |= {a.object for a in world.attachments if a.to == soft.name}
        if soft.name not in known and not fastened & known:
            for field in DEFORMABLE_PARAMETERS[soft.representation]:
                reasons[f"objects.{soft.name}.{field}"] = f"neither {soft.name} nor what it is fastened to was observed"
    first = next((o.name for o in world.objects if o.name in met), None)
    if first is not None:
        reasons[f"objects.{first}.mass"] = f"motion tells only ratios of masses: that of {first} is kept as their unit"
    return reasons
