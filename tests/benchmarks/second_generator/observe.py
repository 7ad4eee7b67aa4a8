"""From a solved run to recorded rows: sampling, observer effects, camera noise, contamination of the record."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import Generator

from .law import Law
from .scene import Array, Launch, qmul, rotvec_q

KINDS = ("white", "ar1", "pixel", "t3")


@dataclass
class Track:
    """Rows of one run: clock t, true time, positions (body, time, 3), quaternions (body, time, 4)."""

    t: Array
    real: Array
    x: Array
    q: Array


@dataclass
class Noise:
    """Camera noise: kind, sigma m, angle_sigma rad, AR(1) correlation tau (samples), fraction of missing rows."""

    kind: str
    sigma: float
    angle_sigma: float
    tau: float
    missing: float


def sample_times(rng: Generator, launch: Launch, t_end: float, rate: float, habit: str) -> Array:
    """Real sampling instants. habit: even | jittered | bursts | late (the beginning is missing)."""
    ts = launch.t0 + np.arange(int(np.floor((t_end - launch.t0) * rate + 1e-9)) + 1) / rate
    if habit == "jittered":
        ts[1:] += rng.uniform(-0.35, 0.35, len(ts) - 1) / rate
    if habit == "bursts":
        ts = ts[np.mod(np.arange(len(ts)), 7) != int(rng.integers(7))]
        ts = ts[rng.random(len(ts)) > 0.12]
    if habit == "late":
        ts = ts[int(len(ts) * rng.uniform(0.03, 0.15)) :]
    return ts[ts <= t_end - 1e-9]


def seen(law: Law, ts: Array, x: Array, q: Array, run: int | None) -> Track:
    """Apply the observer effects of the law to a noise-free record sampled at the real times ts."""
    t, x, q = ts.copy(), x.copy(), q.copy()
    p = law.p
    if "observer_distortion" in p:  # x_seen = c + (x-c)(1 + k r^2)
        d = x - np.array(p["observer_distortion"]["c"])
        x = np.array(p["observer_distortion"]["c"]) + d * (
            1 + p["observer_distortion"]["k"] * np.sum(d * d, axis=-1, keepdims=True)
        )
    if "observer_scale" in p:
        c = np.array(p["observer_scale"]["c"])
        x = c + p["observer_scale"]["s"] * (x - c)
    if "observer_tilt" in p:  # x_seen = c + R(angle axis) (x-c)
        c, rv = np.array(p["observer_tilt"]["c"]), p["observer_tilt"]["angle"] * np.array(p["observer_tilt"]["axis"])
        rq = rotvec_q(rv)
        w, u = rq[0], rq[1:]
        d = x - c
        x = c + d + 2 * w * np.cross(u, d) + 2 * np.cross(u, np.cross(u, d))
        q = qmul(rq, q)
    if "dropped_frames" in p and p["dropped_frames"]["run"] == run:
        t, x, q, ts = jump(t, x, q, ts, p["dropped_frames"])
    if "observer_clock" in p:
        t = p["observer_clock"]["c"] * t
    return Track(t, ts, x, q)


def jump(t: Array, x: Array, q: Array, ts: Array, p: dict[str, Any]) -> tuple[Array, Array, Array, Array]:
    """Clock fault from real time `onset` on. lost: frames vanish, later stamps too early; skip: stamps too late."""
    if p["sign"] == "lost":
        keep = (ts < p["onset"]) | (ts >= p["onset"] + p["shift"])
        t, x, q, ts = t[keep], x[:, keep], q[:, keep], ts[keep]
        return np.where(ts < p["onset"], t, t - p["shift"]), x, q, ts
    return np.where(ts < p["onset"], t, t + p["shift"]), x, q, ts


def spoil(track: Track, bad: dict[str, Any], other: Track | None) -> Track:
    """Faults of the record of one run: swapped, shift, zoom, stuck. Onsets are real times."""
    kind, on = bad["kind"], bad["onset"]
    x, q, t, ts = track.x.copy(), track.q.copy(), track.t.copy(), track.real
    late = ts >= on
    if kind == "swapped" and other is not None:
        n = min(len(ts), other.x.shape[1])
        late[n:] = False
        x[:, late] = other.x[:, :n][:, late[:n]]
        q[:, late] = other.q[:, :n][:, late[:n]]
        keep = np.arange(len(ts)) < n
        return Track(t[keep], ts[keep], x[:, keep], q[:, keep])
    if kind == "zoom":
        c = np.array(bad["c"])
        x = c + bad["s"] * (x - c)
    if kind == "stuck":
        x[:, late] = np.array(bad["point"])
    if kind == "time_shift":
        t, x, q, ts = jump(t, x, q, ts, bad)
    return Track(t, ts, x, q)


def add_noise(rng: Generator, track: Track, noise: Noise) -> tuple[Track, Any]:
    """Noisy record and the mask of rows (body, time) that are present."""
    x = track.x.copy()
    n, nt, _ = x.shape
    s = noise.sigma
    if noise.kind == "white":
        x += rng.normal(0, s, x.shape)
    elif noise.kind == "t3":
        x += rng.standard_t(3, x.shape) * s / np.sqrt(3)
    elif noise.kind == "pixel":
        pitch = s * np.sqrt(12) * 0.92
        x = np.round((x + rng.normal(0, 0.39 * s, x.shape)) / pitch) * pitch
    else:
        rho = np.exp(-1 / noise.tau)
        e = rng.normal(0, s, x.shape)
        for k in range(1, nt):
            e[:, k] = rho * e[:, k - 1] + np.sqrt(1 - rho * rho) * e[:, k]
        x += e
    q = qmul(rotvec_q(rng.normal(0, noise.angle_sigma, (n, nt, 3))), track.q)
    present = rng.random((n, nt)) >= noise.missing
    present[:, 0] = True
    return Track(track.t, track.real, x, q), present


def draw_noise(rng: Generator, level: float | None, scale: float, style: str, kind: str | None = None) -> Noise:
    """Noise with sigma = level*scale (style a) or an absolute camera noise of 0.4..6 mm (style b, level None)."""
    sigma = level * scale if level is not None else float(np.exp(rng.uniform(np.log(4e-4), np.log(6e-3))))
    kind = kind or str(rng.choice(KINDS))
    missing = float(rng.choice([0.0, 0.0, 0.02, 0.06])) if style == "a" else float(rng.choice([0.0, 0.03, 0.1]))
    return Noise(kind, sigma, float(np.radians(rng.uniform(0.2, 1.5))), float(rng.uniform(1, 5)), missing)
