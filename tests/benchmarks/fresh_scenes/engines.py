"""Bodies, surfaces and three simulators: MuJoCo, PyBullet where installed, and one of sliding. SI units."""

import importlib.util
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import mujoco
import numpy as np

Array = np.ndarray
Touch = tuple[str, str, float]  # who touch, and how deep they overlap
Motion = tuple[Array, list[tuple[float, str, str]], float]  # poses (frame, body, xyz wxyz), contacts' begin, depth
Advance = Callable[[float], list[Touch]]
RULES = {"product": lambda a, b: a * b, "minimum": min, "geometric mean": lambda a, b: math.sqrt(a * b)}
STIFFNESS = (math.pi / 0.006) ** 2  # MuJoCo: a touch lasts about 6 ms
RATIO = np.linspace(0, 0.999, 1000)  # damping ratios of a spring that only pushes, and what is left of the speed
LEFT = np.exp(-2 * RATIO * np.arccos(RATIO) / np.sqrt(1 - RATIO**2))
CREEP = 0.01  # in the plane: below this speed friction is viscous, m/s
CORNERS = np.array([1 + 1j, 1j - 1, -1j - 1, 1 - 1j])
K = np.arange(36)  # points of a footprint; in a disc the seeds of a sunflower


@dataclass(frozen=True)
class Body:
    """A body, or a static where `mass` is 0. Sizes: (radius,), half extents, (radius, half height)."""

    name: str
    material: str
    kind: str
    size: tuple[float, ...]
    mass: float
    position: Array
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    spin: Array = field(default_factory=lambda: np.zeros(3))
    orientation: Array = field(default_factory=lambda: np.eye(4)[0])
    support: Array = field(default_factory=lambda: np.zeros(3))  # normal of what it stands on at the start
    drag: float = 0.0  # drag coefficient times mean projected area, m²


@dataclass(frozen=True)
class World:
    bodies: tuple[Body, ...]
    surfaces: dict[str, tuple[float, float]]  # friction and restitution by material; "floor" is one
    rules: tuple[str, str] = ("product", "product")  # how two surfaces' friction, and restitution, make a pair's
    ramp: Body | None = None
    linear: float = 0.0  # viscous film under a footprint, N s/m³
    medium: float = 0.0  # density in ½ρCA|v|v, kg/m³
    rolling: float = 0.0  # coefficient of rolling friction of spheres, m
    gravity: float = 9.81

    def pair(self, a: str, b: str) -> tuple[float, float]:
        (f, e), (g, h) = self.surfaces[a], self.surfaces[b]
        return RULES[self.rules[0]](f, g), RULES[self.rules[1]](e, h)


def record(rate: float, frames: int, step: float, advance: Advance, pose: Callable[[], Array]) -> Motion:
    """Advance by steps no longer than `step` that divide a frame."""
    substeps, poses, contacts, depth, last = math.ceil(1 / (rate * step) - 1e-9), [pose()], [], 0.0, {}
    for k in range(1, (frames - 1) * substeps + 1):
        t = k / (rate * substeps)
        for a, b, overlap in advance(1 / (rate * substeps)):
            contacts += [(t, a, b)] if t - last.get((a, b), -1.0) > 0.03 else []
            last[a, b], depth = t, max(depth, overlap)
        poses += [pose()] if k % substeps == 0 else []
    return np.array(poses), contacts, depth


def with_mujoco(world: World, rate: float, frames: int, step: float = 5e-4) -> Motion:
    """Elliptic cones, and stiff contacts whose damping gives the pair's restitution."""
    spec = mujoco.MjSpec()
    spec.option.gravity, spec.option.cone = [0, 0, -world.gravity], mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.tolerance, spec.option.impratio = 1e-10, 10
    kinds = {k: getattr(mujoco.mjtGeom, f"mjGEOM_{k.upper()}") for k in ("plane", "sphere", "box", "cylinder")}
    spec.worldbody.add_geom(name="floor", type=kinds["plane"], size=[50, 50, 1], contype=0, conaffinity=0)
    materials = {"floor": "floor"}  # of the geoms, in their order
    for b in (*([world.ramp] if world.ramp else []), *world.bodies):
        body = spec.worldbody.add_body(pos=b.position, quat=b.orientation)
        body.add_geom(name=b.name, type=kinds[b.kind], size=(*b.size, 0, 0)[:3], mass=b.mass, contype=0, conaffinity=0)
        for name, material in materials.items() if b.mass else ():
            (friction, e), rolls = world.pair(b.material, material), b.kind == "sphere" and name in ("floor", "ramp")
            damping = 2 * math.sqrt(STIFFNESS) * float(np.interp(-e, -LEFT, RATIO))
            pair = spec.add_pair(geomname1=b.name, geomname2=name, condim=6 if rolls and world.rolling else 3)
            pair.friction = [friction, friction, world.rolling / 2, world.rolling, world.rolling]
            pair.solref, pair.solimp = [-STIFFNESS, -damping], [0.99, 0.99, 0.001, 0.5, 2]
        if b.mass:
            body.add_freejoint()
        materials[b.name] = b.material
    data, names = mujoco.MjData(model := spec.compile()), list(materials)
    speed = data.qvel.reshape(-1, 6)
    for b, v in zip(world.bodies, speed, strict=True):
        mujoco.mju_rotVecQuat(v[3:], b.spin, b.orientation * [1, -1, -1, -1])  # a free joint's spin: the body's frame
        v[:3] = b.velocity
    drag, energies = 0.5 * world.medium * np.array([[b.drag] for b in world.bodies]), []
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY

    def advance(dt: float) -> list[Touch]:
        model.opt.timestep, v = dt, speed[:, :3]
        data.xfrc_applied[-len(v) :, :3] = -drag * np.linalg.norm(v, axis=1, keepdims=True) * v
        mujoco.mj_step(model, data)
        energies.append(data.energy.sum())
        touching = zip(data.contact.geom.tolist(), data.contact.dist.tolist(), strict=True) if data.ncon else ()
        return [(names[min(p)], names[max(p)], -d) for p, d in touching]

    poses, contacts, depth = record(rate, frames, step, advance, data.qpos.reshape(-1, 7).copy)
    peaks = np.array([max(energies[k : k + 50]) for k in range(0, len(energies) - 50, 50)])
    return poses, contacts, depth if (peaks[1:] < 1.03 * peaks[:-1]).all() else math.inf  # a spurious gain of energy


def with_bullet(world: World, rate: float, frames: int, step: float = 5e-4) -> Motion:
    """Sequential impulses, its own products of two surfaces' coefficients, and drag as its damping a second."""
    import pybullet as p

    p.isConnected() or p.connect(p.DIRECT)
    p.resetSimulation()
    p.setGravity(0, 0, -world.gravity)
    p.setPhysicsEngineParameter(numSolverIterations=100, enableConeFriction=1, deterministicOverlappingPairs=1)
    # By default contacts begin before bodies meet, and how high a ball bounces depends on the phase of the steps.
    p.setPhysicsEngineParameter(contactBreakingThreshold=1e-4, contactERP=0.01, restitutionVelocityThreshold=0.02)
    names = {p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE)): ("floor", "floor", 0.0)}
    for b in (*world.bodies, *([world.ramp] if world.ramp else [])):
        size = {"halfExtents": b.size} if b.kind == "box" else {"radius": b.size[0], "height": 2 * b.size[-1]}
        shape = p.createCollisionShape(getattr(p, f"GEOM_{b.kind.upper()}"), **size)
        i = p.createMultiBody(b.mass, shape, -1, b.position.tolist(), np.roll(b.orientation, -1).tolist())
        names[i] = (b.name, b.material, world.rolling if b.kind == "sphere" else 0.0)
        p.resetBaseVelocity(i, b.velocity.tolist(), b.spin.tolist())
    for i, (_, material, rolling) in names.items():
        friction, restitution = world.surfaces[material]
        p.changeDynamics(i, -1, lateralFriction=friction, restitution=restitution, rollingFriction=rolling)
        p.changeDynamics(i, -1, linearDamping=world.medium / 20, angularDamping=0)
    moving = list(names)[1 : len(world.bodies) + 1]

    def advance(dt: float) -> list[Touch]:
        p.setTimeStep(dt)
        p.stepSimulation()
        found = [(min(c[1:3]), max(c[1:3]), -c[8]) for c in p.getContactPoints() if c[8] < 1e-3]
        return [(names[a][0], names[b][0], depth) for a, b, depth in found]

    pose = p.getBasePositionAndOrientation
    return record(rate, frames, step, advance, lambda: np.array([[*x, w, *q] for x, (*q, w) in map(pose, moving)]))


def _meet(a: Body, b: Body, xa: complex, xb: complex, ra: complex, rb: complex) -> tuple[complex, complex, float]:
    """Normal from a to b, point and depth of overlap (negative where apart); `ra` and `rb` are directions."""
    if b.kind == "cylinder":  # a is one too, or a box
        half, rim = (a.size[0], 0.0) if a.kind == "box" else (0.0, a.size[0])
        local = (xb - xa) / ra
        near = min(max(local.real, -half), half) + 1j * min(max(local.imag, -half), half)
        normal = (local - near) / (abs(local - near) + 1e-12)
        return ra * normal, xa + ra * (near + normal * rim), rim + b.size[0] - abs(local - near)
    ca, cb = (x + r * s * CORNERS for x, r, s in ((xa, ra, a.size[0]), (xb, rb, b.size[0])))
    axes = [axis if ((xb - xa) / axis).real > 0 else -axis for axis in (ra, 1j * ra, rb, 1j * rb)]
    depths = [float((ca / axis).real.max() - (cb / axis).real.min()) for axis in axes]
    local = np.concatenate([(ca - xb) / rb / b.size[0], (cb - xa) / ra / a.size[0]])
    inside = np.concatenate([ca, cb])[np.maximum(abs(local.real), abs(local.imag)) <= 1 + 1e-9]
    return axes[int(np.argmin(depths))], inside.mean() if len(inside) else (xa + xb) / 2, min(depths)


def sliding(world: World, rate: float, frames: int, step: float = 5e-4) -> Motion:
    """Upright discs and square boxes sliding in the (complex) plane: friction summed over footprints, impulses."""
    bodies, boxes = world.bodies, np.array([b.kind == "box" for b in world.bodies])
    mass, size, height = np.array([(b.mass, b.size[0], b.position[2]) for b in bodies]).T
    seeds, grid = np.sqrt((K + 0.5) / 36) * np.exp(1j * K * math.pi * (3 - math.sqrt(5))), K % 6 + 1j * (K // 6)
    marks = size[:, None] * np.where(boxes[:, None], (grid - 2.5 - 2.5j) / 3, seeds)
    area, inertia = size**2 * np.where(boxes, 4, math.pi), mass * size**2 * np.where(boxes, 2 / 3, 1 / 2)
    x, v = (np.array([getattr(b, part) for b in bodies]) @ [1, 1j, 0] for part in ("position", "velocity"))
    angle, w = np.array([(2 * math.atan2(b.orientation[3], b.orientation[0]), b.spin[2]) for b in bodies]).T
    coulomb = np.array([world.pair(b.material, "floor")[0] for b in bodies]) * mass * world.gravity
    drag = 0.5 * world.medium * np.array([b.drag for b in bodies])
    reach, (first, second) = size * np.where(boxes, math.sqrt(2), 1), np.triu_indices(len(bodies), 1)

    def advance(dt: float) -> list[Touch]:
        arm = marks * np.exp(1j * angle)[:, None]
        slip = v[:, None] + 1j * w[:, None] * arm
        pull = -slip / len(K) * (coulomb[:, None] / np.sqrt(abs(slip) ** 2 + CREEP**2) + (world.linear * area)[:, None])
        v[:] += dt * (pull.sum(1) - drag * abs(v) * v) / mass
        w[:] += dt * (np.conj(arm) * pull).imag.sum(1) / inertia
        x[:] += dt * v
        angle[:] += dt * w
        near = np.flatnonzero(abs(x[first] - x[second]) < reach[first] + reach[second])
        return [touch for k in near for touch in collide(int(first[k]), int(second[k]))]

    def collide(i: int, j: int) -> list[Touch]:
        i, j = (j, i) if bodies[i].kind == "cylinder" else (i, j)
        normal, point, depth = _meet(bodies[i], bodies[j], x[i], x[j], np.exp(1j * angle[i]), np.exp(1j * angle[j]))
        if depth <= 0:
            return []
        both, sign = [i, j], np.array([-1, 1])
        arm, m = 1j * (point - x[both]), mass[both]
        friction, restitution = world.pair(bodies[i].material, bodies[j].material)
        least, most = 0.0, math.inf
        for axis, kept in ((normal, restitution), (1j * normal, 0.0)):
            speed, lever = (sign @ (v[both] + w[both] * arm) / axis).real, sign * (arm / axis).real
            wanted = -(1 + kept * (speed < -0.02)) * speed / (1 / m + lever**2 / inertia[both]).sum()
            impulse = min(max(wanted, least), most)
            v[both] += sign * impulse * axis / m
            w[both] += lever * impulse / inertia[both]
            least, most = -friction * impulse, friction * impulse
        x[both] += sign * depth * normal * m[::-1] / m.sum()
        return [(bodies[i].name, bodies[j].name, depth)]

    def pose() -> Array:
        return np.stack([x.real, x.imag, height, np.cos(angle / 2), 0 * angle, 0 * angle, np.sin(angle / 2)], axis=1)

    return record(rate, frames, step, advance, pose)


ENGINES = {"mujoco": with_mujoco, "planar": sliding}
ENGINES |= {"bullet": with_bullet} if importlib.util.find_spec("pybullet") else {}
