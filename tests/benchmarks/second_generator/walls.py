"""Where a hidden wall is put: geometry variants relative to the base paths."""

import numpy as np
from numpy.random import Generator

from .launches import heading
from .scene import Array, Effect, Scene, unit

VARIANTS = ("late", "early", "some", "grazing", "slanted", "second")


def place_wall(rng: Generator, scene: Scene, paths: list[Array], variant: str | None) -> Effect:
    """Hidden plane n.(x-p) > 0 with own restitution 0.3..0.95 and friction (half the time none).

    late, early: met late or early by the mean run; some: met by a third to two thirds of the runs; grazing: nearly
    along the path of one run; slanted: a ramp under the paths; second: a ramp met at least twice in some run.
    """
    names = [v for v in VARIANTS if v not in ("slanted", "second") or scene.rig == "flight"]
    variant = variant if variant in names else str(rng.choice(names))
    radius = scene.bodies[0].radius
    best: tuple[int, Array, Array] | None = None
    for _ in range(200):
        point, normal = _propose(rng, scene, paths, variant, radius)
        gap = [(p - point) @ normal - radius for p in paths]
        if min(float(g[:, 0].min()) for g in gap) < 0.03:
            continue
        hits, most = sum(bool((g < 0).any()) for g in gap), max(1, 2 * len(paths) // 3)
        if variant == "some" and hits > most:
            hits = 0
        if best is None or hits > best[0]:
            best = (hits, point, normal)
        if hits >= max(1, len(paths) // 3):
            break
    if best is None or best[0] == 0:
        raise ValueError("no wall found")
    _, point, normal = best
    mu = 0.0 if rng.random() < 0.5 else float(rng.uniform(0.05, 0.3))
    return Effect(
        "hidden_wall",
        {
            "point": point.tolist(),
            "normal": normal.tolist(),
            "restitution": float(rng.uniform(0.3, 0.95)),
            "friction": mu,
            "variant": variant,
        },
    )


def _propose(rng: Generator, scene: Scene, paths: list[Array], variant: str, radius: float) -> tuple[Array, Array]:
    run = paths[int(rng.integers(len(paths)))]
    track = run[int(rng.integers(run.shape[0]))] if scene.flat and run.shape[0] > 1 else run[0]
    nt = len(track)
    if variant == "grazing":
        i = int(nt * rng.uniform(0.35, 0.7))
        v = track[min(i + 1, nt - 1)] - track[i - 1]
        v[2] = 0.0
        along = unit(v + 1e-9 * heading(0.3))
        side = np.array([-along[1], along[0], 0.0]) * rng.choice([-1.0, 1.0])
        tilt = np.radians(rng.uniform(6, 16))
        n = unit(np.cos(tilt) * side - np.sin(tilt) * along)
        if scene.planar:
            n = np.array([-np.sign(v[0]), 0.0, 0.0])
        return track[i] - radius * n, n
    if variant in ("slanted", "second"):
        lean = np.radians(rng.uniform(8, 35) if variant == "slanted" else rng.uniform(3, 20))
        away = heading(rng.uniform(-np.pi, np.pi)) if not scene.planar else heading(rng.choice([0.0, np.pi]))
        n = np.sin(lean) * away + np.array([0.0, 0.0, np.cos(lean)])
        return track[int(nt * rng.uniform(0.3, 0.6))] - radius * n, n
    fraction = {"late": (0.7, 0.9), "early": (0.15, 0.4), "some": (0.4, 0.8)}[variant]
    i = int(nt * rng.uniform(*fraction))
    d = track[i] - track[0]
    d[2] = 0.0
    way = unit(d + 1e-9) if scene.planar else heading(float(np.arctan2(d[1], d[0])) + rng.uniform(-0.8, 0.8))
    if scene.planar:
        way = np.array([np.sign(way[0]), 0.0, 0.0])
    n = -way
    if not scene.flat and rng.random() < 0.25:
        n = unit(n + np.array([0.0, 0.0, rng.uniform(-0.3, 0.3)]))
    return track[i] - radius * n, n
