"""Find what tracks can determine: who moves, who meets whom and when, and reasons for what they cannot determine."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from polyworld.data.initial_states import InitialState, initial_states
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.contacts import possible_contacts
from polyworld.world import World
from polyworld.world.materials import material_of


@dataclass(frozen=True)
class Shown:
    """Interactions of a world's objects that their tracks show."""

    world: World
    tracks: ObservedTracks

    @cached_property
    def states(self) -> dict[str, InitialState]:
        """Initial states of the tracked objects."""
        frame, gravity = self.world.time.seconds_per_frame, self.world.environment.gravity
        return initial_states(self.tracks, seconds_per_frame=frame, gravity=gravity)

    @cached_property
    def contacts(self) -> dict[tuple[str, str], float]:
        """Pairs of bodies and fixed things that may touch, and the first time [s] at which they may."""
        return possible_contacts(self.world, self.tracks)

    @cached_property
    def touched(self) -> dict[str, float]:
        """Objects that something may touch, and the first time [s] at which it may."""
        found: dict[str, float] = {}
        for pair, time in self.contacts.items():  # in the order of time
            for name in pair:
                found.setdefault(name, time)
        return found

    @cached_property
    def tied(self) -> set[str]:
        """Rigid objects that a deformable one is fastened to, or that carry a pulley: its forces show their masses."""
        ends = {a.to for a in self.world.attachments} | {p.object for p in self.world.pulleys}
        return {o.name for o in self.world.objects if o.name in ends}

    @cached_property
    def met(self) -> set[str]:
        """Rigid objects of which a collision or a tie may show the mass."""
        bodies = {o.name for o in self.world.objects}
        return {n for pair in self.contacts if bodies >= set(pair) for n in pair} | self.tied

    @cached_property
    def observed(self) -> set[str]:
        """Names of which anything is known, and deformable objects fastened to them: their motion shows these."""
        known = set(self.tracks.observed_names)
        pairs = [(a.object, a.to) for a in self.world.attachments if a.to is not None]
        return known | {one for pair in pairs for one in pair if known & set(pair)}

    @cached_property
    def begins(self) -> dict[str, float]:
        """When [s] each object's motion begins to show: at once where it moves, else when something reaches it."""
        found = {}
        for item in self.world.objects:
            state = self.states.get(item.name)
            if state is not None and (state.moves or item.name in self.tied):
                found[item.name] = item.start_time
            elif state is not None and item.name in self.touched:
                found[item.name] = self.touched[item.name]
        return found


def reasons_undeterminable(world: World, tracks: ObservedTracks) -> dict[str, str]:
    """Return, by parameter path, why the tracks say nothing about friction, damping, restitution, mass or materials.

    From the tracks alone: who moves, and who comes near whom. A path that is absent may still be undetermined;
    the sensitivity of the fit decides.
    """
    shown = Shown(world, tracks)
    reasons: dict[str, str] = {}
    for item in world.objects:
        head = f"objects.{item.name}"
        if item.name not in shown.begins:
            unobserved = item.name not in shown.states
            still = f"{item.name} {'was not observed' if unobserved else 'never moves in the observed frames'}"
            for field in ("friction", "linear_damping", "angular_damping", "rolling_resistance", "torsional_radius"):
                reasons[f"{head}.{field}"] = still
        if item.name not in shown.touched:
            reasons[f"{head}.restitution"] = f"no contact involving {item.name} in the observed frames"
        if item.name not in shown.met:
            reasons[f"{head}.mass"] = f"mass ratios enter through collisions only, and {item.name} meets no other body"
    for soft in world.deformables:
        if soft.name not in shown.observed:
            for field in material_of(soft).parameters:
                reasons[f"objects.{soft.name}.{field}"] = f"neither {soft.name} nor what it is fastened to was observed"
    first = next((o.name for o in world.objects if o.name in shown.met), None)
    if first is not None:
        reasons[f"objects.{first}.mass"] = (
            f"motion determines only ratios of masses: that of {first} is kept as their unit"
        )
    return reasons
