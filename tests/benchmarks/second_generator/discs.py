"""Event-driven integration of discs that slide and collide on a horizontal table.

Table friction: F = -mu N v/|v| at the centre; torque about the vertical -(2/3) mu N R sign(w) (uncoupled from F).
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from .base import WALL, Disc, disc_hit
from .law import Law
from .scene import Array, Launch
from .sphere import Path, inside

HALT = 1e-3  # m/s, and rad/s times radius: below it a sliding disc is at rest


def _rhs(law: Law, moving: list[bool], turning: list[bool]) -> Callable[[float, Array], Array]:
    bodies, masses = law.scene.bodies, law.masses
    zero = np.zeros(3)

    def rhs(t: float, y: Array) -> Array:
        out = np.zeros_like(y)
        for i, body in enumerate(bodies):
            s = y[6 * i : 6 * i + 6]
            m = masses[i]
            x, v = np.array([s[0], s[1], body.height / 2]), np.array([s[2], s[3], 0.0])
            f = law.force(t, x, v, zero, m) - law.viscous * v
            normal = max(m * law.weight - f[2], 0.0)
            mu = law.friction(body.friction, x)
            if moving[i]:
                speed = max(float(np.hypot(s[2], s[3])), 1e-9)
                acc = (f[:2] - mu * normal * s[2:4] / speed) / m
                out[6 * i : 6 * i + 2], out[6 * i + 2 : 6 * i + 4] = s[2:4], acc
            if turning[i]:
                out[6 * i + 4] = s[5]
                out[6 * i + 5] = -(4.0 / 3.0) * mu * normal / (m * body.radius) * np.sign(s[5])
        return out

    return rhs


def _events(law: Law, moving: list[bool], turning: list[bool], y0: Array) -> list[tuple[tuple[str, int, int], Any]]:
    """Terminal events (kind, disc, other disc or plane) with their functions."""
    bodies, patch = law.scene.bodies, law.p.get("friction_patch")
    out: list[tuple[tuple[str, int, int], Any]] = []

    def gap(k: int, h: int, reach: float) -> Any:
        return lambda t, y: np.hypot(y[k] - y[h], y[k + 1] - y[h + 1]) - reach

    def face(k: int, n: Array, c: Array, r: float) -> Any:
        return lambda t, y: n[0] * (y[k] - c[0]) + n[1] * (y[k + 1] - c[1]) - r

    def edge(k: int, c: Array, r: float) -> Any:
        return lambda t, y: np.hypot(y[k] - c[0], y[k + 1] - c[1]) - r

    for i, body in enumerate(bodies):
        k = 6 * i
        mates = [j for j in range(i) if moving[i] or moving[j]]
        out += [(("pair", i, j), gap(k, 6 * j, body.radius + bodies[j].radius)) for j in mates]
        if turning[i]:
            out.append((("unspun", i, 0), lambda t, y, k=k, r=body.radius: abs(y[k + 5]) * r - HALT))
        if not moving[i]:
            continue
        out.append((("halt", i, 0), lambda t, y, k=k: np.hypot(y[k + 2], y[k + 3]) - HALT))
        for p, plane in enumerate(law.planes):
            if plane.normal[2] < 0.5:
                out.append((("wall", i, p), face(k, plane.normal, plane.point, body.radius)))
        if patch is not None:
            out.append((("patch", i, 0), edge(k, patch["center"], patch["radius"])))
    for label, fn in out:
        fn.terminal = True
        at = y0[6 * label[1] : 6 * label[1] + 4]
        fn.direction = 1.0 if label[0] == "patch" and inside(law, at, at[2:]) else -1.0
    return out


def _piece(sol: Any, bodies: list[Any]) -> Callable[[Array], tuple[Array, Array]]:
    def fn(ts: Array) -> tuple[Array, Array]:
        y = sol(ts)
        xs, qs = np.zeros((len(bodies), len(ts), 3)), np.zeros((len(bodies), len(ts), 4))
        for i, body in enumerate(bodies):
            xs[i, :, 0], xs[i, :, 1], xs[i, :, 2] = y[6 * i], y[6 * i + 1], body.height / 2
            qs[i, :, 0], qs[i, :, 3] = np.cos(y[6 * i + 4] / 2), np.sin(y[6 * i + 4] / 2)
        return xs, qs

    return fn


def _stays(law: Law, t: float, y: Array, i: int) -> bool:
    """Return whether a halted disc is held by Coulomb friction against the hidden force there."""
    body, m = law.scene.bodies[i], law.masses[i]
    x = np.array([y[6 * i], y[6 * i + 1], body.height / 2])
    f = law.force(t, x, np.zeros(3), np.zeros(3), m)
    return float(np.hypot(f[0], f[1])) <= law.friction(body.friction, x) * max(m * law.weight - f[2], 0.0)


def simulate_discs(law: Law, launch: Launch, rtol: float = 1e-10) -> Path:
    """Integrate one run; ends at its time, or when all discs are at rest."""
    bodies, masses = law.scene.bodies, law.masses
    n = len(bodies)
    y = np.concatenate([[s.x[0], s.x[1], s.v[0], s.v[1], 0.0, s.w[2]] for s in launch.starts])
    t, t_end = launch.t0, launch.t0 + launch.duration
    path = Path(launch.t0, bodies=n)
    for _ in range(400):
        moving = [bool(np.hypot(y[6 * i + 2], y[6 * i + 3]) > HALT or not _stays(law, t, y, i)) for i in range(n)]
        turning = [bool(abs(y[6 * i + 5]) * bodies[i].radius > HALT) for i in range(n)]
        for i in range(n):
            if not moving[i]:
                y[6 * i + 2 : 6 * i + 4] = 0.0
            if not turning[i]:
                y[6 * i + 5] = 0.0
        if not any(moving) and not any(turning):
            path.why = "stopped"
            break
        labelled = _events(law, moving, turning, y)
        sol = solve_ivp(
            _rhs(law, moving, turning),
            (t, t_end),
            y,
            method="DOP853",
            rtol=rtol,
            atol=rtol * 1e-2,
            dense_output=True,
            events=[fn for _, fn in labelled],
            max_step=0.02,
        )
        if not sol.success and sol.status != 1:
            path.why = "failed"
            break
        path.pieces.append((t, float(sol.t[-1]), _piece(sol.sol, bodies)))
        t, y = float(sol.t[-1]), sol.y[:, -1].copy()
        path.t_end = t
        if sol.status == 0 or np.abs(y).max() > 500:
            break
        for (kind, i, j), te in zip((lab for lab, _ in labelled), sol.t_events, strict=True):
            if not len(te):
                continue
            a, b = 6 * i, 6 * j
            if kind == "halt":
                y[a + 2 : a + 4] *= 0.99 if not _stays(law, t, y, i) else 0.0
            elif kind == "unspun":
                y[a + 5] = 0.0
            elif kind in ("pair", "wall"):
                body, plane = bodies[i], law.planes[j] if kind == "wall" else None
                one: Disc = (y[a + 2 : a + 4].copy(), float(y[a + 5]), masses[i], body.radius)
                if plane is not None:
                    other, way, mu, who = WALL, plane.normal[:2], plane.friction, plane.name
                else:
                    other = (y[b + 2 : b + 4].copy(), float(y[b + 5]), masses[j], bodies[j].radius)
                    way, mu, who = y[a : a + 2] - y[b : b + 2], body.rim_friction, f"{body.name}|{bodies[j].name}"
                way = way / np.hypot(way[0], way[1])
                speed = float((other[0] - one[0]) @ way)
                path.impacts.append((t, who, speed))
                e = law.restitution(plane, body.restitution, speed)
                y[a + 2 : a + 4], v2, y[a + 5], w2 = disc_hit(way, one, other, e, mu)
                if plane is None:
                    y[b + 2 : b + 4], y[b + 5] = v2, w2
    else:
        path.why = "failed"
    return path
