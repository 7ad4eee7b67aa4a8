"""How much a hidden law shows: refit of each run's initial state in the base model, and calibration of a knob."""

import numpy as np
from scipy.optimize import least_squares

from .base import base_discs, base_sphere
from .discs import simulate_discs
from .effects import Knob
from .law import Law
from .observe import Track, seen
from .scene import Array, Effect, Launch, Scene
from .sphere import Path, simulate


def solve(law: Law, launch: Launch, rtol: float = 1e-10, kicks: list[tuple[float, Array, float]] | None = None) -> Path:
    """Integrate one run in the true law."""
    return simulate_discs(law, launch, rtol) if law.scene.flat else simulate(law, launch, kicks, rtol)


def base_path(scene: Scene, launch: Launch, state: Array, ts: Array) -> Array:
    """Base model positions (body, time, k) for a state vector: k = 2 on a table, rolling floor included; else 3."""
    law = Law(scene, [])
    s = launch.starts
    if scene.flat:
        n = len(s)
        z = state.reshape(n, 4)
        return base_discs(scene, z[:, :2].copy(), z[:, 2:].copy(), np.array([k.w[2] for k in s]), ts)
    if scene.rig == "roll":
        v = np.array([state[2], state[3], 0.0])
        r = scene.bodies[0].radius
        w = np.array([-v[1] / r, v[0] / r, 0.0]) if scene.released == "rolling" else s[0].w
        return base_sphere(law, np.array([state[0], state[1], r]), v, w, ts)[None, :, :2]
    return base_sphere(law, state[:3], state[3:], s[0].w, ts)[None]


def start_state(scene: Scene, launch: Launch) -> Array:
    """True initial state in the layout of base_path."""
    if scene.flat or scene.rig == "roll":
        return np.concatenate([np.r_[s.x[:2], s.v[:2]] for s in launch.starts])
    return np.r_[launch.starts[0].x, launch.starts[0].v]


def refit(scene: Scene, launch: Launch, track: Track, t_start: float, rows: int = 60) -> Array:
    """Return residuals (body, time, k) of the best base path; t_start: clock time of the release."""
    pick = np.unique(np.linspace(0, len(track.t) - 1, min(rows, len(track.t))).round().astype(int))
    ts = track.t[pick] - t_start
    k = 2 if scene.flat or scene.rig == "roll" else 3
    axes = [0, 2] if scene.planar and k == 3 else [0] if scene.planar else list(range(k))
    target = track.x[:, pick, :k]

    def cost(state: Array) -> Array:
        gap = (base_path(scene, launch, state, ts) - target)[:, :, axes]
        return np.asarray(np.nan_to_num(gap, nan=10.0).ravel())

    z0 = start_state(scene, launch)
    if scene.planar:  # y is not recorded
        keep = [0, 2, 3, 5] if k == 3 else [0, 2]
        best = least_squares(lambda z: cost(_fill(z0, keep, z)), z0[keep], method="trf", max_nfev=40)
        return cost(_fill(z0, keep, best.x)).reshape(len(target), len(pick), len(axes))
    if cost(z0).size < len(z0):
        return cost(z0).reshape(len(target), len(pick), len(axes))
    best = least_squares(cost, z0, method="lm", max_nfev=25 * (len(z0) + 1))
    return np.asarray(best.fun).reshape(len(target), len(pick), len(axes))


def _fill(z0: Array, keep: list[int], z: Array) -> Array:
    out = z0.copy()
    out[keep] = z
    return out


def residuals(law: Law, launches: list[Launch], runs: list[int], rtol: float, rows: int) -> list[Array]:
    """Noise-free refit residuals of some runs in the base model."""
    out = []
    for i in runs:
        run = launches[i]
        path = solve(law, run, rtol)
        ts = np.linspace(run.t0, path.t_end - 1e-9, rows)
        track = seen(law, ts, *path.sample(ts), i)
        stretch = law.p.get("observer_clock", {}).get("c", 1.0)
        out.append(refit(law.scene, run, track, run.t0 * stretch, rows))
    return out


def rms(parts: list[Array]) -> float:
    """RMS per coordinate over all rows (m)."""
    return float(np.sqrt(sum(float(np.sum(p * p)) for p in parts) / max(sum(p.size for p in parts), 1)))


def calibrate(scene: Scene, launches: list[Launch], knob: Knob, scale: float, target: float) -> tuple[Effect, float]:
    """Turn the knob until the refitted base model leaves target*scale (rms per coordinate).

    Local effects are judged on all runs, others on the first four. Returns the effect and |log(reached/target)|.
    """
    if knob.lo == knob.hi:
        return knob.make(knob.d0), 0.0
    d, count = float(np.clip(knob.d0, knob.lo, knob.hi)), len(launches)
    runs = list(range(count if knob.make(d).name in ("friction_patch", "fan", "tether") else min(count, 4)))
    best, miss = d, np.inf
    for _ in range(7):
        got = rms(residuals(Law(scene, [knob.make(d)]), launches, runs, 1e-7, 36)) / scale
        if abs(np.log(max(got, 1e-9) / target)) < miss:
            best, miss = d, abs(np.log(max(got, 1e-9) / target))
        if miss < 0.2:
            break
        new = float(np.clip(d * np.clip((target / max(got, 1e-6)) ** 0.9, 0.1, 6.0), knob.lo, knob.hi))
        if new == d:
            break
        d = new
    return knob.make(best), miss
