"""Declare the constants of a study: what a fit may change beside initial states, with what is ordinary as priors."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.fit_settings import Gaussian, PriorSettings
from polyworld.estimation.study import Study
from polyworld.estimation.unknown import Unknown
from polyworld.expressions.effect import law_of
from polyworld.world import Effect, World, geometry
from polyworld.world.materials import material_of
from polyworld.world.parameter_tables import ParameterSpec
from polyworld.world.parameters import object_mass, parameter_paths, read_parameter, specification
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Capsule, Cylinder, Sphere

Rolling = Literal["slides", "rolls", "skids"]
"""How balls and lying cylinders move: launched without spin, rolling from the start, or never rolling up."""

ABSENT = 3.0  # deviations below a bound to which the coordinate of what may be absent goes
RESISTANCE, AIR_DRAG = "resistance", "resistance_by_area"  # names of effects that a fit adds
QUADRATIC = {"quadratic_damping", "quadratic_drag", "air_drag"}
ALIKE = 2.0  # ratio of areas over mass up to which all bodies are damped alike
AIR = 1.2  # [kg/m^3] density in which coefficients of drag are counted
PLANE = "environment.motion_plane.friction"
SKIDS = 0.5  # lever arm of rolling resistance, in radii, above friction's: no ball rolls up against it
COMMON = "of all without a material"
DECADES, RATIO = 100.0, 3.0  # a value outside the usual range, and a time base, are varied within this factor


def group(item: RigidObject) -> str:
    """Return what an object's constants are tied by: its material where one is stated, else itself.

    Objects of no stated material share what is ordinary among them, and depart from it as the evidence asks.
    """
    return item.appearance.material or item.name


def can_roll(item: RigidObject) -> bool:
    """Return whether an object is of a shape that rolls."""
    return isinstance(item.shape, Sphere | Cylinder | Capsule)


def with_resistance(world: World) -> World:
    """Return a world of rigid bodies with quadratic damping at rate 0, where it has no law of that kind.

    Where bodies differ in area over mass it has drag by area too.
    """
    kinds = {e.kind for e in world.effects}
    if world.coupled or not world.objects or kinds & QUADRATIC or world.joints:
        return world
    added = [Effect(name=RESISTANCE, kind="quadratic_damping", parameters={"rate": 0.0})]
    if np.ptp([_log_area_over_mass(o) for o in world.objects]) > np.log(ALIKE):
        drag = {"drag_coefficient": 0.0, "air_density": AIR}
        added.append(Effect(name=AIR_DRAG, kind="air_drag", parameters=drag))
    return world.model_copy(update={"effects": (*world.effects, *added)})


def constants(
    study: Study,
    settings: PriorSettings,
    *,
    rolling: Rolling = "slides",
    time_base: bool = False,
    materials: Sequence[str] | None = None,
) -> list[Unknown]:
    """Declare what runs share: coefficients by material, the surface's, dampings, masses that were not given,
    coefficients of effects, joints, pulleys, emitters and deformable materials.

    rolling: how what can roll moves. time_base: also seconds_per_frame. materials: fields of deformable materials,
    default those that their registry names; of liquids that no run shows, none: bodies in water say little of it.
    """
    rows = _Rows(study, settings, rolling)
    found = [*rows.frictions(), *rows.restitutions(), *rows.rolling_resistances(), *rows.dampings(), *rows.masses()]
    worlds = [run.world for run in study.runs]
    paths: dict[str, World] = {}
    seen = {name for run in study.runs for name in run.tracks.observed_names}
    for world in worlds:
        paths |= dict.fromkeys(_other_paths(world, materials, seen), world)
    taken = {path for u in found for path in u.paths}
    found += [
        joint_resistance(world, path, settings) if path.startswith("joints.") else flat(world, (path,))
        for path, world in paths.items()
        if path not in taken
    ]
    if time_base:
        value = worlds[0].time.seconds_per_frame
        spec = specification(worlds[0], "time.seconds_per_frame")
        lower, upper = max(spec.lower, value / RATIO), min(spec.upper, value * RATIO)
        path = ("time.seconds_per_frame",)
        found.append(Unknown("seconds_per_frame", path, "s", value, lower, upper, 0.3, scale="log"))
    return found


def _other_paths(world: World, materials: Sequence[str] | None, seen: Collection[str]) -> list[str]:
    """Paths of numbers that have no ordinary value: of effects, joints, pulleys, emitters, deformable materials."""
    ours = [e.name for e in world.effects if e.name in (RESISTANCE, AIR_DRAG) or e.kind == "collision_slack"]
    acting = [e for e in world.effects if e.enabled and e.name not in ours]
    found = [f"effects.{e.name}.{key}" for e in acting for key in law_of(e).parameters]
    for item in world.deformables:
        entry = material_of(item)
        beside = entry.form == "liquid" and item.name != world.of_form("liquid")[0].name  # densities enter as ratios
        fitted = (*entry.fitted, "density") if beside else entry.fitted
        if entry.form == "liquid" and item.name not in seen and materials is None:
            continue
        found += [
            f"objects.{item.name}.{f}" for f in (fitted if materials is None else materials) if f in entry.parameters
        ]
    if materials is None:
        for pulley in world.pulleys:  # a wheel that cannot turn rubs on the rope; one that can has a bearing
            found.append(f"pulleys.{pulley.name}.{'friction' if pulley.fixed_wheel else 'bearing_friction'}")
        found += [f"emitters.{e.name}.rate" for e in world.emitters]
    known = parameter_paths(world)
    joints = [
        f"joints.{j.name}.{f}" for j in world.joints if j.kind in ("hinge", "slider") for f in ("friction", "damping")
    ]
    return [path for path in (*found, *joints) if path in known]


def flat(world: World, paths: tuple[str, ...], name: str | None = None) -> Unknown:
    """Return an unknown over its usual range, in logarithms where that spans more than a decade above zero."""
    spec, value = specification(world, paths[0]), read_parameter(world, paths[0])
    lower, upper = _range(spec, value)
    name = name or paths[0].removeprefix("objects.").removeprefix("effects.")
    if lower > 0.0 and upper / lower > 10.0:
        start = float(np.sqrt(lower * upper)) if value is None or value <= 0.0 else value
        return Unknown(name, paths, spec.unit, start, lower, upper, 0.25 * float(np.log(upper / lower)), scale="log")
    sd = 0.25 * (upper - lower)
    start = float(np.clip(0.5 * (lower + upper) if value is None else value, lower, upper))
    return Unknown(name, paths, spec.unit, start, lower, upper, sd)


def _range(spec: ParameterSpec, value: float | None) -> tuple[float, float]:
    lower, upper = spec.search
    if value is not None and value > 0.0 and not lower <= value <= upper:
        factor = DECADES if lower > 0.0 and upper / lower > 10.0 else 2.0
        lower, upper = min(lower, value / factor), max(upper, value * factor)
    return max(spec.lower, lower), min(spec.upper, upper)


def joint_resistance(world: World, path: str, settings: PriorSettings) -> Unknown:
    """Return the friction or damping of a hinge or slider, which may be 0: half-normal.

    Friction counts as a share of the weight held (at a hinge at the rim of its pin), damping as a rate of decay.
    """
    _, name, field = path.split(".")
    joint = next(j for j in world.joints if j.name == name)
    item = world.object(joint.object)
    mass = read_parameter(world, f"objects.{item.name}.mass") or 1.0
    arm = float(np.linalg.norm(np.subtract(joint.anchor, item.position))) if joint.kind == "hinge" else 1.0
    weight = mass * float(np.linalg.norm(world.environment.gravity))
    rim = settings.pin * arm if joint.kind == "hinge" else 1.0
    sd = settings.joint_friction * weight * rim if field == "friction" else settings.joint_damping * mass * arm**2
    return _absent(path, (path,), specification(world, path).unit, max(sd, 1e-9))


class _Rows:
    """Unknowns of the rigid bodies of a study."""

    def __init__(self, study: Study, settings: PriorSettings, rolling: Rolling) -> None:
        self.study, self.settings, self.rolling = study, settings, rolling
        self.planar = study.runs[0].world.planar
        self.bodies = [o for run in study.runs for o in run.world.objects]
        self.groups: dict[str, list[RigidObject]] = {}
        for item in self.bodies:
            self.groups.setdefault(group(item), []).append(item)
        alone = [name for name, own in self.groups.items() if all(o.appearance.material is None for o in own)]
        self.unstated = alone if len(alone) > 1 else []

    def frictions(self) -> list[Unknown]:
        """Friction against the surface by group, and the surface's own, on which that of pairs of bodies hangs.

        A contact has the geometric mean of both coefficients: an object's own is the square of what it has against the
        surface over the surface's, and a pair of bodies has the product of theirs over the surface's. Balls that roll
        in a planar world slow down by rolling resistance, which is a friction of its own.
        """
        surface = self._surface()
        found: list[Unknown] = []
        common: list[RigidObject] = []
        for name, own in self.groups.items():
            apart = [o for o in own if isinstance(o.shape, Sphere)] if self.planar and self.rolling == "rolls" else []
            rest = [o for o in own if o not in apart]
            if rest and name in self.unstated:
                found.append(self._departure("friction", name, rest, 2.0 if surface else 1.0))
                common += rest
            elif rest:
                found.append(self._friction(f"friction of {name}", rest, self._prior_of(name), surface))
            if apart:
                found.append(self._friction(f"rolling friction of {name}", apart, self.settings.ln_rolling, surface))
        if common:
            found.append(self._friction(f"friction {COMMON}", common, self.settings.ln_friction, surface))
        if surface and self.bodies:
            mean, sd = self.settings.ln_surface
            every = _paths(self.bodies, "friction")
            powers = (1.0,) * len(surface) + (-1.0,) * len(every)
            found.append(_log("friction of the surface", (*surface, *every), mean, sd, (5e-3, 7.0), powers))
            for material, paths in self._other_surfaces().items():
                label, sd = f"friction of {material} over that of the surface", self.settings.ln_friction[1]
                found.append(_log(label, paths, 0.0, sd, (1e-2, 100.0), (2.0,) * len(paths)))
        return found

    def _departure(self, field: str, name: str, own: Sequence[RigidObject], power: float = 1.0) -> Unknown:
        """Return the factor by which an object departs from what objects of no stated material share."""
        paths, sd = _paths(own, field), self.settings.ln_departure
        found = _log(f"{field} of {name} over {COMMON}", paths, 0.0, sd, (0.1, 10.0), (power,) * len(paths))
        return self._of(own, found)

    def _of(self, own: Sequence[RigidObject], unknown: Unknown) -> Unknown:
        """Leave out runs in which the name of one of these objects is that of another."""
        ours = {id(item) for item in own}
        others = ((run.name, o.name) for run in self.study.runs for o in run.world.objects if id(o) not in ours)
        paths = {(run, p) for run, name in others for p in unknown.paths if p.startswith(f"objects.{name}.")}
        return replace(unknown, elsewhere=frozenset(paths))

    def _friction(self, name: str, own: Sequence[RigidObject], prior: Gaussian, surface: tuple[str, ...]) -> Unknown:
        paths = _paths(own, "friction")
        return self._of(own, _log(name, paths, *prior, (5e-4, 2.0), (2.0,) * len(paths) if surface else ()))

    def _prior_of(self, name: str) -> Gaussian:
        known = [v for word, v in self.settings.friction_of.items() if word in name.lower()]
        return (float(np.log(known[0][0])), known[0][1]) if known else self.settings.ln_friction

    def _surface(self) -> tuple[str, ...]:
        """Paths of the friction of what bodies move on, where none was given and bodies may meet."""
        worlds = [run.world for run in self.study.runs]
        if max(len(w.objects) for w in worlds) < 2 or any(w.coupled for w in worlds):
            return ()
        if self.planar:
            return (PLANE,) if worlds[0].environment.motion_plane.supports else ()
        statics = {s.name: s for w in worlds for s in w.statics}
        if any(s.friction is not None for s in statics.values()):
            return ()
        return tuple(f"statics.{name}.friction" for name in statics)

    def _other_surfaces(self) -> dict[str, tuple[str, ...]]:
        """Paths of the friction of fixed bodies by their material, where that is stated and not the first one's."""
        statics = {s.name: s for run in self.study.runs for s in run.world.statics}
        first = next((s.appearance.material for s in statics.values()), None)
        found: dict[str, tuple[str, ...]] = {}
        for name, static in statics.items():
            material = static.appearance.material
            if not self.planar and first and material and material != first:
                found[material] = (*found.get(material, ()), f"statics.{name}.friction")
        return found

    def restitutions(self) -> list[Unknown]:
        """Restitution by group; of objects without a stated material a common one, and factors on it."""
        found = list[Unknown]()
        for name, own in self.groups.items():
            if name not in self.unstated:
                mean, sd = self._bounce(own)
                label, paths = f"restitution of {name}", _paths(own, "restitution")
                found.append(self._of(own, Unknown(label, paths, "1", mean, 0.0, 1.0, sd, prior=(mean, sd))))
        if self.unstated:
            bodies = [o for name in self.unstated for o in self.groups[name]]
            label, paths, (mean, sd) = f"restitution {COMMON}", _paths(bodies, "restitution"), self._bounce(bodies)
            shared = _log(label, paths, float(np.log(mean)), sd / mean, (0.02, 1.0), ())
            found.append(self._of(bodies, shared))
            found += [self._departure("restitution", name, self.groups[name]) for name in self.unstated]
        return found

    def _bounce(self, own: Sequence[RigidObject]) -> Gaussian:
        """Prior of the restitution of what one material is said of."""
        balls = all(isinstance(o.shape, Sphere) for o in own)
        return self.settings.restitution_of_balls if balls else self.settings.restitution

    def rolling_resistances(self) -> list[Unknown]:
        """Lever arm over radius of what rolls, by group; in spatial worlds. Of what skids it is given."""
        if self.planar or self.rolling == "skids":
            return []
        found = []
        for name, own in self.groups.items():
            rollers = [o for o in own if can_roll(o)]
            if not rollers:
                continue
            radius = float(np.median([getattr(o.shape, "radius", 1.0) for o in rollers]))
            mean, sd = self.settings.ln_rolling
            low = (1e-4 * radius, 0.3 * radius)
            paths = _paths(rollers, "rolling_resistance")
            arm = _log(f"rolling resistance of {name}", paths, mean + float(np.log(radius)), sd, low, (), "m")
            found.append(self._of(rollers, arm))
        return found

    def dampings(self) -> list[Unknown]:
        """Rates of linear and quadratic damping that all bodies share, and rates that go as area over mass.

        What resists by area (a film, the air) brakes the lighter body more; what simulators call damping brakes all
        alike. A rate by area is that of a body of the mean area over mass.
        """
        logs: dict[str, list[float]] = {}
        for world in (run.world for run in self.study.runs if not run.world.joints):
            for item in world.objects:
                logs.setdefault(f"objects.{item.name}.linear_damping", []).append(_log_area_over_mass(item))
        if not logs:
            return []
        own = np.array([np.mean(found) for found in logs.values()])
        mean, by_area = float(np.exp(own.mean())), tuple(float(v) for v in np.exp(own - own.mean()))
        linear, quadratic = self.settings.linear_damping, self.settings.quadratic_damping
        effects = {e.name for run in self.study.runs for e in run.world.effects}
        found = [_absent("linear_damping", tuple(logs), "1/s", linear)]
        if RESISTANCE in effects:
            found.append(_absent("quadratic_damping", (f"effects.{RESISTANCE}.rate",), "1/m", quadratic))
        if AIR_DRAG in effects:
            path = (f"effects.{AIR_DRAG}.drag_coefficient",)
            found.append(_absent("linear_damping by area", tuple(logs), "1/s", linear, by_area))
            found.append(_absent("quadratic_damping by area", path, "1/m", quadratic, (2.0 / AIR / mean,)))
        return found

    def masses(self) -> list[Unknown]:
        """Masses that were not given, by group and shape; the first of those that may meet is their unit."""
        found: dict[str, list[RigidObject]] = {}
        for item in self.bodies:
            if item.mass is None:
                found.setdefault(f"{group(item)} {item.shape.model_dump_json()}", []).append(item)
        if all(o.mass is None for o in self.bodies) and found:
            found.pop(next(iter(found)))
        rows = []
        for own in found.values():
            world = next(run.world for run in self.study.runs if own[0] in run.world.objects)
            mass = read_parameter(world, f"objects.{own[0].name}.mass") or 1.0
            bounds = (mass / 30.0, mass * 30.0)
            name = f"mass of {', '.join(dict.fromkeys(o.name for o in own))}"
            unit = _log(name, _paths(own, "mass"), float(np.log(mass)), self.settings.ln_mass, bounds, (), "kg")
            rows.append(self._of(own, unit))
        return rows


def _paths(items: Sequence[RigidObject], field: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(f"objects.{o.name}.{field}" for o in items))


def _log_area_over_mass(item: RigidObject) -> float:
    """Return the logarithm of the cross-section of the ball of a body's volume over the body's mass [m^2/kg]."""
    volume = geometry.mass_properties(item.shape).volume
    return float(np.log(np.pi * (0.75 * volume / np.pi) ** (2.0 / 3.0) / object_mass(item)))


def _absent(name: str, paths: tuple[str, ...], unit: str, sd: float, powers: tuple[float, ...] = ()) -> Unknown:
    """Return a rate that may be 0, half-normal; each path takes it times its factor among `powers`."""
    return Unknown(name, paths, unit, sd / 3.0, 0.0, 20.0 * sd, sd, prior=(0.0, sd), powers=powers)


def _log(
    name: str,
    paths: tuple[str, ...],
    mean: float,
    sd: float,
    bounds: tuple[float, float],
    powers: tuple[float, ...],
    unit: str = "1",
) -> Unknown:
    start = float(np.clip(np.exp(mean), *bounds))
    return Unknown(name, paths, unit, start, *bounds, sd, prior=(mean, sd), scale="log", powers=powers)


def bounds_in_coordinates(unknowns: Sequence[Unknown]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return lower and upper bounds (S,) in the coordinates in which unknowns are varied.

    Where a prior is centred on the lower bound coordinates go on below it, and values stay there: an effect is absent
    with probability one half, and else half-normal.
    """
    low = np.array([np.log(u.lower) if u.scale == "log" else u.lower for u in unknowns], dtype=float)
    low -= np.array([ABSENT * u.prior[1] if u.prior and u.prior[0] == u.lower else 0.0 for u in unknowns])
    high = np.array([np.log(u.upper) if u.scale == "log" else u.upper for u in unknowns], dtype=float)
    return low, high
