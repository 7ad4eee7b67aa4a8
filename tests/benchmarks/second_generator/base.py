"""The analyst's base model in closed form (gravity, contacts, given friction), for the refits that set strength."""

import numpy as np

from .law import Law, bounce
from .scene import G_GIVEN, Array, Scene

GRAVITY = np.array([0.0, 0.0, -G_GIVEN])


def _hit_time(a: float, b: float, c: float) -> float:
    """Smallest t > 0 at which a t^2 + b t + c falls through zero (infinite if never)."""
    if abs(a) < 1e-14:
        return -c / b if b < 0 and c > 0 else np.inf
    disc = b * b - 4 * a * c
    if disc <= 0:
        return np.inf
    root = np.sqrt(disc)
    good = [t for t in ((-b - root) / (2 * a), (-b + root) / (2 * a)) if t > 1e-9 and 2 * a * t + b < 0]
    return min(good) if good else np.inf


def base_sphere(law: Law, x: Array, v: Array, w: Array, ts: Array) -> Array:
    """Positions (time, 3) of the ball in the base model, ts in s since release, ascending."""
    body = law.scene.bodies[0]
    if law.scene.rig == "roll":
        return _base_roll(law, x, v, w, ts)
    out = np.empty((len(ts), 3))
    t, r, x, v, w = 0.0, body.radius, x.copy(), v.copy(), w.copy()
    acc, last = GRAVITY, float(ts[-1])
    for _ in range(60):
        times = [
            _hit_time(0.5 * float(p.normal @ acc), float(p.normal @ v), float(p.normal @ (x - p.point)) - r)
            for p in law.planes
        ]
        step = min(times, default=np.inf)
        end = min(t + step, last + 1e-9)
        pick = (ts >= t - 1e-12) & (ts <= end)
        d = (ts[pick] - t)[:, None]
        out[pick] = x + v * d + 0.5 * acc * d * d
        if t + step > last:
            break
        x, v = x + v * step + 0.5 * acc * step**2, v + acc * step
        t += step
        plane = law.planes[int(np.argmin(times))]
        v, w, back = bounce(law, plane, body, x, v, w)
        if back < 0.04 and plane.normal[2] > 0.9:
            v[2], acc = 0.0, np.zeros(3)
    else:
        out[ts > t] = x
    return out


def _base_roll(law: Law, x: Array, v: Array, w: Array, ts: Array) -> Array:
    """Sliding (a = -mu g u/|u|, |u| falls at 7/2 mu g) and then rolling without loss."""
    body = law.scene.bodies[0]
    r = body.radius
    u = np.array([v[0] - r * w[1], v[1] + r * w[0], 0.0])
    speed, mu = float(np.linalg.norm(u)), body.friction
    t_grip = speed / (3.5 * mu * G_GIVEN) if mu > 0 else np.inf
    acc = -mu * G_GIVEN * u / speed if speed > 1e-9 else np.zeros(3)
    early = np.minimum(ts, t_grip)[:, None]
    late = np.maximum(ts - t_grip, 0.0)[:, None]
    return x + v * early + 0.5 * acc * early**2 + (v + acc * min(t_grip, 1e9)) * late


Disc = tuple[Array, float, float, float]  # velocity m/s, spin rad/s, mass kg, radius m
WALL: Disc = (np.zeros(2), 0.0, np.inf, 0.0)


def disc_hit(n: Array, a: Disc, b: Disc, e: float, mu: float) -> tuple[Array, Array, float, float]:
    """Collision of discs a and b (or WALL), n the unit normal from b to a. Returns va', vb', wa', wb'.

    Normal impulse (1+e) |v_n| / (1/ma+1/mb); rim friction: the sticking impulse |u| / (3/ma+3/mb), 3 = 1 + m r^2/I,
    limited by mu J_n.
    """
    (va, wa, ma, ra), (vb, wb, mb, rb) = a, b
    rel, tang = va - vb, np.array([-n[1], n[0]])
    if rel @ n >= 0:
        return va, vb, wa, wb
    jn = -(1 + e) * float(rel @ n) / (1 / ma + 1 / mb)
    u = float(rel @ tang) - wa * ra - wb * rb
    jt = -np.sign(u) * min(abs(u) / (3 / ma + (3 / mb if rb else 0.0)), mu * jn)
    imp = jn * n + jt * tang
    return va + imp / ma, vb - imp / mb, wa - 2 * jt / (ma * ra), wb - (2 * jt / (mb * rb) if rb else 0.0)


def base_discs(scene: Scene, xs: Array, vs: Array, ws: Array, ts: Array) -> Array:
    """Positions (disc, time, 2) of sliding discs in the base model; xs, vs (disc, 2); ws (disc,) rad/s."""
    n, bodies = len(xs), scene.bodies
    mu = bodies[0].friction
    out = np.empty((n, len(ts), 2))
    x, v, w = xs.copy(), vs.copy(), ws.copy()
    t, last = 0.0, float(ts[-1])
    for _ in range(80):
        speed = np.linalg.norm(v, axis=1)
        halt = np.array([s / (mu * G_GIVEN) if mu > 0 and s > 0 else (0.0 if s == 0 else np.inf) for s in speed])
        acc = np.array([-mu * G_GIVEN * v[i] / speed[i] if speed[i] > 0 else np.zeros(2) for i in range(n)])
        step, what = last - t + 1e-9, ("end", 0, 0)
        for i in range(n):
            if 0 < halt[i] < step:
                step, what = float(halt[i]), ("halt", i, 0)
            for k, plane in enumerate(scene.planes):
                if plane.normal[2] > 0.5:
                    continue
                nn, gap = plane.normal[:2], float(plane.normal[:2] @ (x[i] - plane.point[:2])) - bodies[i].radius
                hit = _hit_time(0.5 * float(nn @ acc[i]), float(nn @ v[i]), gap)
                if hit < step and hit <= halt[i]:
                    step, what = hit, ("wall", i, k)
            for j in range(i):
                hit = _pair_time(x[i] - x[j], v[i] - v[j], acc[i] - acc[j], bodies[i].radius + bodies[j].radius, step)
                if hit < step:
                    step, what = hit, ("pair", i, j)
        pick = (ts >= t - 1e-12) & (ts <= t + step)
        d = ts[pick] - t
        for i in range(n):
            out[i, pick] = x[i] + v[i] * d[:, None] + 0.5 * acc[i] * (d * d)[:, None]
        if what[0] == "end":
            break
        t += step
        x, v = x + v * step + 0.5 * acc * step**2, v + acc * step
        for i in range(n):
            loss = (4.0 / 3.0) * mu * G_GIVEN / bodies[i].radius * step
            w[i] = np.sign(w[i]) * max(abs(w[i]) - loss, 0.0)
        kind, i, j = what
        b, c = bodies[i], bodies[j] if kind == "pair" else bodies[i]
        one: Disc = (v[i], w[i], b.mass, b.radius)
        if kind == "halt":
            v[i] = 0.0
        elif kind == "pair":
            gap = x[i] - x[j]
            two: Disc = (v[j], w[j], c.mass, c.radius)
            v[i], v[j], w[i], w[j] = disc_hit(gap / np.linalg.norm(gap), one, two, b.restitution, b.rim_friction)
        else:
            p = scene.planes[j]
            v[i], _, w[i], _ = disc_hit(p.normal[:2], one, WALL, p.restitution, p.friction)
    else:
        out[:, ts > t] = x[:, None, :]
    return out


def _pair_time(d: Array, v: Array, a: Array, reach: float, limit: float) -> float:
    """First t in (0, limit) at which |d + v t + a t^2/2| falls through reach (roots of a quartic)."""
    far = float(np.linalg.norm(d)) - reach
    if far > float(np.linalg.norm(v)) * limit + 0.5 * float(np.linalg.norm(a)) * limit**2:
        return np.inf
    poly = np.array([0.25 * a @ a, v @ a, v @ v + d @ a, 2 * d @ v, d @ d - reach * reach])
    lead = np.flatnonzero(np.abs(poly) > 1e-13)
    roots = np.roots(poly[lead[0] :]) if len(lead) else np.array([])
    slope = np.polyder(poly)
    good = [r.real for r in roots if abs(r.imag) < 1e-7 and r.real > 1e-9 and np.polyval(slope, r.real) < 0]
    return min(good) if good else np.inf
