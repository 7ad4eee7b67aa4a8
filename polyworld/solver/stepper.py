"""A world of rigid bodies advanced interval by interval, under control, from any saved state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polyworld.model import model_of
from polyworld.solver.core.saved_state import SavedState
from polyworld.trajectory import Event
from polyworld.world import World
from polyworld.world.representations.joint import Hinge, Slider

if TYPE_CHECKING:
    from polyworld.solver.core.simulator import RigidSimulator
    from polyworld.solver.planar import PlanarSimulator
    from polyworld.solver.spatial.simulator import SpatialSimulator

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

NO_COUPLED_STATE = (
    "worlds with ropes, cloth, soft bodies or fluids are rolled out from the start only: the state of their contacts, "
    "fastenings and particles is not saved; `rollout` takes them"
)


@dataclass(frozen=True)
class Control:
    """What acts on a world from outside during an interval, constant over it; what is not named does not act.

    forces [N] at the centre of mass and torques [N m] by object, world axes; in planar worlds forces in the motion
    plane and torques about its normal. efforts [N m or N] by joint, positive about its axis: of motors without a target
    speed. speeds [rad/s or m/s] by joint: target speeds of motors that have one, up to their limit. A motor that is not
    named acts as the world describes it; `Motor(limit=0.0)` describes one that only control drives.
    """

    forces: Mapping[str, Vector] = field(default_factory=dict)
    torques: Mapping[str, Vector] = field(default_factory=dict)
    efforts: Mapping[str, float] = field(default_factory=dict)
    speeds: Mapping[str, float] = field(default_factory=dict)


Callback = Callable[[SavedState], Control | None]


class Stepper:
    """One world, advanced by intervals of `interval` [s] (default: one frame), of substeps as `rollout` takes them.

    Without control, its states are those of `rollout` with that `sample_interval`, to the bit.
    """

    def __init__(self, world: World, *, interval: float | None = None, start: SavedState | None = None) -> None:
        self.world = world
        self.interval = world.time.seconds_per_frame if interval is None else interval
        if not (np.isfinite(self.interval) and self.interval > 0.0):
            raise ValueError(f"interval must be positive, got {interval}")
        self._simulator = _simulator_of(world)
        self._normal = model_of(world).plane_axes[2] if world.planar else None
        self._motors = {j.name: j.motor for j in world.joints if isinstance(j, Hinge | Slider) and j.motor is not None}
        self.reset(start)

    @property
    def state(self) -> SavedState:
        """The state now, without the solver's memory; `save` returns it with that."""
        return self._state

    @property
    def time(self) -> float:
        """Time of the state [s]."""
        return self._state.time

    def reset(self, start: SavedState | None = None) -> None:
        """Return to a saved state of this world, by default to its start."""
        if start is None:
            self._state = self._simulator.begin()
            return
        self._simulator.begin()
        self._simulator.restore(start)
        self._state = replace(start, memory={})

    def step(self, count: int = 1, *, control: Callback | None = None) -> SavedState:
        """Advance by `count` intervals and return the state.

        control: called with the state at the start of each interval; returns what acts during it. Raises ValueError for
        names or motors that the world does not have, RuntimeError where the world diverges or runs out of room.
        """
        if count < 1:
            raise ValueError(f"count must be at least 1, got {count}")
        if control is not None and not callable(control):
            raise TypeError("control must be a function of the state: for a constant one, `lambda state: control`")
        for _ in range(count):
            given = None if control is None else control(self._state)
            if given is not None and not isinstance(given, Control):
                raise TypeError(f"control must return a Control or None, got {given!r:.60}")
            if given is not None:
                self._apply(given)
            self.advance_to(self._next_time())
            if given is not None:
                self._simulator.release()
        return self._state

    def save(self) -> SavedState:
        """Return the state with the solver's memory, for `reset`, `stepper`, `rollout(start=...)` or `to_bytes`."""
        return self._simulator.save(self._state)

    def events(self) -> tuple[Event, ...]:
        """Contacts since the world's start, in order of time; one that lasts has no end."""
        return self._simulator.contacts(self.time)

    def advance_to(self, end: float) -> SavedState:
        """Advance to a time [s] in one interval, without control, and return the state."""
        if not end > self.time:
            raise ValueError(f"the end must lie beyond {self.time:.6g} s, got {end}")
        self._state = self._simulator.advance(self._state, end)
        return self._state

    def _next_time(self) -> float:
        """End of the interval that begins now: on the grid of a run from time 0 where it begins there."""
        number = round(self.time / self.interval)
        on_grid = abs(number * self.interval - self.time) <= 1e-9 * self.interval
        return (number + 1) * self.interval if on_grid else self.time + self.interval

    def _apply(self, control: Control) -> None:
        n = len(self._simulator.names)
        forces, torques = np.zeros((n, 3)), np.zeros((n, 3))
        for values, given, what in ((forces, control.forces, "force"), (torques, control.torques, "torque")):
            for name, vector in given.items():
                self.world.object(name)
                values[self._simulator.names.index(name)] = self._checked(name, vector, what)
        for given, driven, wanted in (
            (control.efforts, False, "an effort: its motor aims at a speed, set `speeds`"),
            (control.speeds, True, "a speed: its motor has no target_speed, set `efforts`"),
        ):
            for name, value in given.items():
                if name not in self._motors:
                    raise ValueError(
                        f"joint {name!r} has no motor; joints with motors: {sorted(self._motors)}. Give a hinge or "
                        "slider motor={'limit': 0.0} in the world to drive it by control alone"
                    )
                if (self._motors[name].target_speed is not None) != driven:
                    raise ValueError(f"joint {name!r} does not take {wanted}")
                if not np.isfinite(value):
                    raise ValueError(f"control of joint {name!r} must be finite, got {value}")
        self._simulator.control(forces, torques, control.efforts, control.speeds)

    def _checked(self, name: str, vector: Vector, what: str) -> Array:
        value = np.asarray(vector, dtype=float)
        if value.shape != (3,) or not np.isfinite(value).all():
            raise ValueError(f"the {what} on {name!r} must be three finite numbers, got {vector}")
        if self._normal is not None:
            along = self._normal * (self._normal @ value)
            out = along if what == "force" else value - along
            if np.abs(out).max() > 1e-9 * np.abs(value).max(initial=1e-300):
                raise ValueError(
                    f"{name!r} is rigid_planar: control takes forces in the motion plane and torques about its normal "
                    f"{tuple(self._normal.tolist())}, got {what} {vector}"
                )
        return value


def stepper(world: World, *, interval: float | None = None, start: SavedState | None = None) -> Stepper:
    """Return a `Stepper` of a world of rigid bodies, at its start or at a state that was saved of it.

    Raises ValueError for worlds with deformable objects.
    """
    return Stepper(world, interval=interval, start=start)


def _simulator_of(world: World) -> RigidSimulator:
    """A simulator of one world with room for one sample and for every start time in an interval."""
    if world.coupled:
        raise ValueError(NO_COUPLED_STATE)
    model = model_of(world)
    last = np.array([max([0.0, *(o.start_time for o in world.objects)]) + 1.0])
    return solver_of(world)(model, last, record_events=True, threads=1)


def solver_of(world: World) -> type[PlanarSimulator] | type[SpatialSimulator]:
    """Return the solver of a world of rigid bodies: that in space also of bodies that joints hold in a plane."""
    # Imported here: a world needs only its own solver, and each brings its kernels.
    if world.planar and not world.joints:
        from polyworld.solver.planar import PlanarSimulator

        return PlanarSimulator
    from polyworld.solver.spatial.simulator import SpatialSimulator

    return SpatialSimulator
