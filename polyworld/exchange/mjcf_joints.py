"""The joints of a world as MJCF has them: a tree of bodies, and constraints for what closes loops."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from polyworld.exchange.mjcf_text import number, numbers
from polyworld.world import World, geometry
from polyworld.world.representations.joint import Ball, Fixed, Hinge, Joint, Slider, Spring
from polyworld.world.representations.rigid import RigidObject

Array = NDArray[np.float64]

FAR = 1e6  # a stop that is never reached [rad or m]
TIGHT = 100.0  # torque per speed error of a motor that aims at a speed, in limits per rad/s or m/s


class Tree:
    """Which body hangs on which, by which joint, and what is left of the joints."""

    def __init__(self, world: World, timestep: float) -> None:
        self._world, self._timestep = world, timestep
        self._rotations = {o.name: geometry.quaternion_matrix(np.asarray(o.orientation)) for o in world.objects}
        self._parent: dict[str, str | None] = {}
        self._joint: dict[str, Joint | None] = {}
        self._loops: list[Joint] = []
        self._added: list[RigidObject] = []  # in the document's order
        self.notes: list[str] = []
        self._hang()

    def children(self, name: str | None) -> list[RigidObject]:
        """Return the objects that hang on one, or on the world, in the world's order."""
        return [o for o in self._world.objects if self._parent[o.name] == name]

    def relative(self, item: RigidObject, parent: str | None) -> tuple[Array, Array]:
        """Position (3,) and rotation (3, 3) of an object in the axes of another, or of the world."""
        position, rotation = np.asarray(item.position), self._rotations[item.name]
        if parent is None:
            return position, rotation
        turn = self._rotations[parent]
        return turn.T @ (position - np.asarray(self._world.object(parent).position)), turn.T @ rotation

    def add_joint(self, body: ET.Element, item: RigidObject) -> None:
        """Add to a body's element what it moves by."""
        self._added.append(item)
        joint = self._joint[item.name]
        if joint is None:
            ET.SubElement(body, "freejoint")
            return
        if isinstance(joint, Fixed):
            return
        assert isinstance(joint, Hinge | Slider | Ball)
        given = {"name": joint.name, "pos": self._local(item.name, joint.anchor)}
        given |= {"frictionloss": number(joint.friction), "damping": number(joint.damping)}
        if isinstance(joint, Ball):
            ET.SubElement(body, "joint", {"type": "ball", **given})
            return
        given["axis"] = numbers(self._rotations[item.name].T @ self._axis(item.name, joint))
        if joint.lower is not None or joint.upper is not None:
            stops = (-FAR if joint.lower is None else joint.lower, FAR if joint.upper is None else joint.upper)
            given["range"] = numbers(stops)
            # As stiff as a step allows: they do not rebound.
            given |= {"solreflimit": numbers((2.0 * self._timestep, 1.0)), "solimplimit": "0.99 0.99 0.001 0.5 2"}
        kind = "hinge" if isinstance(joint, Hinge) else "slide"
        ET.SubElement(body, "joint", {"type": kind, **given})

    def write(self, root: ET.Element) -> None:
        """Add constraints for joints that close loops, springs and motors."""
        equality, tendon = ET.SubElement(root, "equality"), ET.SubElement(root, "tendon")
        for joint in self._loops:
            self._constrain(equality, joint)
        for joint in self._world.joints:
            if isinstance(joint, Spring):
                self._add_spring(root, tendon, joint)
        self._add_motors(ET.SubElement(root, "actuator"))

    def start(self) -> tuple[list[float], list[float], list[float]]:
        """Positions, velocities and controls at the start, in the document's order."""
        positions: list[float] = []
        velocities: list[float] = []
        for item in self._added:
            joint, rotation = self._joint[item.name], self._rotations[item.name]
            spin = np.asarray(item.angular_velocity)
            if joint is None:
                positions += [*item.position, *item.orientation]
                velocities += [*item.velocity, *(rotation.T @ spin)]
                continue
            speed, turning = self._relative_rates(item, joint)
            if isinstance(joint, Ball):
                positions += [1.0, 0.0, 0.0, 0.0]
                velocities += [*(rotation.T @ turning)]
            elif isinstance(joint, Hinge | Slider):
                positions.append(0.0)
                rate = turning if isinstance(joint, Hinge) else speed
                velocities.append(float(self._axis(item.name, joint) @ rate))
        controls = []
        for joint in self._driven():
            assert joint.motor is not None
            effort = -joint.motor.limit if joint.motor.reverse else joint.motor.limit
            controls.append(effort if joint.motor.target_speed is None else joint.motor.target_speed)
        return positions, velocities, controls

    def _hang(self) -> None:
        """Breadth first from the world, then from the first object of whatever does not hang on it."""
        joints = [j for j in self._world.joints if not isinstance(j, Spring)]
        front: list[str | None] = [None]
        left = list(joints)
        names = [o.name for o in self._world.objects]
        while front:
            for end in front:
                for joint in [j for j in left if end in (j.object, j.other)]:
                    left.remove(joint)
                    far = joint.other if joint.object == end else joint.object
                    if far is None or far in self._parent or far == end:
                        self._loops.append(joint)
                        continue
                    self._parent[far], self._joint[far] = end, joint
            found: list[str | None] = [n for n in names if n in self._parent and self._parent[n] in front]
            front = [n for n in found if n not in front]
            free = [n for n in names if n not in self._parent]
            if not front and free:
                self._parent[free[0]], self._joint[free[0]] = None, None
                front = [free[0]]

    def _axis(self, child: str, joint: Hinge | Slider) -> Array:
        """The joint's axis in world axes, turned about where the child is its other."""
        axis: Array = np.asarray(joint.axis, dtype=float) / np.linalg.norm(joint.axis)
        return axis if joint.object == child else -axis

    def _local(self, name: str, point: tuple[float, float, float]) -> str:
        item = self._world.object(name)
        return numbers(self._rotations[name].T @ (np.asarray(point) - np.asarray(item.position)))

    def _relative_rates(self, item: RigidObject, joint: Joint) -> tuple[Array, Array]:
        """Velocity (3,) of the joint's point, and angular velocity (3,), against what the body hangs on."""
        anchor, parent = np.asarray(joint.anchor), self._parent[item.name]

        def rates(body: RigidObject) -> tuple[Array, Array]:
            spin = np.asarray(body.angular_velocity)
            return np.asarray(body.velocity) + np.cross(spin, anchor - np.asarray(body.position)), spin

        speed, spin = rates(item)
        if parent is None:
            return speed, spin
        other_speed, other_spin = rates(self._world.object(parent))
        return speed - other_speed, spin - other_spin

    def _constrain(self, equality: ET.Element, joint: Joint) -> None:
        bodies = {"body1": joint.object} | ({} if joint.other is None else {"body2": joint.other})
        points = [("", np.asarray(joint.anchor))]
        if isinstance(joint, Fixed):
            ET.SubElement(equality, "weld", {"name": joint.name, **bodies})
            return
        if isinstance(joint, Slider):
            self.notes.append(f"joint {joint.name} is left out: a slider that closes a loop has no counterpart")
            return
        if isinstance(joint, Hinge):
            axis = self._axis(joint.object, joint)
            points.append(("-axis", points[0][1] + axis))
            if joint.motor is not None or joint.lower is not None or joint.upper is not None:
                self.notes.append(f"joint {joint.name} closes a loop: its motor and stops are left out")
        if isinstance(joint, Hinge | Ball) and (joint.friction or joint.damping):
            self.notes.append(f"joint {joint.name} closes a loop: its friction and damping are left out")
        for suffix, point in points:
            anchor = self._local(joint.object, (float(point[0]), float(point[1]), float(point[2])))
            ET.SubElement(equality, "connect", {"name": joint.name + suffix, "anchor": anchor, **bodies})

    def _add_spring(self, root: ET.Element, tendon: ET.Element, joint: Spring) -> None:
        spatial = ET.SubElement(
            tendon,
            "spatial",
            name=joint.name,
            stiffness=number(joint.stiffness),
            damping=number(joint.damping),
            springlength=number(joint.length),
        )
        bodies = {b.get("name"): b for b in root.iter("body")}
        world = root.find("worldbody")
        assert world is not None
        for end, name, point in (("a", joint.object, joint.anchor), ("b", joint.other, joint.other_anchor)):
            body = world if name is None else bodies[name]
            local = numbers(point) if name is None else self._local(name, point)
            ET.SubElement(body, "site", name=f"{joint.name}-{end}", pos=local)
            ET.SubElement(spatial, "site", site=f"{joint.name}-{end}")

    def _driven(self) -> list[Hinge | Slider]:
        """Joints of the tree that have motors."""
        inside = [j for j in self._joint.values() if j is not None]
        return [j for j in self._world.joints if isinstance(j, Hinge | Slider) and j.motor is not None and j in inside]

    def _add_motors(self, actuator: ET.Element) -> None:
        for joint in self._driven():
            motor = joint.motor
            assert motor is not None
            given = {"name": joint.name, "joint": joint.name}
            if motor.target_speed is None:
                ET.SubElement(actuator, "motor", given)
            else:
                limits = {"kv": number(TIGHT * motor.limit), "forcerange": numbers((-motor.limit, motor.limit))}
                ET.SubElement(actuator, "velocity", given | limits)
            if motor.start or motor.end is not None or motor.delay:
                self.notes.append(f"motor of joint {joint.name}: when it is switched on and off is left out")
