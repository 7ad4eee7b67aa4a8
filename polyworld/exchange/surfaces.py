"""Friction and rebound of surfaces, as MuJoCo's contact parameters say them and as this engine does.

MuJoCo's contacts are springs and dampers that only push, so that bodies part where the force vanishes (Schwager &
Poeschel 2007, Granular Matter 9, 465: a damping ratio of 1 still rebounds with e^-2 of the speed), taken in steps that
a stiff contact does not resolve. The coefficient of restitution is therefore found by taking those steps. MuJoCo's
friction is the greater of two bodies', or that of the geom of higher priority; this engine takes the geometric mean, a
static's own, or the object's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

FINEST = 0.01  # radians of a contact's swing in a step, below which finer steps change nothing
PHASES = 8  # places within a step at which the surfaces meet
LONGEST = 20_000  # steps of a contact that is followed


@dataclass(frozen=True)
class Surface:
    """Contact parameters of a geom: friction [1], solref, greatest impedance [1], and the model's timestep [s].

    torsional_radius, rolling_resistance [m]; of two geoms, that of the higher priority decides.
    """

    friction: float
    solref: tuple[float, float] = (0.02, 1.0)
    impedance: float = 0.95
    timestep: float = 0.002
    torsional_radius: float = 0.0
    rolling_resistance: float = 0.0
    priority: int = 0

    @property
    def restitution(self) -> float:
        """Coefficient of restitution [1] of a contact of two such surfaces."""
        return restitution_of(self.solref, self.impedance, self.timestep)


def surface_of(model: Any, geom: int) -> Surface:
    """Read the surface of a geom of a compiled MuJoCo model."""
    slide, twist, roll = (float(v) for v in model.geom_friction[geom])
    dimensions = int(model.geom_condim[geom])
    friction = slide if dimensions >= 3 else 0.0
    first, second = (float(v) for v in model.geom_solref[geom])
    return Surface(
        friction=friction,
        solref=(first, second),
        impedance=float(model.geom_solimp[geom][1]),
        timestep=float(model.opt.timestep),
        torsional_radius=twist / friction if dimensions >= 4 and friction > 0.0 else 0.0,
        rolling_resistance=roll if dimensions >= 6 else 0.0,
        priority=int(model.geom_priority[geom]),
    )


@lru_cache(maxsize=256)
def restitution_of(solref: tuple[float, float], impedance: float, timestep: float) -> float:
    """Coefficient of restitution of a contact with MuJoCo's `solref`, in steps of `timestep` [s]."""
    first, second = solref
    if first > 0.0:
        constant = max(first, 2.0 * timestep)  # as MuJoCo's own safeguard has it
        damping, stiffness = 2.0 / constant, 1.0 / max(constant * second, 1e-9) ** 2
    else:
        damping, stiffness = -second, -first / impedance
    frequency = stiffness**0.5
    step = max(timestep, FINEST / max(frequency, damping, 1e-9))
    total = 0.0
    for phase in range(PHASES):
        depth, speed = -step * (phase + 0.5) / PHASES, 1.0
        for _ in range(LONGEST):
            if depth > 0.0:
                push = damping * speed + stiffness * depth
                if push <= 0.0 and speed < 0.0:
                    break
                speed -= step * max(push, 0.0)
            elif speed <= 0.0:
                break
            depth += step * speed
        total += max(-speed, 0.0)
    return round(min(total / PHASES, 1.0), 6)


def damping_ratio(restitution: float, impedance: float, frequency: float) -> float:
    """Damping ratio with which a contact of so many radians a step rebounds with a coefficient of restitution."""
    low, high = 1e-6, 0.5 / frequency  # beyond, it ends in one step
    for _ in range(40):
        middle = 0.5 * (low + high)
        rebound = restitution_of((1.0 / (frequency * middle), middle), impedance, 1.0)
        low, high = (middle, high) if rebound > restitution else (low, middle)
    return 0.5 * (low + high)


def of_pair(a: Surface, b: Surface) -> tuple[float, float]:
    """Friction and restitution of a contact of two geoms in MuJoCo."""
    if a.priority != b.priority:
        upper = a if a.priority > b.priority else b
        return upper.friction, upper.restitution
    standard = min(a.solref[0], b.solref[0]) > 0.0
    p, q = zip(a.solref, b.solref, strict=True)
    first, second = (0.5 * (p[0] + p[1]), 0.5 * (q[0] + q[1])) if standard else (min(p), min(q))
    impedance = 0.5 * (a.impedance + b.impedance)
    return max(a.friction, b.friction), restitution_of((first, second), impedance, a.timestep)


def as_static(own: Surface, others: list[Surface]) -> tuple[dict[str, Any], bool]:
    """Fields of a static with which its contacts are as in MuJoCo, and whether they are so with all of `others`.

    others: the surfaces of the objects that may touch it. What no field can say is left to the objects.
    """
    wanted = [of_pair(own, other) for other in others]
    fields: dict[str, Any] = {}
    exact = True
    for number, name in enumerate(("friction", "restitution")):
        values = {pair[number] for pair in wanted}
        if all(pair[number] == getattr(other, name) for pair, other in zip(wanted, others, strict=True)):
            continue
        if len(values) == 1:
            fields[name] = values.pop()
        else:
            exact = False
    if fields:
        fields["dominant"] = True
    return fields, exact
