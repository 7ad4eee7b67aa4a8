"""Event-driven integration of one ball: flight with exact impacts, sliding and rolling on a floor at z = 0."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from .law import Law, bounce
from .scene import UP, Array, Launch, cross

SLIP_END = 1e-3  # m/s: below it sliding snaps to rolling (error of second order)
SETTLED = 0.12  # m/s: a rebound from the floor slower than this ends the run


@dataclass
class Path:
    """A solved run: dense pieces, its end, and the impacts (time s, who, approach speed m/s)."""

    t0: float
    t_end: float = 0.0
    pieces: list[tuple[float, float, Callable[[Array], tuple[Array, Array]]]] = field(default_factory=list)
    impacts: list[tuple[float, str, float]] = field(default_factory=list)
    bodies: int = 1
    why: str = "time"

    def sample(self, ts: Array) -> tuple[Array, Array]:
        """Positions (body, time, 3) and quaternions (body, time, 4) at clock times ts."""
        xs, qs = np.full((self.bodies, len(ts), 3), np.nan), np.full((self.bodies, len(ts), 4), np.nan)
        for ta, tb, fn in self.pieces:
            pick = (ts >= ta - 1e-12) & (ts <= tb + 1e-12)
            if pick.any():
                xs[:, pick], qs[:, pick] = fn(ts[pick])
        return xs, qs


def spin_rate(q: Array, w: Array) -> Array:
    """dq/dt = 1/2 (0, w) q with w in the laboratory frame."""
    return 0.5 * np.array(
        [
            -w[0] * q[1] - w[1] * q[2] - w[2] * q[3],
            w[0] * q[0] + w[1] * q[3] - w[2] * q[2],
            w[1] * q[0] + w[2] * q[1] - w[0] * q[3],
            w[2] * q[0] + w[0] * q[2] - w[1] * q[1],
        ]
    )


def _slip(y: Array, r: float) -> Array:
    """Horizontal velocity of the contact point, v + w x (-r z), m/s."""
    return np.array([y[3] - r * y[7], y[4] + r * y[6], 0.0])


def _rhs(law: Law, mode: str, orient: bool) -> Callable[[float, Array], Array]:
    body = law.scene.bodies[0]
    m, r, inertia = body.mass, body.radius, body.inertia
    down = np.array([0.0, 0.0, -law.weight * m])
    mass = m * law.added

    def rhs(t: float, y: Array) -> Array:
        x, v, w = y[:3], y[3:6], y[6:9]
        f = law.force(t, x, v, w, m)
        torque = -law.spin_c * w
        if mode == "flight":
            acc, dw = (f + down) / mass, torque / inertia
        else:
            normal = max(law.weight * m - f[2], 0.0)
            f = f - law.viscous * v
            f[2] = 0.0
            if law.rolling:
                wh = np.array([w[0], w[1], 0.0])
                torque = torque - law.rolling * normal * wh / max(float(np.sqrt(wh @ wh)), 1e-9)
            if mode == "slide":
                u = _slip(y, r)
                grip = -law.friction(body.friction, x) * normal * u / max(float(np.sqrt(u @ u)), 1e-12)
            else:  # rolling: a = r (dw/dt x z)
                grip = (r * cross(torque, UP) / inertia - f / mass) / (1 / mass + r * r / inertia)
            acc = (f + grip) / mass
            dw = (torque + cross(-r * UP, grip)) / inertia
            if mode == "roll":
                dw[0], dw[1] = -acc[1] / r, acc[0] / r
        parts = [v, acc, dw]
        if orient:
            parts.append(spin_rate(y[9:13], w))
        return np.concatenate(parts)

    return rhs


def inside(law: Law, x: Array, v: Array) -> bool:
    """Return whether a sliding body is in the friction patch (on its edge: whether it moves inwards)."""
    patch = law.p.get("friction_patch")
    if patch is None:
        return False
    d = x[:2] - np.asarray(patch["center"])
    gap = float(np.hypot(d[0], d[1])) - patch["radius"]
    return gap < 0 if abs(gap) > 1e-9 else float(d @ v[:2]) < 0


def _events(law: Law, mode: str, y0: Array) -> list[tuple[str, Any]]:
    """Terminal events (label or plane, function)."""
    r = law.scene.bodies[0].radius
    out: list[tuple[str, Any]] = []
    for i, plane in enumerate(law.planes):
        if mode != "flight" and plane.normal[2] > 0.5:
            continue
        out.append((f"plane{i}", lambda t, y, n=plane.normal, p=plane.point: n @ (y[:3] - p) - r))
    if mode == "flight" and not law.scene.floor:
        out.append(("ground", lambda t, y: y[2] - r))
    if mode == "slide":
        out.append(("gripped", lambda t, y: float(np.linalg.norm(_slip(y, r))) - SLIP_END))
    if mode == "roll":
        out.append(("stopped", lambda t, y: float(np.hypot(y[3], y[4])) - 2e-3))
    patch = law.p.get("friction_patch")
    if mode == "slide" and patch is not None:
        c, rad = patch["center"], patch["radius"]
        out.append(("patch", lambda t, y: float(np.hypot(y[0] - c[0], y[1] - c[1])) - rad))
    for label, fn in out:
        fn.terminal = True
        fn.direction = 1.0 if label == "patch" and inside(law, y0, y0[3:]) else -1.0
    return out


def _piece(sol: Any, orient: bool) -> Callable[[Array], tuple[Array, Array]]:
    def fn(ts: Array) -> tuple[Array, Array]:
        y = sol(ts)
        if not orient:
            return y[None, :3].transpose(0, 2, 1), np.full((1, len(ts), 4), np.nan)
        q = y[9:13] / np.linalg.norm(y[9:13], axis=0)
        return y[None, :3].transpose(0, 2, 1), q[None].transpose(0, 2, 1)

    return fn


def simulate(
    law: Law, launch: Launch, kicks: list[tuple[float, Array, float]] | None = None, rtol: float = 1e-10
) -> Path:
    """Integrate one run. kicks: (clock s, unit normal, e), an unmentioned obstacle met at that instant."""
    scene, body, s = law.scene, law.scene.bodies[0], launch.starts[0]
    r, orient = body.radius, scene.orient
    y = np.concatenate([s.x, s.v, s.w] + ([s.q] if orient else []))
    mode = "flight"
    if scene.rig == "roll":
        mode = "slide" if float(np.linalg.norm(_slip(y, r))) > SLIP_END else "roll"
    t, t_end = launch.t0, launch.t0 + launch.duration
    path = Path(launch.t0)
    knocks = sorted(kicks or [], key=lambda k: k[0])
    stops = sorted({*(b for b in law.breaks if t < b < t_end), *(k[0] for k in knocks if t < k[0] < t_end), t_end})
    for _ in range(400):
        stop = next(b for b in stops if b > t)
        labelled = _events(law, mode, y)
        sol = solve_ivp(
            _rhs(law, mode, orient),
            (t, stop),
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
        path.pieces.append((t, sol.t[-1], _piece(sol.sol, orient)))
        t, y = float(sol.t[-1]), sol.y[:, -1].copy()
        path.t_end = t
        if sol.status == 0:
            for when, n, e in knocks:
                if abs(when - t) < 1e-12 and y[3:6] @ n < 0:
                    path.impacts.append((t, "obstacle", float(-y[3:6] @ n)))
                    y[3:6] -= (1 + e) * (y[3:6] @ n) * n
            if t >= t_end - 1e-12:
                break
            continue
        hit = [label for (label, _), te in zip(labelled, sol.t_events, strict=True) if len(te)]
        if "ground" in hit or "stopped" in hit:
            path.why = hit[0]
            break
        if "gripped" in hit:
            u = _slip(y, r)
            y[3:6] -= (2.0 / 7.0) * u
            y[6:9] += cross(-r * UP, -(2.0 / 7.0) * body.mass * u) / body.inertia
            mode = "roll"
        for label in hit:
            if label.startswith("plane"):
                plane = law.planes[int(label[5:])]
                path.impacts.append((t, plane.name, float(-y[3:6] @ plane.normal)))
                v, w, back = bounce(law, plane, body, y[:3], y[3:6], y[6:9])
                y[3:6], y[6:9] = v, w
                if mode != "flight":
                    y[5], mode = 0.0, "slide"
                if back < (SETTLED if plane.normal[2] > 0.3 else 0.01):
                    path.why = "settled"
        if path.why == "settled" or not np.all(np.isfinite(y)) or np.abs(y[:6]).max() > 60:
            break
    else:
        path.why = "failed"
    return path
