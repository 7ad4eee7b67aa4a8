"""Builds one case: scene, launches, hidden law, record, strength; a Plan says what a section wants."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.random import Generator

from .contaminate import contaminate
from .effects import Context, Knob, accepted, draw_effect
from .launches import Launcher, ball_launcher, ball_scene, disc_launcher, puck_scene
from .law import Law
from .observe import Noise, Track, add_noise, draw_noise, sample_times, seen
from .scene import Array, Effect, Launch, Scene
from .sphere import Path
from .strength import calibrate, residuals, rms, solve

Draw = str | Callable[[Context], Knob]


class Rejected(Exception):
    """The draw did not give a usable case; draw again."""


@dataclass
class Plan:
    """Request of a section. rig: base rig with * (orientation) and 0 (smooth) marks."""

    section: str
    style: str
    rig: str
    effects: list[Draw]
    weak: bool = False
    noise_kind: str | None = None
    levels: tuple[float, ...] = (0.001, 0.01, 0.03)
    launches: int | None = None
    bad: int = 0
    discs: int = 1
    min_rate: float = 0.0
    accepted: list[str] = field(default_factory=list)
    options: dict[str, Any] = field(default_factory=dict)


@dataclass
class Case:
    """A finished case: scene, records of the runs and of the held-out runs, truth.

    bad: contaminated runs. strength: rms per instant that the refitted base model leaves [noise], each: of every effect
    alone. accepted: by effect, other right names; or a list of all right answers.
    """

    scene: Scene
    rows: list[tuple[Track, Array, Launch]]
    held_out: list[tuple[Track, Array, Launch]]
    effects: list[str]
    noise: Noise
    level: float
    bad: list[dict[str, Any]]
    strength: float
    each: list[float]
    accepted: list[str] | dict[str, list[str]]


def _usable(path: Path, launch: Launch, shortest: float) -> bool:
    return path.why != "failed" and path.t_end - launch.t0 >= shortest and bool(path.pieces)


def _outside(law: Law, launch: Launch) -> bool:
    """Check that every body starts on the free side of the hidden walls."""
    for plane in law.planes:
        if plane.hidden:
            for s, b in zip(launch.starts, law.scene.bodies, strict=True):
                if plane.normal @ (s.x - plane.point) < b.radius + 0.01:
                    return False
    return True


def _fresh(rng: Generator, launcher: Launcher, law: Law, shortest: float, rtol: float) -> tuple[Launch, Path]:
    for _ in range(25):
        run = launcher(rng)
        if _outside(law, run):
            path = solve(law, run, rtol)
            if _usable(path, run, shortest):
                return run, path
    raise Rejected("no usable launch")


def make_scene(rng: Generator, plan: Plan) -> tuple[Scene, Launcher, float]:
    """Scene, launcher and camera rate (Hz)."""
    rig, orient, smooth = plan.rig.strip("*0"), "*" in plan.rig, "0" in plan.rig
    rates = [30, 60, 90, 120, 240] if plan.style == "a" else [40, 50, 100, 125, 200]
    rate = max(float(rng.choice(rates)), plan.min_rate)
    if orient and rate < 50:
        rate = 60.0
    clocks = str(rng.choice(["zero", "various", "late"]))
    top = min(90.0, 1.6 * rate)
    if rig in ("puck", "discs"):
        scene = puck_scene(rng, plan.style, plan.discs, orient)
        return scene, disc_launcher(rng, scene, top, clocks), rate
    planar = plan.style == "b" and bool(rng.random() < 0.3) and plan.options.get("planar", True)
    slick = rig == "bounce" and not orient and bool(rng.random() < 0.25) and "friction_error" not in plan.effects
    scene = ball_scene(rng, plan.style, rig, orient, planar, smooth or slick)
    return scene, ball_launcher(rng, scene, top, clocks), rate


def spread(tracks: list[Track], axes: list[int]) -> float:
    """Path scale: rms over runs, bodies and recorded coordinates of the standard deviation within a run (m)."""
    return float(np.sqrt(np.mean([np.mean(t.x[:, :, axes].var(axis=1).max(axis=0)) for t in tracks])))


def target_fraction(rng: Generator, weak: bool) -> float:
    """rms left by the refitted base model as a fraction of the path scale: 2..10%, weak 0.2..1.5%, log-uniform."""
    low, high = (0.002, 0.015) if weak else (0.02, 0.10)
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def build(plan: Plan, rng: Generator) -> Case:
    """Draw one case of a plan (raises Rejected where the draw fails)."""
    scene, launcher, rate = make_scene(rng, plan)
    base, shortest = Law(scene, []), max(0.45, 14 / rate)
    count = plan.launches or int(rng.choice([8, 8, 8, 8, *range(4, 13)]) if plan.style == "a" else rng.integers(4, 11))
    pairs = [_fresh(rng, launcher, base, shortest, 1e-7) for _ in range(count)]
    times = [np.linspace(0, p.t_end - r.t0 - 1e-9, 60) for r, p in pairs]
    launches = [r for r, _ in pairs]
    shapes = [p.sample(t + r.t0)[0] for (r, p), t in zip(pairs, times, strict=True)]
    context = Context(rng, scene, launches, times, shapes, rate, {**plan.options, "weak": plan.weak})
    blind = {1} if scene.planar else set()
    axes = [a for a in range(3) if a not in (blind | ({2} if scene.rig in ("puck", "discs", "roll") else set()))]
    rough = spread([Track(t, t, x, x) for t, x in zip(times, shapes, strict=True)], axes)
    effects: list[Effect] = []
    for want in plan.effects:
        try:
            knob = draw_effect(want, context) if isinstance(want, str) else want(context)
        except ValueError as why:
            raise Rejected(str(why)) from why
        effect, miss = calibrate(scene, launches, knob, rough, target_fraction(rng, plan.weak))
        if miss > 0.8:
            raise Rejected(f"{effect.name} cannot be made as strong as wanted here")
        effects.append(effect)
    law = Law(scene, effects)
    solved = _solve_all(rng, plan, law, launcher, launches, shortest)
    held = [_fresh(rng, launcher, law, shortest, 1e-10) for _ in range(2)]
    habit = "even" if plan.style == "a" else str(rng.choice(["even", "jittered", "bursts", "late"]))
    tracks = []
    for i, (run, path) in enumerate(zip(launches, solved, strict=True)):
        ts = sample_times(rng, run, path.t_end, rate, habit)
        tracks.append(seen(law, ts, *path.sample(ts), i))
    scale = spread(tracks, axes)
    level = float(rng.choice(plan.levels)) if plan.style == "a" or plan.options.get("relative") else None
    noise = draw_noise(rng, level, scale, plan.style, plan.noise_kind)
    bad: list[dict[str, Any]] = []
    if plan.bad:
        tracks, bad = contaminate(rng, law, launcher, launches, solved, tracks, noise.sigma, plan.bad)
    rows = [(*add_noise(rng, t, noise), run) for t, run in zip(tracks, launches, strict=True)]
    held_clean = [
        seen(law, (ts := sample_times(rng, run, path.t_end, rate, habit)), *path.sample(ts), None) for run, path in held
    ]
    held_rows = [(*add_noise(rng, t, noise), run) for t, (run, _) in zip(held_clean, held, strict=True)]
    parts = residuals(law, launches, list(range(len(launches))), 1e-9, 60) if law.effects else []
    unit = np.sqrt(parts[0].shape[-1] if parts else 3) / noise.sigma
    few = list(range(len(launches)))[:5]
    alone = [rms(residuals(Law(scene, [e]), launches, few, 1e-7, 40)) for e in effects] if len(effects) > 1 else []
    names = [e.name for e in effects]
    right = plan.accepted or {n: accepted(n, scene, law.p[n]) for n in names}
    strength, each = rms(parts) * unit, [a * unit for a in alone]
    return Case(scene, rows, held_rows, names, noise, noise.sigma / scale, bad, strength, each, right)


def _solve_all(
    rng: Generator, plan: Plan, law: Law, launcher: Launcher, launches: list[Launch], shortest: float
) -> list[Path]:
    """True paths of all runs; a launch that the hidden law makes unusable is drawn again in place."""
    solved = []
    drop = law.p.get("dropped_frames")
    for i, run in enumerate(launches):
        path = solve(law, run) if _outside(law, run) else Path(run.t0)
        if not _usable(path, run, shortest):
            launches[i], path = _fresh(rng, launcher, law, shortest, 1e-10)
        if drop is not None and drop["run"] == i:
            run = launches[i]
            drop["onset"] = run.t0 + float(rng.uniform(0.25, 0.75)) * (path.t_end - run.t0)
        solved.append(path)
    if "hidden_wall" in law.p and not any(k[1] == "hidden_wall" for p in solved for k in p.impacts):
        raise Rejected("the wall is never met")
    met = [sum(k[1] == "hidden_wall" for k in p.impacts) for p in solved]
    if law.p.get("hidden_wall", {}).get("variant") == "second" and max(met) < 2:
        raise Rejected("the wall is met once only")
    return solved
