# ruff: noqa: ARG001, ARG005  (every law has the same arguments and uses some)
"""Cases of two to six discs that collide on a level plane, with one effect hidden.

An effect's strength is drawn so that it moves the discs by 3 to 15% of the path scale, root mean square per coordinate
over all runs, from the same starts (nothing is refitted: a collision that comes late makes such a fit a search).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.first_generator.cases import Case
from tests.benchmarks.first_generator.laws import unit
from tests.benchmarks.first_generator.observer import Fault, noisy
from tests.scenes.ball import Patch, UnusableCase
from tests.scenes.discs import Discs, Started, slide

Array = NDArray[np.float64]
Numbers = dict[str, float]

FRICTION, RESTITUTION, THICKNESS = 0.15, 0.8, 0.05
DURATION, RATE = 1.5, 60.0
HELD_OUT_RUNS = 2
SMALLEST, LARGEST = 0.03, 0.15
ROUNDS = 7
ATTEMPTS = 30
NUDGE = 1e-4  # [m], [m/s] or [rad/s]


@dataclass(frozen=True)
class Scene:
    """Discs, how each run begins, instants (T,) and base paths (runs, T, n, 2). The first `fitted` are given."""

    discs: Discs
    starts: tuple[Started, ...]
    fitted: int
    stamps: Array
    paths: Array

    @property
    def path_scale(self) -> float:
        """Standard deviation of a coordinate [m] about its mean in the run."""
        return float(np.sqrt(np.mean((self.paths - self.paths.mean(axis=1, keepdims=True)) ** 2)))


@dataclass(frozen=True)
class DiscEffect:
    """One effect without its strength; see `laws.Drawn`."""

    name: str
    apply: Callable[[Discs, float], Discs]
    true_values: Callable[[float], Numbers]
    guess: float
    most: float = np.inf
    place: Numbers | None = None
    fault: Callable[[float], Fault] | None = None


Draw = Callable[[np.random.Generator, Scene], DiscEffect]


def _pushed(discs: Discs, law: Callable[[float, Array, Array, Array], Array]) -> Discs:
    return replace(discs, forces=(*discs.forces, law))


def tilt(rng: np.random.Generator, scene: Scene) -> DiscEffect:
    d = unit(rng, flat=True)[:2]
    return DiscEffect(
        "tilt",
        lambda b, s: _pushed(b, lambda t, x, v, w: s * b.masses[:, None] * d),
        lambda s: {"x": s * d[0], "y": s * d[1]},
        0.2,
        0.9 * FRICTION * 9.81,
    )


def linear_drag(rng: np.random.Generator, scene: Scene) -> DiscEffect:
    return DiscEffect(
        "linear_drag", lambda b, s: _pushed(b, lambda t, x, v, w: -s * v), lambda s: {"coefficient": s}, 0.1
    )


def quadratic_drag(rng: np.random.Generator, scene: Scene) -> DiscEffect:
    return DiscEffect(
        "quadratic_drag",
        lambda b, s: _pushed(b, lambda t, x, v, w: -s * np.linalg.norm(v, axis=1, keepdims=True) * v),
        lambda s: {"coefficient": s},
        0.05,
    )


def coriolis(rng: np.random.Generator, scene: Scene) -> DiscEffect:
    sign = float(rng.choice([-1.0, 1.0]))
    return DiscEffect(
        "coriolis",
        lambda b, s: _pushed(
            b, lambda t, x, v, w: 2.0 * sign * s * b.masses[:, None] * np.column_stack([v[:, 1], -v[:, 0]])
        ),
        lambda s: {"rotation_z": sign * s},
        0.2,
    )


def friction_error(rng: np.random.Generator, scene: Scene) -> DiscEffect:
    sign = float(rng.choice([-1.0, 1.0]))
    return DiscEffect(
        "friction_error",
        lambda b, s: replace(b, frictions=b.frictions * np.exp(sign * s)),
        lambda s: {"friction": FRICTION * float(np.exp(sign * s))},
        0.2,
        1.2,
    )


def restitution_error(rng: np.random.Generator, scene: Scene) -> DiscEffect:
    sign = float(rng.choice([-1.0, 1.0], p=[0.7, 0.3]))
    most = 0.18 if sign > 0.0 else 0.6
    return DiscEffect(
        "restitution_error",
        lambda b, s: replace(b, restitution=RESTITUTION + sign * s),
        lambda s: {"restitution": RESTITUTION + sign * s},
        0.1,
        most,
    )


def mass_error(rng: np.random.Generator, scene: Scene) -> DiscEffect:
    """One disc is heavier or lighter than stated: only ratios of masses show."""
    which, sign = int(rng.integers(len(scene.discs.masses))), float(rng.choice([-1.0, 1.0]))

    def apply(b: Discs, s: float) -> Discs:
        masses = b.masses.copy()
        masses[which] *= np.exp(sign * s)
        return replace(b, masses=masses)

    return DiscEffect("mass_error", apply, lambda s: {}, 0.3, 1.5)


def friction_patch(rng: np.random.Generator, scene: Scene) -> DiscEffect:
    sign = float(rng.choice([-1.0, 1.0]))
    for _ in range(300):
        (x, y), radius = rng.uniform(-0.7, 0.7, 2), float(rng.uniform(0.25, 0.5))
        inside = np.hypot(*(scene.paths[: scene.fitted] - [x, y]).transpose(3, 0, 1, 2)) < radius
        if (inside.sum(axis=1) > 5).sum() >= 3:
            break

    def value(s: float) -> float:
        return FRICTION * float(np.exp(sign * s))

    return DiscEffect(
        "friction_patch",
        lambda b, s: replace(b, patches=(Patch(float(x), float(y), radius, value(s)),)),
        lambda s: {"x": float(x), "y": float(y), "radius": radius, "friction": value(s) - FRICTION},
        0.5,
        2.0,
        {"x": float(x), "y": float(y), "extent": radius},
    )


def spring(rng: np.random.Generator, scene: Scene) -> DiscEffect:
    anchor = rng.uniform(-1.0, 1.0, 2)
    return DiscEffect(
        "spring",
        lambda b, s: _pushed(b, lambda t, x, v, w: -s * (x - anchor)),
        lambda s: {"stiffness": s, "anchor_x": float(anchor[0]), "anchor_y": float(anchor[1])},
        0.3,
    )


def observer_scale(rng: np.random.Generator, scene: Scene) -> DiscEffect:
    sign = float(rng.choice([-1.0, 1.0]))
    return DiscEffect(
        "observer_scale",
        lambda b, s: b,
        lambda s: {"scale": 1.0 + sign * s},
        0.05,
        0.3,
        fault=lambda s: Fault(scale=1.0 + sign * s),
    )


EFFECTS: dict[str, Draw] = {
    f.__name__: f
    for f in (tilt, linear_drag, quadratic_drag, coriolis, friction_error, restitution_error,
              mass_error, friction_patch, spring, observer_scale)
}  # fmt: skip


@dataclass(frozen=True)
class HiddenDiscs:
    """A case that was drawn."""

    case: Case
    scene: Scene
    effect: DiscEffect | None
    strength: float
    size: float

    def runs(self, rng: np.random.Generator, which: Sequence[int]) -> list[tuple[str, Any, Any, Any]]:
        """Noisy runs: name, stamps, positions (T, n, 3), orientations (T, n, 4)."""
        discs, fault = _laws(self.scene, self.effect, self.strength)
        sigma = self.case.noise * self.scene.path_scale
        found = []
        for k in which:
            path = slide(discs, self.scene.starts[k], self.scene.stamps)
            positions = np.zeros((*path.shape[:2], 3))
            positions[..., :2] = path[..., :2]
            half = 0.5 * path[..., 2]
            turns = np.stack([np.cos(half), np.zeros_like(half), np.zeros_like(half), np.sin(half)], axis=-1)
            places, seen_turns = fault.seen(positions, turns)
            seen, turned, keep = noisy(places, seen_turns, rng, sigma=sigma, angle=self.case.noise, kind=self.case.kind)
            seen[..., 2] = 0.0  # a camera above shows turns about the vertical, and no height
            turned[..., 1:3] = 0.0
            turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
            turned[:, :] = turned if self.case.turns else np.nan
            found.append((f"run{k}", self.scene.stamps[keep], seen[keep], turned[keep]))
        return found

    @property
    def names(self) -> list[str]:
        """Names of the discs."""
        return [f"disc{i}" for i in range(len(self.scene.discs.masses))]

    def world_json(self) -> dict[str, Any]:
        """Return the base world, given to the solver."""
        d, first = self.scene.discs, self.scene.starts[0]
        return {
            "objects": [
                {
                    "name": name,
                    "representation": "rigid_planar",
                    "shape": {"kind": "cylinder", "radius": float(d.radii[i]), "half_height": 0.5 * THICKNESS},
                    "mass": float(d.masses[i]),
                    "friction": FRICTION,
                    "restitution": RESTITUTION,
                    "torsional_radius": float(d.share * d.radii[i]),
                    "position": [round(float(v), 2) for v in first.positions[i]] + [0.0],
                }
                for i, name in enumerate(self.names)
            ],
            "environment": {"gravity": [0.0, 0.0, -9.81], "motion_plane": {"supports": True}},
            "time": {"seconds_per_frame": 1.0 / RATE, "substep": 0.002},
        }

    @property
    def effects(self) -> list[dict[str, Any]]:
        """What is hidden: name, size as a share of the path scale, true numbers, place."""
        if self.effect is None:
            return []
        numbers = {k: float(v) for k, v in self.effect.true_values(self.strength).items()}
        return [{"name": self.effect.name, "size": self.size, "numbers": numbers, "place": self.effect.place}]


def draw_discs(case: Case, seed: int) -> HiddenDiscs:
    """Draw a case's discs, starts and effect; raises UnusableCase where nothing usable is found."""
    name = case.effects[0] if case.effects else ""
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([seed, 3, case.draw, case.bodies, attempt, *(ord(c) for c in name)])
        try:
            scene = _scene(rng, case.bodies, case.runs)
            if not name:
                return HiddenDiscs(case, scene, None, 0.0, 0.0)
            target = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))
            effect = EFFECTS[name](rng, scene)
            strength, size = _strength(scene, effect, target)
        except UnusableCase:
            continue
        if 0.5 * SMALLEST < size < 2.0 * LARGEST:
            return HiddenDiscs(case, scene, effect, strength, size)
    raise UnusableCase(f"{case.name}: no usable draw of {name!r} in {ATTEMPTS} attempts")


def _laws(scene: Scene, effect: DiscEffect | None, strength: float) -> tuple[Discs, Fault]:
    if effect is None:
        return scene.discs, Fault()
    fault = Fault() if effect.fault is None else effect.fault(strength)
    return effect.apply(scene.discs, strength), fault


def _strength(scene: Scene, effect: DiscEffect, target: float) -> tuple[float, float]:
    """The strength that leaves about `target` of the path scale once the starts are refitted, and what it leaves.

    The refit is linear, at the base world's motion: collisions make much of little, and a solver would take that up.
    """
    taken_up = [_taken_up(scene, k) for k in range(scene.fitted)]

    def size(s: float) -> float:
        discs, fault = _laws(scene, effect, s)
        left = []
        for k, basis in enumerate(taken_up):
            path = slide(discs, scene.starts[k], scene.stamps, tolerance=1e-7)[..., :2]
            moved = (fault.scale * path - scene.paths[k]).ravel()
            left.append(moved - basis @ (basis.T @ moved))
        return float(np.sqrt(np.mean(np.square(left)))) / scene.path_scale

    s = min(effect.guess, effect.most)
    got = size(s)
    for _ in range(ROUNDS):
        if target / 1.3 < got < target * 1.3 or (s >= effect.most and got < target):
            break
        s = min(s * float(np.clip(target / max(got, 1e-9), 0.2, 5.0)), effect.most)
        got = size(s)
    return s, got


def _taken_up(scene: Scene, k: int) -> Array:
    """Orthonormal basis (m, 5 n) of what small changes of a run's start do to its positions in the base world."""
    start = scene.starts[k]
    columns = []
    for name in ("positions", "velocities", "spins"):
        value = getattr(start, name)
        for index in np.ndindex(value.shape):
            changed = value.copy()
            changed[index] += NUDGE
            path = slide(scene.discs, replace(start, **{name: changed}), scene.stamps, tolerance=1e-7)[..., :2]
            columns.append((path - scene.paths[k]).ravel() / NUDGE)
    basis, size, _ = np.linalg.svd(np.array(columns).T, full_matrices=False)
    found: Array = basis[:, size > 1e-6 * size.max()]
    return found


def _scene(rng: np.random.Generator, bodies: int, runs: int) -> Scene:
    """Unlike discs on a ring, most of them thrown at one another across its middle, some at rest near the middle."""
    radii = np.round(rng.uniform(0.06, 0.14, bodies), 3)
    masses = np.round(rng.uniform(0.3, 1.5, bodies), 2)
    discs = Discs(masses, radii, np.full(bodies, FRICTION), RESTITUTION)
    stamps = np.arange(round(DURATION * RATE) + 1) / RATE
    starts = tuple(_start(rng, radii, bodies) for _ in range(runs + HELD_OUT_RUNS))
    paths = np.array([slide(discs, s, stamps, tolerance=1e-7)[..., :2] for s in starts])
    return Scene(discs, starts, runs, stamps, paths)


def _start(rng: np.random.Generator, radii: Array, bodies: int) -> Started:
    for _ in range(500):
        angles = (
            rng.uniform(0.0, 2.0 * np.pi) + 2.0 * np.pi * (np.arange(bodies) + rng.uniform(-0.2, 0.2, bodies)) / bodies
        )
        resting = rng.random(bodies) < 0.25
        resting[0] = False
        away = np.where(resting, rng.uniform(0.0, 0.4, bodies), rng.uniform(0.6, 1.1, bodies))
        places = away[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        apart = np.linalg.norm(places[:, None] - places[None], axis=-1) + 10.0 * np.eye(bodies)
        if np.all(apart > 1.2 * (radii[:, None] + radii[None])):
            break
    else:
        raise UnusableCase("the discs do not fit")
    aims = rng.normal(0.0, 0.12, (bodies, 2))
    headings = aims - places
    headings /= np.linalg.norm(headings, axis=1, keepdims=True)
    speeds = np.where(resting, 0.0, rng.uniform(1.0, 3.0, bodies))
    spins = np.where(resting, 0.0, rng.uniform(-8.0, 8.0, bodies))
    return Started(places, speeds[:, None] * headings, spins)
