"""Forces that may be missing and are the same everywhere: drag, wind, tilt, lift, frames that turn, buoyancy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from polyworld import geometry
from polyworld.estimation.candidate import Candidate, Variant
from polyworld.estimation.unknown import Unknown
from polyworld.gap.catalogue.adding import BODIES, RIGID, effect, neutral, of_effect, with_effects
from polyworld.gap.catalogue.unseen_spin import lift_by_unseen_spins
from polyworld.gap.conditions import SHARE, Conditions, conditions
from polyworld.parameters import object_mass
from polyworld.recording import Recording
from polyworld.world import Effect, World

WIDE = 300.0  # ordinary sizes that an effect may have at most
APART = 4  # most bodies that are given a drag coefficient each
WINDS = (1.0, 3.0)  # speeds of the air to begin with, in typical speeds of the bodies


def one_effect(
    world: World,
    kind: str,
    typical: Mapping[str, float],
    *,
    label: str = "",
    same_as: tuple[str, ...] = (),
    parameters: Mapping[str, float] | None = None,
) -> Variant:
    """An effect whose parameters named in `typical` are unknown, from the law's neutral values on."""
    added = effect(world, kind, parameters)
    unknowns = tuple(of_effect(added, p, size, lower=-WIDE * size, upper=WIDE * size) for p, size in typical.items())
    strength = unknowns[0].name if len(unknowns) == 1 else None
    return Variant(with_effects(world, added), unknowns, (neutral(unknowns),), label, strength, same_as)


def unequal(values: Sequence[float]) -> bool:
    """Whether some differ by more than a per cent."""
    return len(values) > 1 and max(values) > 1.01 * min(values)


def _masses_differ(world: World) -> bool:
    return unequal([object_mass(o) for o in world.objects])


def _across(world: World, found: Conditions) -> list[int]:
    """World axes along which a uniform force shows other than as gravity."""
    gravity = np.abs(np.asarray(world.environment.gravity))
    axes = list(found.axes)
    down = int(np.argmax(gravity))
    if gravity[down] > 0.0 and down in axes:
        axes.remove(down)
    return axes


def _tilt(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    axes = _across(world, found)
    if not axes:
        return ()
    differ = _masses_differ(world) and not world.deformables
    made = [
        one_effect(
            world,
            "uniform_acceleration",
            {"xyz"[a]: SHARE * found.acceleration for a in axes},
            label="one acceleration of all bodies" if differ else "",
        )
    ]
    if differ:
        made.append(
            one_effect(world, "uniform_force", {"xyz"[a]: found.force for a in axes}, label="one force on all bodies")
        )
    return tuple(made)


def _per_body(world: World, kind: str, parameter: str, typical: float) -> Variant:
    """An effect of its own for each body."""
    added: list[Effect] = []
    unknowns: list[Unknown] = []
    for item in world.objects:
        own = effect(world, kind, name=f"{kind}_{item.name}", objects=(item.name,))
        added.append(own)
        name = f"{parameter}_{item.name}"
        unknowns.append(of_effect(own, parameter, typical, name=name, upper=WIDE * typical))
    child = with_effects(world, *added)
    return Variant(child, tuple(unknowns), (neutral(unknowns),), "each body by itself")


def _linear_drag(world: World, recording: Recording) -> tuple[Variant, ...]:
    if not world.objects:
        return ()
    found = conditions(world, recording)
    typical = found.force / found.speed
    same = ("viscous_friction",) if found.supported else ()
    if not _masses_differ(world):
        made = [one_effect(world, "linear_drag", {"coefficient": typical}, same_as=same)]
    else:
        made = [
            one_effect(
                world, "linear_drag", {"coefficient": typical}, label="one coefficient for all bodies", same_as=same
            ),
            one_effect(
                world, "linear_damping", {"rate": typical / found.mass}, label="one coefficient per mass", same_as=same
            ),
        ]
    if len(world.objects) == 2:
        made.append(_per_body(world, "linear_drag", "coefficient", typical))
    return tuple(made)


def _quadratic_drag(world: World, recording: Recording) -> tuple[Variant, ...]:
    if not world.objects:
        return ()
    found = conditions(world, recording)
    typical = found.force / found.speed**2
    volumes = [object_mass(o) for o in world.objects], [_radius(world, o.name) for o in world.objects]
    several = len(world.objects) > 1
    made = [
        one_effect(
            world,
            "quadratic_drag",
            {"coefficient": typical},
            label="one coefficient for all bodies" if several else "",
        )
    ]
    if unequal(volumes[0]):
        made.append(
            one_effect(world, "quadratic_damping", {"rate": typical / found.mass}, label="one coefficient per mass")
        )
    if unequal(volumes[1]):
        radius = float(np.median(volumes[1]))
        coefficient = typical / (0.5 * 1.2 * np.pi * radius**2)
        made.append(
            one_effect(world, "air_drag", {"drag_coefficient": coefficient}, label="one drag coefficient, by area")
        )
        if len(world.objects) <= APART:
            made.append(_per_body(world, "air_drag", "drag_coefficient", coefficient))
    elif len(world.objects) == 2:
        made.append(_per_body(world, "quadratic_drag", "coefficient", typical))
    return tuple(made)


def _radius(world: World, name: str) -> float:
    """That of the ball of equal volume, as laws of drag take it."""
    volume = geometry.mass_properties(world.object(name).shape).volume
    return float(np.cbrt(3.0 * volume / (4.0 * np.pi)))


def _wind(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not world.objects or not found.axes:
        return ()
    ground = _across(world, found)
    up = [a for a in found.axes if a not in ground]
    if not ground or not up:
        return (_wind_along(world, found, found.axes, found.axes, ""),)
    return (
        _wind_along(world, found, ground, ground, "along the ground"),
        _wind_along(world, found, found.axes, up, "of any direction"),
    )


def _wind_along(world: World, found: Conditions, axes: Sequence[int], begin: Sequence[int], label: str) -> Variant:
    """Wind with components along `axes`; fits begin in still air and with wind along each of `begin`."""
    added = effect(world, "wind")
    typical = found.force / found.speed**2
    unknowns = (
        of_effect(added, "coefficient", typical, upper=WIDE * typical),
        *(of_effect(added, f"velocity_{'xyz'[a]}", found.speed) for a in axes),
    )
    starts = [neutral(unknowns)]
    for a in begin:
        for speed in WINDS:
            starts += [neutral(unknowns, **{f"velocity_{'xyz'[a]}": s * speed * found.speed}) for s in (1.0, -1.0)]
    idle = tuple(u.name for u in unknowns[1:])
    return Variant(with_effects(world, added), unknowns, tuple(starts), label, "coefficient", idle=idle)


def _magnus(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if found.spin <= 0.0:
        return lift_by_unseen_spins(world, recording)
    typical = found.force / (found.speed * max(found.spin, 1.0))
    return (one_effect(world, "magnus_lift", {"coefficient": typical}),)


def _coriolis(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if len(found.axes) < 2:
        return ()
    axes = [a for a in range(3) if not world.planar or a not in found.axes]
    typical = SHARE * found.acceleration / (2.0 * found.speed)
    return (one_effect(world, "coriolis", {f"rotation_{'xyz'[a]}": typical for a in axes}),)


def _buoyancy(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    gravity = np.asarray(world.environment.gravity)
    if not world.objects or not any(abs(gravity[a]) > 1e-9 for a in found.axes):
        return ()
    added = effect(world, "buoyancy")
    unknowns = (of_effect(added, "density_ratio", SHARE / 1.5, upper=0.99),)
    same = ("gravity_error", "observer_clock") + (() if found.touches else ("observer_scale",))
    return (Variant(with_effects(world, added), unknowns, (neutral(unknowns),), "", "density_ratio", same),)


def _spin_damping(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    rubs = found.touches and any(o.friction > 0.0 for o in world.objects)
    measured = any(np.isfinite(m).any() for run in recording.runs for m in (run.orientations, run.angular_velocities))
    if not world.objects or found.spin <= 0.0 or not (measured or rubs):
        return ()
    inertia = 0.4 * found.mass * max(found.radius, 1e-6) ** 2
    typical = 0.2 * inertia / max(found.duration, 1e-6)
    return (
        one_effect(world, "spin_damping", {"coefficient": typical}, label="in proportion to the spin"),
        one_effect(world, "spin_drag", {"coefficient": typical / found.spin}, label="as the square of the spin"),
    )


def _viscous_friction(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not world.objects or not found.slides:
        return ()
    same = ("linear_drag",) if found.supported else ()
    return (one_effect(world, "viscous_friction", {"coefficient": found.force / found.speed}, same_as=same),)


CANDIDATES = (
    Candidate(
        name="tilt",
        group="force",
        law="a = (a_x, a_y) across gravity, everywhere and always; or one force on all bodies",
        representations=BODIES,
        signature="residual in one direction that grows as the square of the time, alike in all runs",
        reference="Landau & Lifshitz, Mechanics, 39",
        variants=_tilt,
        confused_with={
            "periodic_forcing": "a slow swing: start later, or watch for longer",
            "wind": "a release at rest and a throw against it: wind brakes by speed",
            "observer_tilt": "a body at rest on the floor: a tilted camera shows it displaced, not accelerated",
        },
    ),
    Candidate(
        name="linear_drag",
        group="force",
        law="F = -c v",
        representations=RIGID,
        signature="residual against the velocity, in proportion to it",
        reference="Stokes (1851); Landau & Lifshitz, Mechanics, 25",
        variants=_linear_drag,
        confused_with={
            "quadratic_drag": "speeds that differ threefold",
            "viscous_friction": "free flight",
            "restitution_error": "the residual between impacts",
        },
    ),
    Candidate(
        name="quadratic_drag",
        group="force",
        law="F = -k |v| v, k = rho C_d A / 2",
        representations=RIGID,
        signature="residual against the velocity, in proportion to its square",
        reference="Newton, Principia II; Batchelor, An Introduction to Fluid Dynamics, 5.11",
        variants=_quadratic_drag,
        confused_with={
            "linear_drag": "speeds that differ threefold",
            "wind": "opposite headings, or a release at rest",
            "gravity_error": "a drop alone: watch it rise, or throw it sideways",
        },
    ),
    Candidate(
        name="wind",
        group="force",
        law="F = -k |v - u| (v - u)",
        representations=RIGID,
        signature="a push in one direction, stronger on what moves against it",
        reference="Batchelor, An Introduction to Fluid Dynamics, 5.11",
        variants=_wind,
        confused_with={
            "quadratic_drag": "opposite headings, or a release at rest",
            "tilt": "the push on a body at rest against that on one that flies against it",
        },
    ),
    Candidate(
        name="magnus_lift",
        group="force",
        law="F = s (omega x v)",
        representations=RIGID,
        signature="residual across both spin and velocity",
        reference="Rubinow & Keller (1961), J. Fluid Mech. 11, 447",
        variants=_magnus,
        confused_with={"coriolis": "the same throw with the spin reversed; of unseen spins, more throws"},
    ),
    Candidate(
        name="coriolis",
        group="force",
        law="F = -2 m Omega x v",
        representations=BODIES,
        signature="residual across the velocity, to the same side whatever the heading",
        reference="Landau & Lifshitz, Mechanics, 39",
        variants=_coriolis,
        confused_with={"magnus_lift": "the same throw with the spin reversed"},
    ),
    Candidate(
        name="buoyancy",
        group="force",
        law="m (1 + C r) a = m g (1 - r), r = rho_fluid / rho_body, C = 1/2",
        representations=RIGID,
        signature="all that falls falls too slowly, alike at all speeds",
        reference="Batchelor, An Introduction to Fluid Dynamics, 6.8",
        variants=_buoyancy,
        confused_with={
            "gravity_error": "a body of another density in the same place",
            "observer_scale": "a known length",
            "observer_clock": "a known time",
        },
    ),
    Candidate(
        name="spin_damping",
        group="force",
        law="torque = -c omega, of a ball that turns fast -k |omega| omega",
        representations=RIGID,
        signature="a spin that decays in free motion; bounces that kick less the later they come",
        reference="Landau & Lifshitz, Fluid Mechanics, 20; Sawatzki (1970), Acta Mech. 9, 159",
        variants=_spin_damping,
        confused_with={"friction_error": "the spin before the first contact"},
        torque=True,
    ),
    Candidate(
        name="viscous_friction",
        group="force",
        law="F = -c v while in contact",
        representations=RIGID,
        signature="deceleration in contact that grows with the speed; none in flight",
        reference="Olsson et al. (1998), Eur. J. Control 4, 176",
        variants=_viscous_friction,
        confused_with={
            "linear_drag": "free flight",
            "friction_error": "sliding at several speeds",
        },
    ),
)
