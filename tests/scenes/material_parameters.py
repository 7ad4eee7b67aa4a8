"""Scenes of the recovery benchmark: what is hidden, what is seen of it, and the coarser world that is fitted to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.data.shape_series import ShapeSeries
from polyworld.data.tracks import ObservedTracks, shapes_only
from polyworld.estimation.unknown import Unknown
from polyworld.probing.readouts import (
    Amount,
    Centreline,
    Front,
    GridOccupancy,
    Markers,
    Outline,
    Readout,
    Tension,
    read,
)
from polyworld.solver.rollout import simulator
from polyworld.world import Environment, MotionPlane, StaticObject, TimeBase, World
from polyworld.world.parameters import with_parameters
from polyworld.world.representations.attachment import Attachment, Region
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.representations.fluid import Container, Emitter, Fluid, FluidGrid, FluidVolume
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Pulley, Rope
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box, Cylinder, Plane, Sphere

Array = NDArray[np.float64]

SIDE = Environment(motion_plane=MotionPlane(normal=(0.0, -1.0, 0.0), supports=False))
SIGMA = 0.002  # [m] of points and tracks


@dataclass(frozen=True)
class Scene:
    """build(fine) makes the world: fine, as the data come from, or coarse, as fitted. hidden: path -> true value.

    unknowns: what is searched; frames: how many, seconds_per_frame apart. readouts of deformable objects with the
    standard deviation of their noise; tracked: rigid objects whose positions are seen.
    """

    name: str
    build: Callable[[bool], World]
    hidden: Mapping[str, float]
    unknowns: Sequence[Unknown]
    frames: int
    seconds_per_frame: float
    readouts: Sequence[tuple[Readout, float]] = ()
    tracked: Sequence[str] = ()

    def observed(self, seed: int) -> ObservedTracks:
        """Noisy data from the fine world with the hidden values."""
        truth = with_parameters(self.build(True), self.hidden)
        frames = np.arange(self.frames)
        batch = simulator(truth, frames * self.seconds_per_frame, n_worlds=1).run()
        if batch.diverged[0]:
            raise RuntimeError(f"{self.name}: the hidden world diverges at {batch.diverged_time[0]:.3g} s")
        rng = np.random.default_rng(seed)
        tracks = shapes_only((), frames, self.seconds_per_frame)
        if self.tracked:
            columns = [batch.names.index(n) for n in self.tracked]
            positions = batch.positions[0][:, columns]
            shape = positions.shape[:2]
            tracks = ObservedTracks(
                names=tuple(self.tracked),
                frames=frames,
                seconds_per_frame=self.seconds_per_frame,
                positions=positions + SIGMA * rng.normal(size=positions.shape),
                position_sigma=np.full(shape, SIGMA),
                orientations=np.full((*shape, 4), np.nan),
                confidence=np.ones(shape),
                orientation_confidence=np.zeros(shape),
                symmetry=(0,) * len(columns),
            )
        series = []
        for readout, sigma in self.readouts:
            exact = read(readout, truth, batch)[0]
            seen = np.isfinite(exact).all(axis=-1)
            noisy = exact + sigma * rng.normal(size=exact.shape)
            series.append(ShapeSeries(readout, noisy, np.full(exact.shape[:2], sigma), seen.astype(float)))
        return tracks.with_shapes(tuple(series), frames) if series else tracks


def log(path: str, lower: float, upper: float, start: float) -> Unknown:
    """An unknown over decades; the search begins at `start`, a quarter of the range wide."""
    sd = 0.25 * float(np.log(upper / lower))
    return Unknown(path.removeprefix("objects."), (path,), "", start, lower, upper, sd, scale="log")


def linear(path: str, lower: float, upper: float, start: float) -> Unknown:
    """An unknown in its own unit; the search begins at `start`, a quarter of the range wide."""
    return Unknown(path.removeprefix("objects."), (path,), "", start, lower, upper, 0.25 * (upper - lower))


def _time(fine: bool, step: float, substep: float) -> TimeBase:
    return TimeBase(seconds_per_frame=step, substep=0.5 * substep if fine else substep)


# --- rope -------------------------------------------------------------------------------------------


def _bent_rope(fine: bool) -> World:
    rope = Rope(
        name="rope",
        representation="rope_planar",
        points=((0.0, 0.0, 0.0), (0.6, 0.0, 0.0)),
        segments=48 if fine else 16,
        linear_density=0.05,
        stretch_stiffness=500.0,
        bending_stiffness=1e-3,
    )
    return World(
        environment=SIDE,
        deformables=(rope,),
        attachments=(Attachment(name="wall", object="rope", end="start", clamped=True),),
        time=_time(fine, 0.02, 0.002),
    )


def _atwood(fine: bool) -> World:
    loads = tuple(
        RigidObject(name=n, shape=Sphere(radius=0.04), mass=m, position=(x, 0.0, -0.5), representation="rigid_planar")
        for n, x, m in (("left", -0.1, 1.0), ("right", 0.1, 1.0))
    )
    rope = Rope(
        name="rope",
        representation="rope_planar",
        points=((-0.1, 0.0, -0.46), (0.1, 0.0, -0.46)),
        segments=40 if fine else 16,
        linear_density=0.02,
        stretch_stiffness=2e4,
        stretch_damping=0.002,
    )
    return World(
        environment=SIDE,
        objects=loads,
        deformables=(rope,),
        attachments=(
            Attachment(name="l", object="rope", end="start", to="left"),
            Attachment(name="r", object="rope", end="end", to="right"),
        ),
        pulleys=(
            Pulley(
                name="wheel",
                rope="rope",
                centre=(0.0, 0.0, 0.0),
                axis=(0.0, -1.0, 0.0),
                radius=0.1,
                after=0,
                fixed_wheel=True,
                turns_positive=False,
            ),
        ),
        time=_time(fine, 0.02, 0.002),
    )


# --- cloth ------------------------------------------------------------------------------------------


def _flag(fine: bool) -> World:
    cells = 20 if fine else 10
    cloth = Cloth(
        name="cloth",
        geometry=Sheet(
            corner=(0.0, 0.0, 0.0), edge_u=(0.4, 0.0, 0.0), edge_v=(0.0, 0.4, 0.0), divisions=(cells, cells)
        ),
        areal_density=0.2,
        stretch_stiffness=60.0,
        bending_stiffness=1e-4,
        self_contact=False,
        drag_normal=0.0,
        drag_tangential=0.0,
    )
    return World(
        deformables=(cloth,),
        attachments=(
            Attachment(name="edge", object="cloth", region=Region(lower=(-1.0, -1.0, -1.0), upper=(0.001, 1.0, 1.0))),
        ),
        time=_time(fine, 0.02, 0.002),
    )


# --- soft body --------------------------------------------------------------------------------------


def _beam(fine: bool) -> World:
    beam = Soft(
        name="beam",
        representation="soft_planar",
        shape=Box(half_extents=(0.15, 0.02, 0.02)),
        thickness=0.04,
        position=(0.15, 0.0, 0.0),
        resolution=0.02 if fine else 0.04,
        density=1000.0,
        youngs_modulus=2e5,
        poisson_ratio=0.3,
    )
    return World(
        environment=SIDE,
        deformables=(beam,),
        attachments=(
            Attachment(name="wall", object="beam", region=Region(lower=(-0.01, -1.0, -1.0), upper=(0.001, 1.0, 1.0))),
        ),
        time=_time(fine, 0.02, 0.002),
    )


# --- fluids -----------------------------------------------------------------------------------------


def _column(fine: bool) -> World:
    honey = Fluid(
        name="honey",
        representation="fluid_planar",
        volumes=(FluidVolume(shape=Box(half_extents=(0.1, 0.1, 0.1)), position=(0.1, 0.0, 0.1)),),
        density=1000.0,
        viscosity=5.0,
        slip=False,
    )
    return World(
        environment=SIDE,
        deformables=(honey,),
        fluid_grid=FluidGrid(lower=(0.0, -0.1, 0.0), upper=(0.8, 0.1, 0.3), cell=0.0125 if fine else 0.02),
        time=_time(fine, 0.025, 0.005),
    )


def _float(fine: bool) -> World:
    water = Fluid(
        name="liquid",
        representation="fluid_planar",
        volumes=(FluidVolume(shape=Box(half_extents=(0.3, 0.1, 0.15)), position=(0.3, 0.0, 0.15)),),
        density=1000.0,
    )
    disc = RigidObject(
        name="disc",
        shape=Cylinder(radius=0.08, half_height=0.5),
        orientation=(float(np.sqrt(0.5)), float(np.sqrt(0.5)), 0.0, 0.0),
        density=600.0,
        position=(0.3, 0.0, 0.22),
        representation="rigid_planar",
    )
    return World(
        environment=SIDE,
        objects=(disc,),
        deformables=(water,),
        fluid_grid=FluidGrid(lower=(0.0, -0.1, 0.0), upper=(0.6, 0.1, 0.5), cell=0.0125 if fine else 0.02),
        time=_time(fine, 0.025, 0.005),
    )


def _tap(fine: bool) -> World:
    water = Fluid(name="water", representation="fluid_planar", density=1000.0, viscosity=0.001)
    return World(
        environment=SIDE,
        deformables=(water,),
        emitters=(
            Emitter(
                name="tap",
                fluid="water",
                position=(0.15, 0.0, 0.35),
                direction=(0.0, 0.0, -1.0),
                radius=0.04,
                rate=0.05,
            ),
        ),
        containers=(Container(name="basin", lower=(0.0, -0.2, 0.0), upper=(0.4, 0.2, 0.2)),),
        fluid_grid=FluidGrid(lower=(0.0, -0.1, 0.0), upper=(0.4, 0.1, 0.4), cell=0.0125 if fine else 0.02),
        time=_time(fine, 0.025, 0.005),
    )


# --- rigid ------------------------------------------------------------------------------------------


def _pucks(fine: bool) -> World:
    def puck(name: str, x: float, y: float, vx: float) -> RigidObject:
        return RigidObject(
            name=name,
            shape=Cylinder(radius=0.1, half_height=0.05),
            position=(x, y, 0.05),
            velocity=(vx, 0.0, 0.0),
            mass=1.0,
            friction=0.1,
            restitution=0.5,
            linear_damping=0.1,
            representation="rigid_planar",
        )

    return World(
        objects=(puck("cue", -1.0, 0.0, 3.0), puck("target", 0.0, 0.05, 0.0)),
        time=_time(fine, 0.04, 0.002),
    )


def _bounce(fine: bool) -> World:
    ball = RigidObject(
        name="ball",
        shape=Sphere(radius=0.05),
        mass=0.2,
        restitution=0.5,
        linear_damping=0.1,
        position=(0.0, 0.0, 1.0),
        velocity=(0.5, 0.0, 0.0),
        representation="rigid_spatial",
    )
    return World(
        objects=(ball,),
        statics=(StaticObject(name="floor", shape=Plane(normal=(0.0, 0.0, 1.0))),),
        time=_time(fine, 0.03, 0.002),
    )


DIAGONAL = float(np.sqrt(0.5))
EIGHT = (
    (1.0, 0.0, 0.0),
    (-1.0, 0.0, 0.0),
    (0.0, 0.0, 1.0),
    (0.0, 0.0, -1.0),
    (DIAGONAL, 0.0, DIAGONAL),
    (-DIAGONAL, 0.0, DIAGONAL),
    (DIAGONAL, 0.0, -DIAGONAL),
    (-DIAGONAL, 0.0, -DIAGONAL),
)
MARKS = tuple((float(x), float(y), 0.0) for x in (0.15, 0.25, 0.4) for y in (0.0, 0.2, 0.4))


def scenes() -> list[Scene]:
    """All of them, in the order of the table."""
    return [
        Scene(
            "rope",
            _bent_rope,
            {"objects.rope.bending_stiffness": 3.1e-3, "objects.rope.linear_damping": 0.7},
            [log("objects.rope.bending_stiffness", 1e-5, 1e-1, 1e-3), linear("objects.rope.linear_damping", 0, 3, 1.5)],
            40,
            0.02,
            [(Centreline(object="rope", count=9), SIGMA)],
        ),
        Scene(
            "rope over a pulley",
            _atwood,
            {"pulleys.wheel.friction": 0.13, "objects.right.mass": 2.3},
            [linear("pulleys.wheel.friction", 0.0, 0.5, 0.25), log("objects.right.mass", 0.3, 5.0, 1.5)],
            20,
            0.02,
            [(Tension(object="rope", at=0.0), 0.3), (Tension(object="rope", at=1.0), 0.3)],
            tracked=("left", "right"),
        ),
        Scene(
            "cloth",
            _flag,
            {
                "objects.cloth.stretch_stiffness": 41.0,
                "objects.cloth.bending_stiffness": 2e-3,
                "objects.cloth.linear_damping": 0.8,
            },
            [
                log("objects.cloth.stretch_stiffness", 10.0, 300.0, 60.0),
                log("objects.cloth.bending_stiffness", 1e-5, 1e-1, 1e-3),
                linear("objects.cloth.linear_damping", 0.0, 3.0, 1.5),
            ],
            40,
            0.02,
            [(Markers(object="cloth", at=MARKS), SIGMA)],
        ),
        Scene(
            "soft body",
            _beam,
            {"objects.beam.youngs_modulus": 1.3e5, "objects.beam.damping": 0.009},
            [log("objects.beam.youngs_modulus", 4e4, 4e5, 1e5), linear("objects.beam.damping", 0.0, 0.03, 0.015)],
            40,
            0.02,
            [(Outline(object="beam", directions=EIGHT), SIGMA)],
        ),
        Scene(
            "viscous fluid",
            _column,
            {"objects.honey.viscosity": 8.3},
            [log("objects.honey.viscosity", 0.3, 100.0, 5.0)],
            24,
            0.025,
            [
                (Front(object="honey", direction=(1.0, 0.0, 0.0), share=0.95), 0.004),
                (Front(object="honey", direction=(0.0, 0.0, 1.0), share=0.95), 0.004),
            ],
        ),
        Scene(
            "floating disc",
            _float,
            {"objects.liquid.density": 1430.0},
            [log("objects.liquid.density", 650.0, 4000.0, 1600.0)],
            24,
            0.025,
            tracked=("disc",),
        ),
        Scene(
            "tap",
            _tap,
            {"emitters.tap.rate": 0.073},
            [log("emitters.tap.rate", 0.01, 0.3, 0.05)],
            30,
            0.025,
            [
                (Amount(object="water", container="basin"), 0.001),
                (GridOccupancy(object="water", lower=(0.0, -0.1, 0.0), upper=(0.4, 0.1, 0.4), cells=(4, 1, 4)), 0.1),
            ],
        ),
        Scene(
            "rigid pucks",
            _pucks,
            {
                "objects.cue.friction": 0.17,
                "objects.target.friction": 0.23,
                "objects.cue.restitution": 0.72,
                "objects.target.restitution": 0.72,
                "objects.target.mass": 1.7,
            },
            [
                linear("objects.cue.friction", 0.0, 0.5, 0.25),
                linear("objects.target.friction", 0.0, 0.5, 0.25),
                Unknown(
                    "restitution", ("objects.cue.restitution", "objects.target.restitution"), "", 0.5, 0.0, 1.0, 0.25
                ),
                log("objects.target.mass", 0.3, 5.0, 1.2),
            ],
            40,
            0.04,
            tracked=("cue", "target"),
        ),
        Scene(
            "rigid ball",
            _bounce,
            {"objects.ball.restitution": 0.83, "objects.ball.linear_damping": 0.37},
            [linear("objects.ball.restitution", 0.0, 1.0, 0.5), linear("objects.ball.linear_damping", 0.0, 1.0, 0.5)],
            50,
            0.03,
            tracked=("ball",),
        ),
    ]
