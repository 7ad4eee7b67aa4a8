"""Moving bodies of a compiled MuJoCo model as rigid objects: bodies welded together are one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.exchange.geoms import Placed, appearance, convex_geom, part_inertia, quaternion, vector
from polyworld.exchange.names import Names
from polyworld.exchange.surfaces import Surface, surface_of
from polyworld.world.description import Appearance
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Compound, Part, Sphere

Array = NDArray[np.float64]

MOST_PARTS = 64  # of a compound shape
ROUNDING = 1e-14  # share of an inertia's trace that is none
ALIKE = 1e-6  # difference of masses and inertias, as a share, up to which a shape's own is taken [1]


@dataclass
class MovingBody:
    """A rigid object and where it comes from.

    root: the body of the model whose joints it has. geoms: those it collides with. surface: of the first of them.
    """

    root: int
    item: RigidObject
    geoms: list[int]
    surface: Surface
    notes: list[str] = field(default_factory=list)


def moving_bodies(model: Any, data: Any, names: Names) -> list[MovingBody]:
    """Read all bodies that move, in the model's order."""
    roots = [b for b in range(1, model.nbody) if model.body_weldid[b] == b]
    return [_moving_body(model, data, root, names) for root in roots]


def rigid_shape(shapes: list[Placed], mass: float, centre: Array, inertia: Array, rotation: Array) -> tuple[Any, Array]:
    """Return a shape with a given centre of mass and inertia (world axes), and the rotation (3, 3) of its axes.

    shapes: its pieces, in world axes. rotation: of the axes of a compound. A single piece about its own centre whose
    inertia is that of a solid of this mass is the shape itself.
    """
    only = shapes[0]
    scale = float(np.sqrt(np.trace(inertia) / mass))
    if (
        len(shapes) == 1
        and np.linalg.norm(only.position - centre) <= ALIKE * scale
        and np.abs(part_inertia(only) * mass - inertia).max() <= ALIKE * np.abs(inertia).max()
    ):
        return only.shape, only.rotation
    parts = tuple(
        Part(
            shape=placed.shape,
            position=vector(rotation.T @ (placed.position - centre)),
            orientation=quaternion(rotation.T @ placed.rotation),
        )
        for placed in shapes[:MOST_PARTS]
    )
    own = rotation.T @ inertia @ rotation / mass
    own[np.abs(own) < ROUNDING * np.trace(own)] = 0.0
    moments = tuple(float(v) for v in (*np.diag(own), own[0, 1], own[0, 2], own[1, 2]))
    return Compound(parts=parts, centre_of_mass=(0.0, 0.0, 0.0), inertia=moments), rotation


def mass_and_inertia(model: Any, data: Any, bodies: list[int]) -> tuple[float, Array, Array]:
    """Mass [kg], centre of mass (3,) [m], inertia (3, 3) about it [kg m^2] of bodies that move as one, world axes."""
    masses = np.array([float(model.body_mass[b]) for b in bodies])
    places = np.array([data.xipos[b] for b in bodies])
    centre = masses @ places / masses.sum()
    inertia = np.zeros((3, 3))
    for body, mass, place in zip(bodies, masses, places, strict=True):
        axes = np.array(data.ximat[body]).reshape(3, 3)
        off = place - centre
        inertia += axes @ np.diag(model.body_inertia[body]) @ axes.T
        inertia += mass * (off @ off * np.eye(3) - np.outer(off, off))
    return float(masses.sum()), centre, inertia


def colour_of(model: Any, geom: int) -> Appearance:
    """Colour of a geom, of its material where it has one."""
    material = int(model.geom_matid[geom])
    return appearance(model.geom_rgba[geom] if material < 0 else model.mat_rgba[material])


def twist(model: Any, data: Any, body: int, point: Array) -> tuple[Array, Array]:
    """Velocity (3,) [m/s] of the point of a body that is at `point`, and its angular velocity (3,) [rad/s]."""
    import mujoco

    found = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, found, 0)
    omega, velocity = found[:3], found[3:]
    return velocity + np.cross(omega, point - np.array(data.xpos[body])), omega


def _moving_body(model: Any, data: Any, root: int, names: Names) -> MovingBody:
    members = [b for b in range(1, model.nbody) if model.body_weldid[b] == root]
    name = names.take(model.body(root).name, f"body{root}")
    notes: list[str] = []
    if len(members) > 1:
        welded = [model.body(b).name or f"body {b}" for b in members if b != root]
        notes.append(f"{name}: {', '.join(welded)}, welded to it, are part of it")
    mass, centre, inertia = mass_and_inertia(model, data, members)
    rotation = np.array(data.xmat[root]).reshape(3, 3)
    own = [g for g in range(model.ngeom) if model.geom_bodyid[g] in members]
    solid = [g for g in own if model.geom_contype[g] or model.geom_conaffinity[g]]
    shapes, used, seen = _shapes(model, data, solid or own, name, notes)
    if solid and len(solid) < len(own):
        notes.append(f"{name}: {len(own) - len(solid)} geoms that touch nothing are not part of its shape")
    if not shapes:
        radius = float(np.sqrt(2.5 * np.trace(inertia) / (3.0 * mass)))
        shapes = [Placed(Sphere(radius=max(radius, 1e-3)), centre, rotation)]
        notes.append(f"{name} has no geoms: a ball that touches nothing stands for it")
    if len(shapes) > MOST_PARTS:
        notes.append(f"{name}: {len(shapes) - MOST_PARTS} of its {len(shapes)} geoms are left out; the most is 64")
    shape, axes = rigid_shape(shapes, mass, centre, inertia, rotation)
    surface = surface_of(model, used[0]) if used else Surface(0.5)
    if len({surface_of(model, g) for g in used}) > 1:
        notes.append(f"{name}: its geoms differ in friction or rebound; all have those of the first")
    velocity, omega = twist(model, data, root, centre)
    damping = _free_damping(model, root, name, notes)
    item = RigidObject(
        name=name,
        shape=shape,
        appearance=colour_of(model, seen) if seen is not None else Appearance(),
        mass=mass,
        friction=surface.friction,
        restitution=surface.restitution,
        rolling_resistance=surface.rolling_resistance,
        torsional_radius=surface.torsional_radius,
        position=vector(centre),
        orientation=quaternion(axes),
        velocity=vector(velocity),
        angular_velocity=vector(omega),
        linear_damping=damping / mass,
        angular_damping=3.0 * damping / float(np.trace(inertia)),
    )
    return MovingBody(root, item, used if solid else [], surface, notes)


def _shapes(
    model: Any, data: Any, geoms: list[int], name: str, notes: list[str]
) -> tuple[list[Placed], list[int], int | None]:
    shapes, used = [], []
    for geom in geoms:
        found = convex_geom(model, data, geom)
        label = model.geom(geom).name or f"geom {geom}"
        if isinstance(found, str):
            notes.append(f"{name}: {label} is left out: {found}")
            continue
        if found.said:
            notes.append(f"{name}: {label} is {found.said}")
        shapes.append(found)
        used.append(geom)
    return shapes, used, used[0] if used else None


def _free_damping(model: Any, root: int, name: str, notes: list[str]) -> float:
    """Damping of a body's free joint [N s/m, N m s], 0 where it has none."""
    joint = int(model.body_jntadr[root])
    if model.body_jntnum[root] != 1 or model.jnt_type[joint] != 0:
        return 0.0
    first = int(model.jnt_dofadr[joint])
    damping, armature = float(model.dof_damping[first]), float(model.dof_armature[first])
    if armature:
        notes.append(f"{name}: the armature {armature:g} of its free joint is left out")
    if damping:
        notes.append(f"{name}: the damping of its free joint acts at its centre of mass, and equally about all axes")
    return damping
