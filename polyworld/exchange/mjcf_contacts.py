"""Surfaces and pairs that touch or do not, as MJCF says them.

A geom of higher priority decides a contact in MuJoCo, else the greater friction; here it is the geometric mean, or one
side's alone. Objects have priority over statics; where neither rule gives this engine's coefficients, the pair of geoms
has its own.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

from polyworld.exchange.mjcf_text import number, numbers
from polyworld.exchange.surfaces import damping_ratio
from polyworld.world import StaticObject, World, geometry
from polyworld.world.representations.rigid import RigidObject

FREQUENCY = 0.2  # of a contact that rebounds, radians a step: its half swing takes 16 steps
REBOUND_STEPS = 4  # steps in one of the world's where anything rebounds: MuJoCo's contacts yield the less
IMPEDANCE = 0.99  # of all contacts: with MuJoCo's 0.95 for light touches they would yield more


@dataclass(frozen=True)
class _Law:
    """Coefficients of a contact as this engine has them."""

    friction: float
    restitution: float
    torsion: float  # friction times the radius of the patch [m]
    rolling: float


class Contacts:
    """The contact parameters of a world's geoms, and its `contact` element."""

    def __init__(self, world: World) -> None:
        self._world = world
        rebound = any(o.restitution for o in world.objects) or any(s.restitution for s in world.statics)
        self.timestep = world.time.substep / (REBOUND_STEPS if rebound else 1)
        self.notes: list[str] = []
        if rebound:
            self.notes.append(
                f"rebound is by damped springs of {1e3 * math.pi * self.timestep / FREQUENCY:.3g} ms a contact, with "
                f"a timestep of {self.timestep:g} s: bodies sink in while they touch"
            )

    def of_object(self, item: RigidObject) -> dict[str, str]:
        """Attributes of an object's geoms."""
        return {**self._attributes(_own(item)), "priority": "1"}

    def of_static(self, static: StaticObject) -> dict[str, str]:
        """Attributes of a static's geom, which count where a pair has none."""
        law = _Law(static.friction or 0.0, static.restitution or 0.0, 0.0, 0.0)
        return self._attributes(law)

    def write(self, root: ET.Element) -> None:
        """Add the pairs that do not touch, and those whose coefficients no rule gives."""
        element = ET.SubElement(root, "contact")
        world, passing = self._world, self._world.passing()
        n = len(world.objects)
        parents = {frozenset((j.object, j.other)) for j in world.joints if j.kind != "spring"}
        for i, item in enumerate(world.objects):
            for j in range(i):
                other = world.objects[j]
                if passing[i, j]:
                    if frozenset((item.name, other.name)) not in parents or self._in_a_loop(item.name, other.name):
                        ET.SubElement(element, "exclude", body1=other.name, body2=item.name)
                elif _own(item) != _own(other):
                    self._pairs(element, item, _geoms(other), _mixed(_own(item), _own(other)))
            through = [passing[i, n + k] for k in range(len(world.statics))]
            if any(through):
                ET.SubElement(element, "exclude", body1="world", body2=item.name)
            for static, passes in zip(world.statics, through, strict=True):
                law = _with_static(_own(item), static)
                if not passes and (any(through) or law != _own(item)):
                    self._pairs(element, item, [static.name], law)

    def _in_a_loop(self, a: str, b: str) -> bool:
        """Whether a joint of these bodies may be a constraint in the document rather than one of its tree."""
        ends = [{j.object, j.other} for j in self._world.joints if j.kind != "spring"]
        return len(ends) >= len(self._world.objects) or ends.count({a, b}) > 1

    def _pairs(self, element: ET.Element, item: RigidObject, others: list[str], law: _Law) -> None:
        mu = law.friction
        friction = numbers([mu, mu, law.torsion, law.rolling, law.rolling])
        given = self._attributes(law) | {"friction": friction}
        for own in _geoms(item):
            for other in others:
                ET.SubElement(element, "pair", {"geom1": other, "geom2": own, **given})

    def _attributes(self, law: _Law) -> dict[str, str]:
        constant, ratio = 2.0 * self.timestep, 1.0
        if law.restitution > 0.0:
            ratio = damping_ratio(law.restitution, IMPEDANCE, FREQUENCY)
            constant = self.timestep / (FREQUENCY * ratio)
        return {
            "friction": numbers([law.friction, law.torsion, law.rolling]),
            "condim": "6" if law.rolling else "4" if law.torsion else "3" if law.friction else "1",
            "solref": f"{number(constant)} {number(ratio)}",
            "solimp": f"{IMPEDANCE} {IMPEDANCE} 0.001 0.5 2",
        }


def _geoms(item: RigidObject) -> list[str]:
    """Names of an object's geoms."""
    count = len(geometry.pieces(item.shape))
    return [item.name, *(f"{item.name}-{k}" for k in range(1, count))]


def _own(item: RigidObject) -> _Law:
    torsion = item.friction * (item.torsional_radius or 0.0)
    return _Law(item.friction, item.restitution, torsion, item.rolling_resistance)


def _mixed(a: _Law, b: _Law) -> _Law:
    """Coefficients of two objects' contact: geometric means, the greater moment arms."""
    return _Law(
        math.sqrt(a.friction * b.friction),
        math.sqrt(a.restitution * b.restitution),
        max(a.torsion, b.torsion),
        max(a.rolling, b.rolling),
    )


def _with_static(own: _Law, static: StaticObject) -> _Law:
    def of(mine: float, its: float | None) -> float:
        if its is None:
            return mine
        return its if static.dominant else math.sqrt(mine * its)

    return _Law(of(own.friction, static.friction), of(own.restitution, static.restitution), own.torsion, own.rolling)
