"""Errors that no fit can avoid: initial states fitted with the true simulator and law.

    python -m tests.benchmarks.fresh_scenes.floor [--constants] [--families ...] [--seeds 0-4] [--noise 5mm]

prints the table of `score`. Constants are known, or (--constants) fitted with the states, with the mean and deviation
of the distribution that `draw` takes them from as priors; which laws act and how surfaces combine stays known. States
start at the truth, so that no search fails; a body on a surface stays on it. The median is that of rollouts of the
Gaussian posterior.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from .draw import FAMILIES, Scene, scenes
from .engines import ENGINES, Array, Body, World
from .score import AFTER, summary
from .write import write

STEPS = np.repeat([1e-3, 1e-2, 1e-2, 1e-1], 3)  # place [m], velocity [m/s], turn [rad], spin [rad/s]
ITERATIONS, DRAWS, HUBER = 8, 24, 4.0
SURFACE, FLOOR = ((0.15, 0.6), (0.4, 0.95)), ((0.3, 0.9), (0.6, 0.95))  # friction and restitution, as `draw` has them
LAWS = {"linear": (5.0, 40.0), "medium": (1.2, 8.0), "rolling": (5e-4, 4e-3)}


def freedoms(body: Body) -> Array:
    """Return directions (n, 12) of place, velocity, turn and spin in which a body may begin."""
    every = np.eye(3)
    along, about = every, every
    if body.support.any():
        along = np.linalg.svd(body.support[None])[2][1:]
        about = every if body.kind == "sphere" else body.support[None]
    blocks = [along, along, about, about]
    found = np.zeros((sum(map(len, blocks)), 12))
    row = 0
    for k, block in enumerate(blocks):
        found[row : row + len(block), 3 * k : 3 * k + 3] = block
        row += len(block)
    return found


def ranges(world: World) -> Array:
    """Return the ends (k, 2) between which `draw` takes the constants of a world: of surfaces, then of its laws."""
    found = [pair for name in world.surfaces for pair in (FLOOR if name == "floor" else SURFACE)]
    return np.array(found + [LAWS[name] for name in LAWS if getattr(world, name)])


def with_constants(world: World, values: Array) -> World:
    """Return the world with such constants (k,), within their ranges."""
    low, high = ranges(world).T
    own = iter(np.clip(values, low, high).tolist())
    surfaces = {name: (next(own), next(own)) for name in world.surfaces}
    return replace(world, surfaces=surfaces, **{name: next(own) for name in LAWS if getattr(world, name)})


def started(world: World, bases: list[Array], values: Array) -> World:
    """Return the world whose bodies begin as values (N,) of their freedoms say; constants (k,) may follow."""
    bodies, at = [], 0
    count = sum(map(len, bases))
    if len(values) > count:
        low, high = ranges(world).T
        world = with_constants(world, 0.5 * (low + high) + values[count:] * (high - low) / math.sqrt(12))
    for body, basis in zip(world.bodies, bases, strict=True):
        place, speed, turn, spin = (values[at : at + len(basis)] @ (basis * STEPS)).reshape(4, 3)
        at += len(basis)
        turned = Rotation.from_rotvec(turn) * Rotation.from_quat(body.orientation, scalar_first=True)
        bodies.append(
            replace(body, position=body.position + place, velocity=body.velocity + speed, spin=body.spin + spin,
                    orientation=turned.as_quat(scalar_first=True))
        )  # fmt: skip
    return replace(world, bodies=tuple(bodies))


def apart(poses: Array, seen: Array, half: Array) -> Array:
    """Return how far poses (T, n, 7) are from those measured [m], turns by what they move a surface."""
    turn = Rotation.from_quat(seen[..., 3:].reshape(-1, 4), scalar_first=True)
    turn = turn * Rotation.from_quat(poses[..., 3:].reshape(-1, 4), scalar_first=True).inv()
    turned = turn.as_rotvec().reshape(*seen.shape[:2], 3) * half[:, None]
    found: Array = np.concatenate([seen[..., :3] - poses[..., :3], turned], axis=2).ravel()
    return found


def fitted(
    roll: Callable[[Array, int], Array], compare: Callable[[Array], Array], states: int, count: int, frames: int
) -> tuple[Array, Array]:
    """Return the values (N,) of least robust squares and their covariance, by Gauss-Newton from zero.

    What follows the states has a standard normal prior.
    """

    def cost(residual: Array, at: Array) -> float:
        size = np.abs(residual)
        robust = np.where(size <= HUBER, size**2, 2 * HUBER * size - HUBER**2).sum()
        return float(robust + at[states:] @ at[states:])

    at, prior = np.zeros(count), np.where(np.arange(count) < states, 1e-6, 1.0)
    residual = compare(roll(at, frames))
    for _ in range(ITERATIONS):
        slopes = np.stack([(compare(roll(at + step, frames)) - residual) for step in 0.5 * np.eye(count)], axis=1) / 0.5
        weight = np.minimum(1.0, HUBER / np.maximum(np.abs(residual), 1e-12))
        normal = (slopes * weight[:, None]).T @ slopes + np.diag(prior)
        step, size, before = (
            -np.linalg.solve(normal, slopes.T @ (weight * residual) + prior * at),
            1.0,
            cost(residual, at),
        )
        while size > 0.05 and cost(tried := compare(roll(at + size * step, frames)), at + size * step) > before:
            size *= 0.5
        if size <= 0.05:
            break
        gain = before - cost(tried, at + size * step)
        at, residual = at + size * step, tried
        if gain < 0.2:
            break
    return at, np.linalg.inv(normal)


def rows_of(scene: Scene, folder: Path, noise: str, constants: bool) -> list[dict[str, Any]]:
    """Return the rows that `score` has, of the floor."""
    key = json.loads((folder / "key.json").read_text())
    table = list(csv.DictReader((folder / f"tracks_{noise}.csv").read_text().splitlines()))
    columns = ("x", "y", "z", "qw", "qx", "qy", "qz", "sigma")
    seen = np.array([[float(r[c]) for c in columns] for r in table])
    sigma, world, engine = seen[0, 7], scene.world, ENGINES[scene.family.split("_")[1]]
    seen = seen[:, :7].reshape(scene.frames, len(world.bodies), 7)
    bases = [freedoms(b) for b in world.bodies]
    half = np.array([b.size[0] for b in world.bodies])

    def roll(values: Array, frames: int) -> Array:
        poses: Array = engine(started(world, bases, values), scene.rate, frames)[0]
        return poses

    def compare(poses: Array) -> Array:
        found: Array = apart(poses, seen, half) / sigma
        return found

    states = sum(map(len, bases))
    best, spread = fitted(roll, compare, states, states + constants * len(ranges(world)), scene.frames)
    rng = np.random.default_rng([scene.seed, 0xF1])
    draws = [best, *rng.multivariate_normal(best, spread, DRAWS)]
    ends = np.array([roll(d, scene.frames + 2 * scene.rate)[..., :3] for d in draws])
    last, axes, found = scene.frames - 1, slice(0, 2 if scene.family == "floor_planar" else 3), []
    for i, body in enumerate(world.bodies):
        for h in AFTER:
            at = last + round(h * scene.rate)
            truth, places = scene.poses[at, i, :3], ends[:, at, i]
            errors = [np.median(places, axis=0) - truth, places[0] - truth, scene.poses[last, i, :3] - truth]
            error, first, stays = (float(np.linalg.norm(e[axes])) for e in errors)
            low, high = np.quantile(places, (0.1, 0.9), axis=0)
            held = [bool(low[c] <= truth[c] <= high[c]) for c in range(2)]
            sensitive = key["bodies"][body.name]["sensitive"]
            found.append(dict(body=body.name, after=h, error=error, first=first, stays=stays, held=held,
                              sensitive=sensitive))  # fmt: skip
    return found


def main() -> None:
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--families", nargs="*", default=FAMILIES, choices=FAMILIES)
    parser.add_argument("--seeds", default="0-4", help="first-last")
    parser.add_argument("--noise", default="5mm", choices=("5mm", "20mm"))
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "fresh")
    parser.add_argument("--constants", action="store_true", help="constants unknown too")
    parser.add_argument("--json", action="store_true", help="a line for every clip, with its rows")
    given = parser.parse_args()
    first, last = map(int, given.seeds.split("-"))
    every: list[dict[str, Any]] = []
    print("family: at 0.5, 1, 2 s median error, over stays, of means, of the best states, inside 80%")
    for family in given.families:
        own = every[:0]
        for seed in range(first, last + 1):
            scene, folder = scenes(family, seed), given.folder / f"{family}_{seed:03d}"
            if not (folder / "key.json").exists():
                write(scene, folder)
            rows = rows_of(scene, folder, given.noise, given.constants)
            own += rows
            if given.json:
                print(json.dumps({"family": family, "seed": seed, "rows": rows}), flush=True)
        every += own
        print(f"{family:14s} {summary(own)}", flush=True)
    print(f"{'all':14s} {summary(every)}")


if __name__ == "__main__":
    main()
