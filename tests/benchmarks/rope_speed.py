"""Speed of ropes beside MuJoCo and Newton: a rope held at one end swings down from the horizontal.

    python -m tests.benchmarks.rope_speed [--seconds S] [--worlds N] [--segments N]

Every figure is measured in the run that prints it. Engines whose package is not installed, or that fail, have a row
that says why.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

import numpy as np

from polyworld import World, simulator
from tests.benchmarks.speed_rows import THREADS, Row, header, print_rows, timed

LENGTH, RADIUS, LINEAR_DENSITY, STRETCH, BENDING = 1.0, 0.005, 0.08, 1e4, 1e-4
DIFFERENCES = (
    "PolyWorld: stretch EA = 1e4 N solved implicitly, bending EI = 1e-4 N m^2 explicit. MuJoCo: capsules on "
    "ball joints, which cannot stretch, with springs of the same bending. Newton: SemiImplicit, particles on undamped "
    "springs of the same EA, without bending. 'low': how far the free end is below the held one at the end."
)


def scene(segments: int) -> World:
    """Return the rope as a world."""
    rope = {
        "name": "rope",
        "representation": "rope",
        "points": [(0, 0, 0), (LENGTH, 0, 0)],
        "segments": segments,
        "radius": RADIUS,
        "linear_density": LINEAR_DENSITY,
        "stretch_stiffness": STRETCH,
        "stretch_damping": 1e-3,
        "bending_stiffness": BENDING,
    }
    return World.model_validate(
        {"deformables": [rope], "attachments": [{"name": "held", "object": "rope", "end": "start"}]}
    )


def polyworld_row(segments: int, worlds: int, seconds: float) -> Row:
    """Whole rollouts, buffers and kernels made before."""
    run: Any = simulator(scene(segments), np.array([seconds / 10, seconds]), n_worlds=worlds, threads=THREADS)
    run.run(samples=1)
    result: list[Any] = []
    wall, cpu = timed(lambda: result.append(run.run()))
    shard = run._shards[0]
    dt = float(shard.world.time.substep / shard.clock.inner_steps.numpy()[0])
    low = -float(result[0].deformables["rope"].points[0, -1, -1, 2])
    return Row("PolyWorld", segments, worlds, dt, seconds, wall, cpu, low)


def mujoco_row(segments: int, worlds: int, seconds: float) -> Row:
    """MuJoCo: a chain of capsules on ball joints with springs, one capsule a segment."""
    import mujoco
    import mujoco.rollout

    spacing = LENGTH / segments
    dt = 0.0005
    spec = mujoco.MjSpec()
    spec.option.timestep = dt
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    body = spec.worldbody
    for i in range(segments):
        body = body.add_body(pos=[0.0 if i == 0 else spacing, 0.0, 0.0])
        body.add_joint(type=mujoco.mjtJoint.mjJNT_BALL, stiffness=0.0 if i == 0 else BENDING / spacing, armature=1e-9)
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[0.0, 0.0, 0.0, spacing, 0.0, 0.0],
            size=[RADIUS, 0.0, 0.0],
            mass=LINEAR_DENSITY * spacing,
        )
    body.add_site(pos=[spacing, 0.0, 0.0])
    model = spec.compile()
    steps = round(seconds / dt)
    data = [mujoco.MjData(model) for _ in range(min(THREADS, worlds))]
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    mujoco.mj_forward(model, data[0])
    state = np.zeros(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data[0], state, full)
    pool = mujoco.rollout.Rollout(nthread=THREADS if worlds > 1 else 0)
    start = np.tile(state, (worlds, 1))
    pool.rollout(model, data, start, nstep=2)
    wall, cpu = timed(lambda: pool.rollout(model, data, start, nstep=steps))
    mujoco.mj_kinematics(model, data[0])
    low = -float(data[0].site_xpos[-1, 2])
    return Row(f"MuJoCo {mujoco.__version__} chain", segments, worlds, dt, steps * dt, wall, cpu, low)


def newton_row(segments: int, worlds: int, seconds: float) -> Row:
    """Newton: particles and springs."""
    import newton
    import warp as wp

    builder = newton.ModelBuilder(gravity=(0.0, 0.0, -9.81))
    spacing = LENGTH / segments
    for w in range(worlds):
        first = w * (segments + 1)
        for i in range(segments + 1):
            mass = 0.0 if i == 0 else LINEAR_DENSITY * spacing * (0.5 if i == segments else 1.0)
            builder.add_particle(wp.vec3(i * spacing, 2.0 * w, 0.0), wp.vec3(0.0), mass)
        for i in range(first, first + segments):
            builder.add_spring(i, i + 1, STRETCH / spacing, 0.0, 0.0)
    with wp.ScopedDevice("cpu"):
        model = builder.finalize(device="cpu")
        model.particle_grid = None  # no contact of particles
        solver = newton.solvers.SolverSemiImplicit(model)
        states = [model.state(), model.state()]
        control = model.control()
        speed = np.sqrt(STRETCH / LINEAR_DENSITY)
        dt = 0.2 * spacing / speed
        pairs = max(round(seconds / dt / 2), 1)

        def step() -> None:
            for a, b in ((0, 1), (1, 0)):
                states[a].clear_forces()
                solver.step(states[a], states[b], control, None, dt)

        step()
        with wp.ScopedCapture(device="cpu") as capture:
            step()
        states[0].particle_q.assign(model.particle_q)
        states[0].particle_qd.assign(model.particle_qd)

        def run() -> None:
            for _ in range(pairs):
                wp.capture_launch(capture.graph)

        wall, cpu = timed(run)
        low = -float(states[0].particle_q.numpy()[segments, 2])
    return Row(f"Newton {newton.__version__} springs", segments, worlds, dt, 2 * pairs * dt, wall, cpu, low)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=0.5, help="simulated seconds of one world")
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--segments", type=int, default=100)
    args = parser.parse_args()
    n, seconds, many = args.segments, args.seconds, args.seconds / 5
    print(header("segs", "low m"))
    print_rows(
        [
            ("PolyWorld", lambda: polyworld_row(n, 1, seconds)),
            ("PolyWorld", lambda: polyworld_row(n, args.worlds, many)),
            ("MuJoCo chain", lambda: mujoco_row(n, 1, seconds)),
            ("MuJoCo chain", lambda: mujoco_row(n, args.worlds, many)),
            ("Newton springs", lambda: newton_row(n, 1, seconds)),
            ("Newton springs", lambda: newton_row(n, args.worlds, many)),
        ]
    )
    print(DIFFERENCES, file=sys.stderr)


if __name__ == "__main__":
    main()
