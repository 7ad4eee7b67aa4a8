"""Measured runs with a missing effect: simulated by solve_ivp with located events, drawn, tuned and made noisy."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

Array = npt.NDArray[np.float64]
Rng = np.random.Generator
Effects = dict[str, dict[str, Any]]  # parameters by effect; strengths are accelerations (of the angle, for a pendulum)
UP = np.array([0.0, 0.0, 1.0])
NUDGE = 1e-10  # metres past a surface or an edge after its event, so that the same event is not found again
ROLLS = 0.15  # a ball that leaves a level surface slower than this (m/s) has stopped bouncing: its record ends
TABLES = tomllib.loads(Path(__file__).with_name("tables.toml").read_text(encoding="utf-8"))
SPECS = [(group, kind, (one + " -").split()[:2]) for group, kind, row in TABLES["cases"] for one in row.split(",")]


@dataclass
class World:
    """What a user would state, and how each run starts: position, velocity, spin of a ball; x, v of the others."""

    dims: int
    stated: dict[str, Any]
    starts: list[Array]
    times: list[Array]


def value(effects: Effects, name: str, key: str = "strength") -> Any:
    return effects.get(name, {}).get(key, 0.0)


def march(rhs: Any, y: Array, times: Array, events: list[Any], on_event: Any, max_step: float) -> Array:
    """States at `times`; `on_event` gives the state after an event and whether it goes on or stays like that."""
    for event in events:
        event.terminal, event.direction = True, -1.0  # only falls through zero count
    out, t, going = np.tile(y, (len(times), 1)), 0.0, True
    while going and t < times[-1]:
        span, options = (t, times[-1]), {"rtol": 1e-10, "atol": 1e-12, "max_step": max_step, "dense_output": True}
        sol = solve_ivp(rhs, span, y, "DOP853", events=events or None, **options)
        assert sol.success, sol.message
        inside, going = (times > t) & (times <= sol.t[-1]), sol.status == 1
        out[inside], t = sol.sol(np.append(times[inside], t)).T[:-1], sol.t[-1]
        if going:
            i = next(i for i, found in enumerate(sol.t_events) if len(found))
            y, going = on_event(i, t, sol.y_events[i][-1])
            out[times > t] = y
    return out


def ball_run(stated: dict[str, Any], effects: Effects, start: Array, times: Array) -> Array:
    """Position, velocity and spin of a solid ball; the plane z = 0 is the floor if there is one."""
    of = partial(value, effects)
    radius, lean, lift, mu = stated["radius"], of("tilt"), of("magnus"), of("bounce_friction")
    b, q, c = (of(name) for name in ("linear_drag", "quadratic_drag", "cubic_drag"))
    wind, shear = (of(name) * of(name, "direction") for name in ("wind", "shear_wind"))
    gravity = np.sin(lean) * of("tilt", "direction") - np.cos(lean) * UP
    gravity = gravity * stated["gravity"] * (1 + of("gravity_error"))
    pushes: list[tuple[str, Any]] = [
        ("fan", lambda _, off, p: np.exp(-(off @ off - (off @ p["direction"]) ** 2) / (2 * p["width"] ** 2))),
        ("periodic_force", lambda t, _, p: np.sin(2 * np.pi * p["hz"] * t + p["phase"])),
        ("decaying_push", lambda t, _, p: np.exp(-t / p["seconds"])),
        ("spring", lambda _, off, __: -off),
        ("tether", lambda _, off, p: -max(np.linalg.norm(off) - p["rest_length"], 0.0) / np.linalg.norm(off) * off),
        ("attraction", lambda _, off, p: -off / (off @ off + p["softening"] ** 2) ** 1.5),
    ]
    pushes = [(name, law) for name, law in pushes if name in effects]

    def rhs(t: float, y: Array) -> Array:
        x, v, w = y[:3], y[3:6], y[6:]
        air = v - wind - shear * x[2]
        speed = np.sqrt(air @ air)
        a = gravity - (b + q * speed + c * speed**2) * air
        a = a + lift * np.cross(w, air) if lift else a
        for name, law in pushes:
            p = effects[name]
            a = a + p["strength"] * law(t, x - p.get("point", 0.0), p) * p.get("direction", 1.0)
        return np.concatenate([v, a, np.zeros(3)])

    floor = {"normal": UP, "offset": 0.0, "restitution": stated["restitution"]} if stated["floor"] else None
    surfaces = [s for s in (floor, effects.get("wall"), effects.get("table")) if s]
    events = [lambda _, y, s=s: float(s["normal"] @ y[:3]) - s["offset"] - radius for s in surfaces]

    def on_event(i: int, _: float, y: Array) -> tuple[Array, bool]:
        n, e, x, v, w = surfaces[i]["normal"], surfaces[i]["restitution"], y[:3], y[3:6], y[6:]
        hit, on_floor = -float(v @ n), surfaces[i] is floor
        if on_floor:
            e = (e + of("restitution_error")) * hit ** -of("restitution_power")
            e = float(np.clip(e - of("restitution_slope") * hit, 0.05, 0.98))
        if n[2] == 1 and e * hit < ROLLS:
            return np.full(9, np.nan), False
        slip = v + hit * n - radius * np.cross(w, n)
        v, fast = v + (1 + e) * hit * n, float(np.linalg.norm(slip))
        if mu and fast > 0 and on_floor:
            kick = -min(mu * (1 + e) * hit, 2 / 7 * fast) * slip / fast  # slides, or grips and leaves rolling
            v, w = v + kick, w - 2.5 / radius * np.cross(n, kick)
        return np.concatenate([x + NUDGE * n, v, w]), True

    return march(rhs, start, times, events, on_event, 0.1)


def line_run(stated: dict[str, Any], effects: Effects, start: Array, times: Array) -> Array:
    """x and v of a block, a cart or a pendulum (radians); dry friction holds what stops under a smaller pull."""
    of, kind = partial(value, effects), stated["kind"]
    b, q, c = (of(name) for name in ("linear_drag", "quadratic_drag", "cubic_drag"))
    lean, low, high = of("tilt"), of("patch", "start"), of("patch", "end")

    def accel(t: float, x: float, v: float) -> float:
        drag = (b + q * abs(v) + c * v * v) * v
        if kind == "block":
            return float(-stated["gravity"] * np.sin(lean) - drag)
        if kind == "cart":
            spring = stated["stiffness"] / stated["mass"] * np.exp(-of("fading_spring") * t)
            return float(-spring * x - of("stiffening_spring") * x**3 - drag)
        shake = of("shaken_pivot") * np.sin(2 * np.pi * of("shaken_pivot", "hz") * t) * np.cos(x)
        return float(-(stated["gravity"] * np.sin(x) + shake) / stated["length"] / (1 + of("wrong_length")) - drag)

    def dry(x: float) -> float:
        if kind != "block":
            return float(of("dry_friction"))
        mu = stated["friction"] * (1 + of("wrong_friction")) * (1 + (of("patch") if low < x < high else 0.0))
        return float(mu * stated["gravity"] * np.cos(lean))

    mode = [float(np.sign(start[1] or accel(0.0, start[0], 0.0))), dry(start[0])]  # the way it moves, friction there
    events: list[Any] = [lambda _, y: mode[0] * y[1]] if mode[1] else []
    events += [lambda _, y, edge=edge: mode[0] * (edge - y[0]) for edge in (low, high) if "patch" in effects]

    def on_event(i: int, t: float, y: Array) -> tuple[Array, bool]:
        if i > 0:
            mode[1] = dry(y[0] + mode[0] * NUDGE)
            return y + np.array([mode[0] * NUDGE, 0.0]), True
        pull = accel(t, y[0], 0.0)
        mode[0] = float(np.sign(pull))
        return np.array([y[0], 0.0]), abs(pull) > mode[1]

    rhs = lambda t, y: np.array([y[1], accel(t, y[0], y[1]) - mode[0] * mode[1]])  # noqa: E731
    return march(rhs, start, times, events, on_event, 0.05)


def simulate(world: World, effects: Effects, starts: list[Array] | None = None) -> list[Array]:
    """What a perfect observer records at the stated times: x, y, z and spin of a ball; x and v of the others."""
    of, runs = partial(value, effects), []
    for i, (start, t) in enumerate(zip(starts or world.starts, world.times, strict=True)):
        at = np.resize(of("dropped_frames", "at"), len(world.times))[i] * t[-1]
        tau = t * (1 + of("clock_rate")) + of("dropped_frames") / world.stated["rate_hz"] * (t > at)
        run = (ball_run if world.dims == 3 else line_run)(world.stated, effects, start, tau)
        if world.dims == 3:
            off = (run[:, :3] - of("lens", "centre")) * [1.0, 0.0, 1.0]  # the camera looks along y
            seen = run[:, :3] + of("lens") * ((off / (of("lens", "scale") or 1.0)) ** 2).sum(1, keepdims=True) * off
            run = np.hstack([seen * (1 + of("scale_error")), run[:, 6:]])
        runs.append(run)
    return runs


@dataclass
class Case:
    """Data in `columns`, what the user would state, and the key: effects, their sizes and the noise."""

    name: str
    stated: dict[str, Any]
    columns: list[str]
    data: Array
    key: dict[str, Any]


def sample(rng: Rng, table: dict[str, Any], words: dict[str, Any]) -> dict[str, Any]:
    found = {key: rng.uniform(*x) if isinstance(x, list) else x for key, x in table.items()}
    found = {key: words[x] if isinstance(x, str) else x for key, x in found.items()}
    return {key: float(f"{x:.5g}") if isinstance(x, float) else x for key, x in found.items()}


def draw_world(rng: Rng, kind: str, option: str) -> World:
    u, n, rate, starts = rng.uniform, int(rng.integers(5, 13)), float(rng.choice([50, 60, 100, 120, 240])), []
    seconds = u(0.5, 2) * (1 if kind in ("ball", "block") else 4)
    stated = {"kind": kind, "rate_hz": rate} | sample(rng, TABLES["stated"][kind], {})
    if kind != "ball":
        starts = [TABLES["starts"][kind] * np.array([u(-1, 1), u(0.25, 1) * rng.choice([-1, 1])]) for _ in range(n)]
    else:
        floor = option == "floor" or (option != "flight" and bool(rng.random() < 0.4))
        radius, mass = TABLES["balls"][rng.integers(len(TABLES["balls"]))]
        stated |= {"radius": radius, "mass": round(mass * u(0.95, 1.05), 5), "floor": floor}
        stated |= {"restitution": round(u(0.6, 0.8), 2), "bounce_friction": 0.0} if floor else {}
        stated["spin_measured"] = option == "spin" or (option != "hidden" and bool(rng.random() < 0.25))
        planar, seconds = rng.random() < 0.4, max(seconds, 0.8 * floor)
        for _ in range(n):
            speed = u(1.5, 5 if floor else 9) * (rng.random() > 0.2)  # one run in five is dropped
            rise, turn, spin = u(-0.2, 1.3), rng.choice([0, np.pi]) if planar else u(-np.pi, np.pi), rng.normal(size=3)
            way = np.array([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])
            place = np.array([u(-0.5, 0.5), u(-0.5, 0.5) * (not planar), radius + u(0.5, 2)])
            starts.append(np.concatenate([place, speed * way, spin * u(3, 45)]))
    times = [np.arange(int(max(0.5, seconds * u(0.8, 1)) * rate) + 1) / rate for _ in range(n)]
    return World(3 if kind == "ball" else 1, stated, starts, times)


def moved(world: World, more: Effects, less: Effects, shift: Array | float = 0.0) -> list[Array]:
    """How far the runs differ with more effects and with less, or with other initial states."""
    runs = zip(simulate(world, more, [s + shift for s in world.starts]), simulate(world, less), strict=True)
    return [(a - b)[:, : world.dims] for a, b in runs]


def rms(gaps: list[Array], *slopes: list[Array]) -> float:
    """Rms length of displacements; with slopes, of what is left when each run's initial state is fitted again."""
    left = []
    for gap, *columns in zip(gaps, *slopes, strict=True):
        jac = np.array([column.ravel() for column in [0 * gap, *columns]]).T
        good = np.isfinite(jac).all(axis=1)
        flat, jac = gap.ravel()[good], jac[good]
        left.append(flat - jac @ np.linalg.lstsq(jac, flat)[0])
    return float(np.sqrt(np.mean(np.concatenate(left) ** 2) * gaps[0].shape[1]))


def add_effect(rng: Rng, name: str, world: World, before: Effects, paths: list[Array], span: float) -> Effects:
    """One more effect, which by itself moves the runs by 2 to 60 % of their range (rms); none where it cannot."""
    u, radius, run = rng.uniform, world.stated.get("radius", 0.0), paths[rng.integers(len(paths))]
    at, low, angle, middle = int(len(run) * u(0.25, 0.85)), u(-0.6, 0.4), u(-np.pi, np.pi), np.vstack(paths).mean(0)
    spot, step, way, goal = run[at], np.resize(run[at] - run[at - 1], 3), rng.normal(size=3), 0.025 * 22 ** u()
    swing = np.arctan2(step[1], step[0]) + np.pi + u(-0.6, 0.6)
    level, wall = (np.array([np.cos(a), np.sin(a), 0.0]) for a in (angle, swing))
    words = {"angle": angle, "unit": way / np.linalg.norm(way), "level": level, "up": UP, "against": wall, "spot": spot}
    words |= {"touching": wall @ np.resize(spot, 3) - radius, "below": spot[-1] - radius, "span": span}
    words |= {"near": middle + 0.4 * span * rng.normal(size=world.dims), "moments": [u(0.2, 0.8) for _ in paths]}
    words |= {"middle": middle, "low": middle[0] + span * low, "high": middle[0] + span * (low + u(0.2, 0.5))}
    params = sample(rng, TABLES["effects"][name], words | {"frames": int(rng.integers(2, 3 + len(run) // 8))})
    if name in TABLES["signed"]:
        params["strength"] *= float(rng.choice([-1, 1]))
    if name in ("wall", "table") and min(s[:3] @ params["normal"] for s in world.starts) < params["offset"] + 0.12:
        return before
    for _ in range(8):
        change = max(rms(moved(world, before | {name: params}, before)) / span, 1e-9)
        if name in TABLES["fixed"] or abs(np.log(change / goal)) < 0.1:
            break
        params["strength"] *= float(np.clip(goal / change, 0.2, 5))
        if abs(params["strength"]) > TABLES["most"].get(name, np.inf):
            return before
    return before | {name: params} if 0.02 <= change <= 0.6 else before


@lru_cache(maxsize=128)
def build(seed: int, index: int) -> tuple[World, Effects, list[Array], float, dict[str, list[float]]]:
    """World, effects, what a perfect observer sees, the range of motion, and sizes: as it is, and refitted."""
    (_, kind, (names, option)), rng = SPECS[index], np.random.default_rng([seed, index])
    wanted = [] if names == "-" else names.split("+")
    seen: list[Array] = []
    while not seen or min(np.isfinite(run[:, 0]).mean() for run in seen) < 0.5:
        world, effects = draw_world(rng, kind, option), Effects()
        paths = [run[np.isfinite(run[:, 0]), : world.dims] for run in simulate(world, effects)]
        span = float(np.median([np.ptp(path, axis=0).max() for path in paths]))
        for name in wanted:
            effects = add_effect(rng, name, world, effects, paths, span)
        seen = simulate(world, effects) if len(effects) == len(wanted) else []
    shifts = 1e-6 * np.eye(2 * world.dims, len(world.starts[0]))
    slopes = [[gap / 1e-6 for gap in moved(world, {}, {}, shift)] for shift in shifts]
    gaps = {"all": moved(world, effects, {})}
    gaps |= {one: moved(world, effects, {k: p for k, p in effects.items() if k != one}) for one in effects}
    return world, effects, seen, span, {k: [rms(gap), rms(gap, *slopes)] for k, gap in gaps.items()}


def case(seed: int, index: int, noise: float = 1.0) -> Case:
    """One case with noise of so many per cent of the range of motion; the same arguments give the same numbers."""
    (group, kind, _), (world, effects, seen, span, sizes) = SPECS[index], build(seed, index)
    rng, sigma, rows = np.random.default_rng([seed, index, round(1000 * noise)]), noise / 100 * span, []
    sort = "gaussian" if (seed + index) % 5 else ("rounded", "ar1")[(seed + index) // 5 % 2]
    step, memory = (2 * sigma if sort == "rounded" else 0.0), (0.8 if sort == "ar1" else 0.0)
    for i, (run, t) in enumerate(zip(seen, world.times, strict=True)):
        error = sigma * rng.normal(size=(len(t), world.dims))
        for j in range(1, len(t) if memory else 0):
            error[j] = memory * error[j - 1] + np.sqrt(1 - memory**2) * error[j]
        place = run[:, : world.dims] + error
        place = np.round(place / step) * step if step else place
        blank = np.zeros((len(t), 2 if kind in ("block", "cart") else 0))
        spin = run[:, 3:] if world.stated.get("spin_measured") else blank[:, :0]
        rows.append(np.column_stack([np.full(len(t), i), t, place, blank, spin])[np.isfinite(run[:, 0])])
    data = np.vstack(rows)
    places = ["theta"] if kind == "pendulum" else ["x", "y", "z", "wx", "wy", "wz"][: data.shape[1] - 2]
    key = {"group": group, "kind": kind, "effects": effects, "range": span, "fraction": sizes["all"][0] / span}
    key |= {"noise": {"percent": noise, "sigma": sigma, "kind": sort, "step": step, "memory": memory}}
    key |= {"samples": len(data), "size": sizes["all"][1] / sigma, "size_before_refit": sizes["all"][0] / sigma}
    key |= {"size_of": {name: sizes[name][1] / sigma for name in effects}, "starts": world.starts}
    key["also_right"] = TABLES["same"].get("+".join(effects), [])
    key["nearest"] = [law for name in effects for law in TABLES["nearest"].get(name, [])]
    name = f"third_s{seed}_n{noise:g}_{index:02d}".replace(".", "p")
    return Case(name, world.stated, ["run", "t", *places], data, key)


def cases(seed: int, noise: float = 1.0) -> list[Case]:
    return [case(seed, index, noise) for index in range(len(SPECS))]
