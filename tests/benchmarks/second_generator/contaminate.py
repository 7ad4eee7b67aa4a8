"""Faulty runs among good ones: obstacle, push, swapped track, time shift, zoom, lost-and-stuck track."""

from typing import Any

import numpy as np
from numpy.random import Generator

from .launches import Launcher
from .law import Law
from .observe import Track, seen, spoil
from .scene import Array, Effect, Launch, unit
from .sphere import Path
from .strength import solve

KINDS = ("obstacle", "push", "swapped", "time_shift", "zoom", "stuck")


def contaminate(
    rng: Generator,
    law: Law,
    launcher: Launcher,
    launches: list[Launch],
    paths: list[Path],
    tracks: list[Track],
    sigma: float,
    count: int,
) -> tuple[list[Track], list[dict[str, Any]]]:
    """Spoil `count` runs; returns the new records and the list of bad runs with kind, onset (clock s), size."""
    out, bad = list(tracks), []
    for run in sorted(rng.choice(len(tracks), size=count, replace=False).tolist()):
        for _ in range(12):
            record, track = _one(rng, law, launcher, launches[run], paths[run], tracks[run])
            record["rms_in_sigma"] = _gap(paths[run], track, record["onset"]) / sigma
            if record["rms_in_sigma"] > 4 and len(track.t) > 10:
                break
        out[run] = track
        bad.append({"run": int(run), **record})
    return out, bad


def _gap(path: Path, track: Track, onset: float) -> float:
    """RMS distance (m) between the record and the sound path at the recorded clock, from the onset on."""
    d = np.linalg.norm(path.sample(track.t)[0] - track.x, axis=-1)[:, track.real >= onset]
    d = d[np.isfinite(d)]
    return float(np.sqrt(np.mean(d * d))) if d.size else 0.0


def _one(
    rng: Generator, law: Law, launcher: Launcher, launch: Launch, path: Path, track: Track
) -> tuple[dict[str, Any], Track]:
    kind = str(rng.choice(KINDS))
    span = path.t_end - launch.t0
    onset = launch.t0 + float(rng.uniform(0.2, 0.75)) * span
    bad: dict[str, Any] = {"kind": kind, "onset": onset}
    planar = law.scene.planar
    if kind in ("obstacle", "push"):
        if kind == "obstacle":
            near = path.sample(np.array([onset - 1e-4, onset]))[0][0]
            n = unit(-unit(near[1] - near[0]) + 0.7 * rng.normal(size=3) * ([1, 0, 1] if planar else [1, 1, 1]))
            bad.update(normal=n.tolist(), restitution=float(rng.uniform(0.3, 0.9)))
            other = solve(law, launch, kicks=[(onset, n, bad["restitution"])])
        else:
            way = unit(rng.normal(size=3) * ([1, 0, 1] if planar else [1, 1, 1]))
            force = law.masses[0] * float(rng.uniform(4, 25)) * way
            bad.update(F=force.tolist(), length=float(rng.uniform(0.05, 0.15)))
            push = Effect("push", {"F": force.tolist(), "t_on": onset, "t_off": onset + bad["length"]})
            other = solve(Law(law.scene, [*law.effects, push]), launch)
        ts = track.real[track.real <= other.t_end - 1e-9]
        return bad, seen(law, ts, *other.sample(ts), None)
    mate: Track | None = None
    if kind == "swapped":
        run2 = launcher(rng)
        run2.t0 = launch.t0
        path2 = solve(law, run2)
        ts = track.real[track.real <= path2.t_end - 1e-9]
        mate = seen(law, ts, *path2.sample(ts), None)
    elif kind == "time_shift":
        step = float(np.median(np.diff(track.real)))
        bad.update(shift=float(rng.integers(2, 10)) * step, sign=str(rng.choice(["lost", "skip"])))
    elif kind == "zoom":
        bad["onset"] = launch.t0
        centre: Array = track.x[0].mean(axis=0)
        bad.update(s=float(1 + rng.choice([-1, 1]) * rng.uniform(0.05, 0.18)), c=centre.tolist())
    elif kind == "stuck":
        at = path.sample(np.array([onset]))[0][0, 0] + rng.normal(size=3) * 0.05 * ([1, 0, 1] if planar else [1, 1, 1])
        bad.update(point=at.tolist())
    return bad, spoil(track, bad, mate)
