"""Speed of cloth beside Newton and MuJoCo: a sheet of 50 x 50 cells, held at two corners, swinging down.

    python -m tests.benchmarks.cloth_speed [--seconds S] [--worlds N] [--divisions N]

Every figure is measured in the run that prints it. Engines whose package is not installed, or that fail, have a row
that says why. No air and no contact with itself, which not all of them have.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from polyworld import World, simulator
from tests.benchmarks.speed_rows import THREADS, Row, header, print_rows, timed

SIZE, AREAL_DENSITY, THICKNESS = 1.0, 0.2, 0.002  # [m], [kg/m^2], [m]
STRETCH, POISSON = 500.0, 0.3  # E t [N/m]
PLATE = STRETCH * THICKNESS**2 / (12.0 * (1.0 - POISSON**2))  # that of a homogeneous sheet [N m]
GRAVITY = 9.81
DIFFERENCES = (
    "PolyWorld: true forces, step from the stiffness (0.85 of the stability limit). Newton: tri_ke, tri_ka the Lame "
    "constants, edge_ke the plate stiffness; float32; SemiImplicit at our inner step; VBD at 1/600 s, 10 iterations "
    "as in its own example, which damp and stretch it; XPBD is not here: with springs of this stiffness it blew up. "
    "MuJoCo: dim-2 flex with elastic2d both, at 0.25 ms. 'drop': lowest point below the corners at the end, where all "
    "should agree."
)


def scene(divisions: int, **more: Any) -> World:
    """Return the sheet as a world."""
    return World.model_validate(
        {
            "deformables": [
                {
                    "name": "sheet",
                    "representation": "cloth",
                    "geometry": {
                        "kind": "sheet",
                        "corner": (0, 0, 0),
                        "edge_u": (SIZE, 0, 0),
                        "edge_v": (0, SIZE, 0),
                        "divisions": (divisions, divisions),
                    },
                    "areal_density": AREAL_DENSITY,
                    "thickness": THICKNESS,
                    "stretch_stiffness": STRETCH,
                    "poisson_ratio": POISSON,
                    "bending_stiffness": PLATE,
                    "self_contact": False,
                    **more,
                }
            ],
            "attachments": [{"name": "corners", "object": "sheet", "nodes": [0, divisions]}],
            "environment": {"gravity": (0, 0, -GRAVITY), "air_density": 0.0},
        }
    )


def polyworld_row(name: str, divisions: int, worlds: int, seconds: float, **more: Any) -> Row:
    """Whole rollouts, buffers and kernels made before."""
    run: Any = simulator(scene(divisions, **more), np.array([seconds / 10, seconds]), n_worlds=worlds, threads=THREADS)
    run.run(samples=1)
    result: list[Any] = []
    wall, cpu = timed(lambda: result.append(run.run()))
    shard = run._shards[0]
    dt = float(shard.world.time.substep / shard.clock.inner_steps.numpy()[0])
    drop = -float(result[0].deformables["sheet"].points[0, -1, :, 2].min())
    return Row(name, 2 * divisions**2, worlds, dt, seconds, wall, cpu, drop)


def newton_row(kind: str, divisions: int, worlds: int, seconds: float, explicit_dt: float) -> Row:
    """Newton's solver `kind`; the sheets of all worlds side by side in one model, steps in a captured graph."""
    import newton

    cell = SIZE / divisions
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, -GRAVITY))
    shear = STRETCH / (2.0 * (1.0 + POISSON))
    material = {"tri_ke": shear, "tri_ka": STRETCH * POISSON / (1.0 - POISSON**2), "tri_kd": 0.0}
    for w in range(worlds):
        builder.add_cloth_grid(
            pos=wp.vec3(0.0, 2.0 * w, 0.0),
            rot=wp.quat_identity(),
            vel=wp.vec3(0.0),
            dim_x=divisions,
            dim_y=divisions,
            cell_x=cell,
            cell_y=cell,
            mass=AREAL_DENSITY * cell**2,
            tri_drag=0.0,
            tri_lift=0.0,
            edge_ke=PLATE,
            edge_kd=0.0,
            particle_radius=0.5 * THICKNESS,
            **material,
        )
    count = (divisions + 1) ** 2
    flags, mass = builder.particle_flags, builder.particle_mass
    for w in range(worlds):
        for corner in (0, divisions * (divisions + 1)):
            mass[w * count + corner] = 0.0
            flags[w * count + corner] = int(flags[w * count + corner]) & ~int(newton.ParticleFlags.ACTIVE)
    if kind == "VBD":
        builder.color(include_bending=True)
    with wp.ScopedDevice("cpu"):
        model = builder.finalize(device="cpu")
        model.particle_grid = None  # no contact between particles, nor, below, of particles with triangles
        solver = {
            "SemiImplicit": lambda: newton.solvers.SolverSemiImplicit(model=model, enable_tri_contact=False),
            "VBD": lambda: newton.solvers.SolverVBD(model=model, iterations=10),
        }[kind]()
        dt = explicit_dt if kind == "SemiImplicit" else 1.0 / 600.0
        states = [model.state(), model.state()]
        control = model.control()
        contacts = newton.CollisionPipeline(model).contacts()

        def two_steps() -> None:
            for a, b in ((0, 1), (1, 0)):
                states[a].clear_forces()
                solver.step(states[a], states[b], control, contacts, dt)

        two_steps()
        with wp.ScopedCapture(device="cpu") as capture:
            two_steps()
        pairs = max(1, round(seconds / dt / 2) - 1)

        def run() -> None:
            for _ in range(pairs):
                wp.capture_launch(capture.graph)

        wall, cpu = timed(run)
        drop = -float(states[0].particle_q.numpy()[:count, 2].min())
    return Row(f"Newton {newton.__version__} {kind}", 2 * divisions**2, worlds, dt, 2 * pairs * dt, wall, cpu, drop)


def mujoco_row(divisions: int, worlds: int, seconds: float) -> Row:
    """MuJoCo's dim-2 flex; worlds one after the other on all cores."""
    import mujoco
    import mujoco.rollout

    dt, n = 0.25e-3, divisions + 1
    spacing = SIZE / divisions
    model = mujoco.MjModel.from_xml_string(
        f"""
        <mujoco>
          <option timestep="{dt}" gravity="0 0 -{GRAVITY}"/>
          <size memory="2G"/>
          <worldbody>
            <flexcomp name="sheet" type="grid" dim="2" count="{n} {n} 1" spacing="{spacing} {spacing} {spacing}"
                      mass="{AREAL_DENSITY * SIZE**2}" radius="{0.5 * THICKNESS}">
              <elasticity young="{STRETCH / THICKNESS}" poisson="{POISSON}" thickness="{THICKNESS}" elastic2d="both"/>
              <contact selfcollide="none" contype="0" conaffinity="0"/>
              <pin id="0 {divisions}"/>
            </flexcomp>
          </worldbody>
        </mujoco>"""
    )
    data = [mujoco.MjData(model) for _ in range(min(THREADS, worlds))]
    start = np.zeros((worlds, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS.value)))
    mujoco.mj_getState(model, data[0], start[0], mujoco.mjtState.mjSTATE_FULLPHYSICS.value)
    start[:] = start[0]
    steps = round(seconds / dt)
    pool = mujoco.rollout.Rollout(nthread=THREADS if worlds > 1 else 0)
    pool.rollout(model, data, start, nstep=2)
    wall, cpu = timed(lambda: pool.rollout(model, data, start, nstep=steps))
    drop = -float(data[0].flexvert_xpos[:, 2].min())
    return Row(f"MuJoCo {mujoco.__version__} flex", 2 * divisions**2, worlds, dt, steps * dt, wall, cpu, drop)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=0.5, help="simulated seconds of one world")
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--divisions", type=int, default=50)
    args = parser.parse_args()
    n, seconds = args.divisions, args.seconds
    many = seconds / 20  # so that many worlds take a patient minute
    print(header("tris", "drop m"))
    first = polyworld_row("PolyWorld", n, 1, seconds)
    print(first.text(), flush=True)
    rows: list[tuple[str, Callable[[], Row]]] = [
        (
            "PolyWorld, stretch damping 5 ms",
            lambda: polyworld_row("PolyWorld, stretch damping 5 ms", n, 1, seconds, stretch_damping=0.005),
        ),
        ("PolyWorld", lambda: polyworld_row("PolyWorld", n, args.worlds, many)),
        *(
            (f"Newton {kind}", lambda kind=kind, w=w, s=s: newton_row(kind, n, w, s, first.dt))
            for w, s in ((1, seconds), (args.worlds, many))
            for kind in ("SemiImplicit", "VBD")
        ),
        ("MuJoCo flex", lambda: mujoco_row(n, 1, min(seconds, 0.5))),
        ("MuJoCo flex", lambda: mujoco_row(n, args.worlds, many / 10)),
    ]
    print_rows(rows)
    print(DIFFERENCES, file=sys.stderr)


if __name__ == "__main__":
    main()
