"""The quantity behind each state predicate, and its margin: positive where the predicate holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.model import model_of
from polyworld.probing.closest_approach import height, surface_gaps
from polyworld.probing.predicates import (
    Above,
    AtRest,
    Below,
    Comparison,
    Deformed,
    Folded,
    Holds,
    InsideRegion,
    InView,
    MovedByMoreThan,
    Moving,
    NearerThan,
    Occupies,
    Part,
    PassesBefore,
    Predicate,
    ReachesBefore,
    Slack,
    Taut,
    WithinDistance,
    names_in,
)
from polyworld.probing.readouts import Amount, Front, read
from polyworld.probing.readouts.centreline import lengths_along
from polyworld.probing.readouts.deformation import folded_share, principal_stretches
from polyworld.probing.readouts.distribution import container_named, substance
from polyworld.trajectory import Trajectory
from polyworld.trajectory.events import point_speed, share_in_view, turning
from polyworld.world import World
from polyworld.world.description import Description
from polyworld.world.materials import PLANAR, Form, kinds_of, material_of

Array = NDArray[np.float64]

OWN_WEIGHT = 0.5  # share of a rope's weight above which it counts as taut
ABOUT: dict[type[Description], tuple[Form, ...]] = {
    Occupies: ("line", "sheet", "solid", "liquid"),
    Holds: ("liquid",),
    Taut: ("line",),
    Slack: ("line",),
    Folded: ("sheet",),
    Deformed: ("line", "sheet", "solid"),
}
"""Forms of materials that each of these statements can be made about."""


@dataclass(frozen=True)
class Margin:
    """quantity (T,): what a predicate compares, called `label`; margin (T,): positive where it holds, in `unit`."""

    quantity: Array
    margin: Array
    label: str

    @property
    def unit(self) -> str:
        """Unit of the margin, by the label's last word."""
        if self.label.endswith("_m_per_s"):
            return "m/s"
        last = self.label.rpartition("_")[2]
        return {"m2": "m^2", "m3": "m^3"}.get(last, last if last in ("m", "px", "N") else "1")


def why_unknown(world: World, trajectory: Trajectory, predicate: Predicate) -> str | None:
    """Return why a statement is undecidable in this world, else None: a material it does not apply to, no view."""
    soft = {d.name: d.representation for d in world.deformables}
    allowed = kinds_of(*ABOUT.get(type(predicate), ()))
    if allowed:
        for name in names_in(predicate):
            kind = soft.get(name, "rigid")
            if kind.removesuffix(PLANAR) not in allowed:
                choices = sorted(n for n, k in soft.items() if k.removesuffix(PLANAR) in allowed)
                scope = f"{predicate.predicate} applies to {' or '.join(allowed)}"
                other = "; for a rigid object's centre use inside_region"
                hint = other if isinstance(predicate, Occupies) and kind == "rigid" else ""
                return f"{scope}, but {name!r} is {kind}; choices: {choices}{hint}"
    if isinstance(predicate, Holds | Occupies) and predicate.container is not None:
        known = [c.name for c in world.containers]
        if predicate.container not in known:
            return f"no container is called {predicate.container!r}; containers: {known}"
    if isinstance(predicate, Holds) and not world.of_form("liquid"):
        return "there is no fluid in this world"
    if isinstance(predicate, Taut | Slack) and "tension" not in trajectory.deformables[predicate.object].quantities:
        return f"the rollout holds no tension of {predicate.object!r}"
    if isinstance(predicate, InView) and world.camera is None and world.region is None:
        return "this world has neither a camera nor a region: there is no view to be in"
    if isinstance(predicate, WithinDistance) and predicate.b is not None:
        rows = trajectory.active[:, trajectory.index(predicate.a)].nonzero()[0][:1]
        if len(rows) and surface_gaps(world, trajectory, predicate.a, predicate.b, rows) is None:
            return f"the distance of the surfaces of {predicate.a!r} and {predicate.b!r} is not known in this world"
    if isinstance(predicate, MovedByMoreThan):
        active = trajectory.times[trajectory.active[:, trajectory.index(predicate.object)]]
        if not len(active) or not active[0] - 1e-9 <= predicate.since <= active[-1] + 1e-9:
            covered = f"{active[0]:.6g} to {active[-1]:.6g} s" if len(active) else "no time"
            return f"where {predicate.object!r} is at {predicate.since:g} s is not covered: it is known for {covered}"
    return None


def state_margin(trajectory: Trajectory, world: World, predicate: Predicate) -> Margin:
    """Quantity and margin of a state predicate at every sample of a trajectory."""
    if isinstance(predicate, Holds):
        return _holds(trajectory, world, predicate)
    name = names_in(predicate)[0]
    i = trajectory.index(name)
    if isinstance(predicate, Moving | AtRest):
        speed = _speed(trajectory, name)
        label = "rms_point_speed_m_per_s" if name in trajectory.deformables else "speed_m_per_s"
        if isinstance(predicate, Moving):
            return Margin(speed, speed - predicate.speed, label)
        rest = 1.0 - speed / predicate.speed
        if name not in trajectory.deformables:  # a deformable object's points turn with it
            rest = np.minimum(rest, 1.0 - turning(world, trajectory, name) / predicate.spin)
        return Margin(speed, predicate.speed * rest, label)  # [m/s], of a spin in proportion
    if isinstance(predicate, InsideRegion):
        depth = _depth(trajectory.positions[:, i], np.asarray(predicate.lower), np.asarray(predicate.upper))
        return Margin(depth, depth, "depth_inside_m")
    if isinstance(predicate, InView):
        return _in_view(trajectory, world, name)
    if isinstance(predicate, Above | Below):
        return _height(trajectory, world, predicate)
    if isinstance(predicate, Occupies):
        return _occupies(trajectory, world, predicate)
    if isinstance(predicate, Taut | Slack):
        lowest = trajectory.deformables[name].quantities["tension"].min(axis=-1)
        least = _taut_tension(world, predicate)
        margin = lowest - least if isinstance(predicate, Taut) else least - lowest
        return Margin(lowest, margin, "lowest_tension_N")
    if isinstance(predicate, Folded):
        share = folded_share(trajectory.deformables[name].points, model_of(world).mesh(name))
        return Margin(share, share - predicate.share, "folded_share")
    if isinstance(predicate, Deformed):
        strain = largest_strain(trajectory, world, name)
        return Margin(strain, strain - predicate.strain, "largest_strain")
    if isinstance(predicate, MovedByMoreThan):
        places = trajectory.positions[:, i]
        origin = np.array([np.interp(predicate.since, trajectory.times, places[:, axis]) for axis in range(3)])
        moved = np.linalg.norm(places - origin, axis=1)
        beyond = np.where(trajectory.times >= predicate.since, moved - predicate.distance, -predicate.distance)
        return Margin(moved, beyond, "displacement_m")
    if isinstance(predicate, WithinDistance):
        gap = _target_gap(trajectory, world, predicate)
        return Margin(gap, predicate.distance - gap, "gap_m" if predicate.place is None else "distance_m")
    assert isinstance(predicate, NearerThan)
    other = trajectory.positions[:, trajectory.index(predicate.b)]
    distance = np.linalg.norm(trajectory.positions[:, i] - other, axis=1)
    return Margin(distance, predicate.distance - distance, "distance_m")


def passing_offset(
    trajectory: Trajectory,
    predicate: PassesBefore | ReachesBefore,
    name: str,
    covered: tuple[float, float],
) -> Array:
    """(T,) what changes sign when `name` passes: distance beyond a plane, or depth inside a box [m]."""
    points = _points(trajectory, name)
    if isinstance(predicate, ReachesBefore):
        lower, upper = np.asarray(predicate.lower), np.asarray(predicate.upper)
        if predicate.part == "centre":
            return _depth(trajectory.positions[:, trajectory.index(name)], lower, upper)
        depth = np.minimum(points - lower, upper - points).min(axis=-1)
        return _of_part(depth, predicate.part)
    axis = "xyz".index(predicate.axis)
    centre = trajectory.positions[:, trajectory.index(name), axis] - predicate.value
    if predicate.part == "centre":
        return centre
    # First and last are counted in the direction of the crossing: away from where the centre begins.
    known = np.flatnonzero((trajectory.times >= covered[0]) & np.isfinite(centre))
    sign = 1.0 if not len(known) or centre[known[0]] <= 0.0 else -1.0
    return _of_part(sign * (points[..., axis] - predicate.value), predicate.part)


def largest_strain(trajectory: Trajectory, world: World, name: str) -> Array:
    """|length / length without forces - 1| (T,): a rope's largest along it, else of the principal stretches of all.

    A rope's strain is its tension over its stiffness, which also holds on a pulley.
    """
    points = trajectory.deformables[name].points
    item: Any = world.deformable(name)
    mesh = model_of(world).mesh(name)
    if material_of(item).form == "line":
        tension = trajectory.deformables[name].quantities.get("tension")
        if tension is not None:
            strain: Array = np.abs(tension).max(axis=-1) / item.stretch_stiffness
            return strain
        whole: Array = np.abs(lengths_along(points)[:, -1] / mesh.measure.sum() - 1.0)
        return whole
    stretches = principal_stretches(points, mesh.nodes, mesh.measure)
    spanned = principal_stretches(mesh.nodes[None], mesh.nodes, mesh.measure)[0] > 0.5  # a flat sheet has two
    largest: Array = np.abs(stretches[:, spanned] - 1.0).max(axis=1)
    return largest


def share_in(trajectory: Trajectory, world: World, predicate: Occupies) -> Array:
    """Share (T,) of an object that is in a container or box, of what there is of it at the time; 0 where nothing is."""
    name = predicate.object
    place = Amount(object=name, container=predicate.container, lower=predicate.lower, upper=predicate.upper)
    inside = read(place, world, trajectory)[:, 0, 0]
    points = trajectory.deformables[name].points
    whole = np.isfinite(points).all(axis=-1) @ substance(
        world, world.deformable(name), model_of(world).mesh(name), points.shape[-2]
    )
    return np.where(whole > 0.0, inside / np.where(whole > 0.0, whole, 1.0), 0.0)


def _holds(trajectory: Trajectory, world: World, predicate: Holds) -> Margin:
    fluids = [d.name for d in world.of_form("liquid")]
    chosen = fluids if predicate.object is None else [predicate.object]
    container_named(world, predicate.container)
    parts = [read(Amount(object=f, container=predicate.container), world, trajectory)[:, 0, 0] for f in chosen]
    amount: Array = np.sum(parts, axis=0)
    label = "amount_m2" if world.planar else "amount_m3"
    return Margin(amount, _compared(amount, predicate.amount, predicate.comparison), label)


def _occupies(trajectory: Trajectory, world: World, predicate: Occupies) -> Margin:
    share = share_in(trajectory, world, predicate)
    return Margin(share, _compared(share, predicate.share, predicate.comparison), "share_inside")


def _compared(values: Array, limit: float, comparison: Comparison) -> Array:
    return values - limit if comparison == "more_than" else limit - values


def _speed(trajectory: Trajectory, name: str) -> Array:
    """Speed of a centre, or root mean square speed of a deformable object's points (T,) [m/s]."""
    if name in trajectory.deformables:
        return point_speed(trajectory.deformables[name].velocities)
    speed: Array = np.linalg.norm(trajectory.velocities[:, trajectory.index(name)], axis=1)
    return speed


def _points(trajectory: Trajectory, name: str) -> Array:
    """Points (T, k, 3) of an object: its centre alone where it is rigid."""
    if name in trajectory.deformables:
        return trajectory.deformables[name].points
    return trajectory.positions[:, trajectory.index(name), None]


def _of_part(values: Array, part: Part) -> Array:
    """Largest (first to pass) or smallest (last to pass) of values (T, k) of points; NaN where none is there."""
    known = np.isfinite(values)
    chosen = (
        np.where(known, values, -np.inf).max(axis=1)
        if part == "first_point"
        else np.where(known, values, np.inf).min(axis=1)
    )
    return np.where(known.any(axis=1), chosen, np.nan)


def _in_view(trajectory: Trajectory, world: World, name: str) -> Margin:
    if name in trajectory.deformables:
        share = share_in_view(world, trajectory.deformables[name].points)
        return Margin(share, share - 0.5 + 1e-12, "share_in_view")
    p = trajectory.positions[:, trajectory.index(name)]
    if world.camera is None:
        assert world.region is not None  # checked by `why_unknown`
        depth = _depth(p, np.asarray(world.region.lower), np.asarray(world.region.upper))
        return Margin(depth, depth, "depth_inside_m")
    size = np.array([world.camera.width, world.camera.height], dtype=float)
    depth = _depth(world.camera.project(p), np.zeros(2), size)
    depth = np.where(np.isfinite(depth), depth, -1.0)  # behind the camera
    return Margin(depth, depth, "depth_inside_px")


def _height(trajectory: Trajectory, world: World, predicate: Above | Below) -> Margin:
    upper, lower = (predicate.a, predicate.b) if isinstance(predicate, Above) else (predicate.b, predicate.a)
    if predicate.entirely:
        gap = _end(trajectory, world, upper, -1.0) - _end(trajectory, world, lower, 1.0)
        return Margin(gap, gap - predicate.margin, "vertical_gap_m")
    a, b = (trajectory.positions[:, trajectory.index(n), 2] for n in (predicate.a, predicate.b))
    sign = 1.0 if isinstance(predicate, Above) else -1.0
    return Margin(a - b, sign * (a - b) - predicate.margin, "height_difference_m")


def _end(trajectory: Trajectory, world: World, name: str, sign: float) -> Array:
    """Height (T,) of an object's highest (sign 1) or lowest (-1) point [m]."""
    if name in trajectory.deformables:
        return sign * read(Front(object=name, direction=(0.0, 0.0, sign)), world, trajectory)[:, 0, 0]
    item, i = world.object(name), trajectory.index(name)
    poses = zip(trajectory.positions[:, i], trajectory.orientations[:, i], strict=True)
    return np.array([height(item, p, q, highest=sign > 0) for p, q in poses])


def _target_gap(trajectory: Trajectory, world: World, predicate: WithinDistance) -> Array:
    """Gap (T,) between the surfaces of a and b, or distance of a's centre from a place [m]."""
    i = trajectory.index(predicate.a)
    if predicate.place is not None:
        distance: Array = np.linalg.norm(trajectory.positions[:, i] - np.asarray(predicate.place), axis=1)
        return distance
    assert predicate.b is not None
    active = trajectory.active[:, i]
    if predicate.b in trajectory.names:
        active = active & trajectory.active[:, trajectory.index(predicate.b)]
    rows = np.flatnonzero(active)
    gaps = surface_gaps(world, trajectory, predicate.a, predicate.b, rows)
    assert gaps is not None  # checked by `why_unknown`
    found = np.full(len(trajectory.times), 1e6)  # before both are there
    found[rows] = np.where(np.isfinite(gaps), gaps, 1e6)
    return found


def _taut_tension(world: World, predicate: Taut | Slack) -> float:
    if predicate.tension is not None:
        return predicate.tension
    item: Any = world.deformable(predicate.object)  # a rope, by `why_unknown`
    weight = item.linear_density * model_of(world).mesh(item.name).measure.sum()
    return float(OWN_WEIGHT * weight * np.linalg.norm(world.environment.gravity))


def _depth(points: Array, lower: Array, upper: Array) -> Array:
    depth: Array = np.minimum((points - lower).min(axis=1), (upper - points).min(axis=1))
    return depth
