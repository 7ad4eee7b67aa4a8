"""Joints, equality constraints and actuators of a compiled MuJoCo model as joints of a world."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.exchange.bodies import MovingBody, twist
from polyworld.exchange.geoms import quaternion, vector
from polyworld.exchange.names import Names
from polyworld.world.representations.joint import Ball, Fixed, Hinge, Joint, Motor, Slider
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere

Array = NDArray[np.float64]

CARRIER_MASS = 1e-3  # of a body between two joints of another, of that one's mass: too light to change its motion
CARRIER_RADIUS = 0.01  # [m]
_FREE, _BALL, _SLIDE, _HINGE = range(4)  # mjtJoint


class JointReader:
    """Reads what holds the bodies of a model. carriers: light bodies between the joints of one body."""

    def __init__(self, model: Any, data: Any, bodies: list[MovingBody], names: Names) -> None:
        self._model, self._data = model, data
        self._names = names
        self._bodies = {body.root: body for body in bodies}
        self._own = Names()
        self._driven = self._actuators()
        self.joints: list[Joint] = []
        self.carriers: list[RigidObject] = []
        self.notes: list[str] = []

    def read(self) -> None:
        """Read joints, then equality constraints, then say what actuators there are."""
        for body in self._bodies.values():
            self._joints_of(body)
        for equality in range(self._model.neq):
            self._equality(equality)
        self.notes += list(self._driven.values())

    def holder(self, body: int) -> str | None:
        """Name of the object that a body of the model is part of; None for the world."""
        root = int(self._model.body_weldid[body])
        return None if root == 0 else self._bodies[root].item.name

    def _joints_of(self, body: MovingBody) -> None:
        model, first = self._model, int(self._model.body_jntadr[body.root])
        joints = list(range(first, first + int(model.body_jntnum[body.root])))
        if [int(model.jnt_type[j]) for j in joints] == [_FREE]:
            return
        parent = int(model.body_parentid[body.root])
        other = self.holder(parent)
        for number, joint in enumerate(joints):
            last = number == len(joints) - 1
            name = body.item.name if last else self._carrier(body, joints[: number + 1], parent)
            self.joints.append(self._joint(joint, name, other))
            other = name
        if len(joints) > 1:
            self.notes.append(
                f"{body.item.name} has {len(joints)} joints: {len(joints) - 1} balls of {CARRIER_MASS:g} of its mass, "
                "which touch nothing, lie between them"
            )

    def _carrier(self, body: MovingBody, joints: list[int], parent: int) -> str:
        """Add a light body that the last of `joints` moves, and return its name."""
        data = self._data
        place = np.array(data.xanchor[joints[-1]])
        velocity, omega = twist(self._model, data, parent, place)
        for joint in joints:
            axis, anchor = np.array(data.xaxis[joint]), np.array(data.xanchor[joint])
            kind, at = int(self._model.jnt_type[joint]), int(self._model.jnt_dofadr[joint])
            rate = np.array(data.qvel[at : at + 3])
            if kind == _SLIDE:
                velocity = velocity + axis * rate[0]
                continue
            turning = axis * rate[0] if kind == _HINGE else np.array(data.xmat[body.root]).reshape(3, 3) @ rate
            velocity, omega = velocity + np.cross(turning, place - anchor), omega + turning
        name = self._names.take(f"{body.item.name}-{self._model.joint(joints[-1]).name or len(joints)}", "carrier")
        self.carriers.append(
            RigidObject(
                name=name,
                shape=Sphere(radius=CARRIER_RADIUS),
                friction=0.0,
                restitution=0.0,
                mass=CARRIER_MASS * float(body.item.mass or 1.0),
                position=vector(place),
                orientation=quaternion(np.array(data.xmat[body.root]).reshape(3, 3)),
                velocity=vector(velocity),
                angular_velocity=vector(omega),
            )
        )
        return name

    def _joint(self, joint: int, name: str, other: str | None) -> Joint:
        model = self._model
        label = self._own.take(model.joint(joint).name, f"joint{joint}")
        kind, dof = int(model.jnt_type[joint]), int(model.jnt_dofadr[joint])
        anchor = vector(self._data.xanchor[joint])
        resists: dict[str, Any] = {
            "friction": float(model.dof_frictionloss[dof]),
            "damping": float(model.dof_damping[dof]),
        }
        for what, value, cure in (
            ("armature", float(model.dof_armature[dof]), ""),
            ("stiffness", float(model.jnt_stiffness[joint]), "; an effort of `Control` can stand for it"),
        ):
            if value:
                self.notes.append(f"joint {label}: its {what} {value:g} is left out{cure}")
        if kind == _BALL:
            if model.jnt_limited[joint]:
                self.notes.append(f"joint {label}: the limit of a ball joint is left out")
            return Ball(name=label, object=name, other=other, anchor=anchor, **resists)
        limits: dict[str, Any] = {}
        if model.jnt_limited[joint]:
            now = float(self._data.qpos[int(model.jnt_qposadr[joint])])
            lower, upper = (float(v) - now for v in model.jnt_range[joint])
            limits = {"lower": lower, "upper": upper}
        motor = Motor(limit=0.0) if joint in self._driven else None
        axis = vector(self._data.xaxis[joint])
        made = Hinge if kind == _HINGE else Slider
        return made(name=label, object=name, other=other, anchor=anchor, axis=axis, motor=motor, **resists, **limits)

    def _equality(self, equality: int) -> None:
        from mujoco import mjtEq, mjtObj

        model, data = self._model, self._data
        kind = int(model.eq_type[equality])
        label = model.equality(equality).name or f"{mjtEq(kind).name.removeprefix('mjEQ_').lower()}{equality}"
        if not model.eq_active0[equality]:
            self.notes.append(f"equality {label} is left out: it is not active at the start")
            return
        if kind not in (mjtEq.mjEQ_CONNECT, mjtEq.mjEQ_WELD):
            self.notes.append(f"equality {label} is left out: it has no counterpart")
            return
        first, second = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
        if int(model.eq_objtype[equality]) == mjtObj.mjOBJ_SITE:
            anchor = np.array(data.site_xpos[first])
            first, second = int(model.site_bodyid[first]), int(model.site_bodyid[second])
        else:
            # Of a connect, the point in the first body's axes; of a weld, in the second's.
            body = first if kind == mjtEq.mjEQ_CONNECT else second
            axes = np.array(data.xmat[body]).reshape(3, 3)
            anchor = np.array(data.xpos[body]) + axes @ np.array(model.eq_data[equality][:3])
        a, b = self.holder(first), self.holder(second)
        if a is None:
            a, b = b, a
        if a is None or a == b:
            self.notes.append(f"equality {label} is left out: both its bodies move as one")
            return
        made = Ball if kind == mjtEq.mjEQ_CONNECT else Fixed
        self.joints.append(made(name=self._own.take(label, label), object=a, other=b, anchor=vector(anchor)))
        self.notes.append(f"equality {label} is a {made.__name__.lower()} joint, which does not yield")

    def _actuators(self) -> dict[int, str]:
        """What to say of each actuator; the keys are the joints they drive, or negative numbers."""
        from mujoco import mjtTrn

        model = self._model
        said: dict[int, str] = {}
        for actuator in range(model.nu):
            label = model.actuator(actuator).name or f"actuator {actuator}"
            joint = int(model.actuator_trnid[actuator][0])
            on_axis = int(model.actuator_trntype[actuator]) in (mjtTrn.mjTRN_JOINT, mjtTrn.mjTRN_JOINTINPARENT)
            if not on_axis or int(model.jnt_type[joint]) not in (_SLIDE, _HINGE):
                said[-1 - actuator] = f"actuator {label} is left out: it acts on no hinge or slider"
                continue
            name, gear = model.joint(joint).name or f"joint{joint}", float(model.actuator_gear[actuator][0])
            said[joint] = (
                f"actuator {label} is left out: `Control(efforts=...)` drives the motor of joint {name}; the force is "
                f"{gear:g} times ({_law(model, actuator)})"
            )
        return said


def _law(model: Any, actuator: int) -> str:
    """The force of an actuator by its control, and the position and velocity of its joint."""
    terms = [f"{float(model.actuator_gainprm[actuator][0]):g} control"]
    if int(model.actuator_biastype[actuator]) == 1:  # affine
        bias = (float(v) for v in model.actuator_biasprm[actuator][:3])
        names = ("", " position", " velocity")
        terms += [f"{value:+g}{name}" for value, name in zip(bias, names, strict=True) if value]
    elif int(model.actuator_biastype[actuator]) > 1:
        terms.append("+ a law of its own")
    return " ".join(terms)
