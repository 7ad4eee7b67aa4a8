"""Speed of soft bodies beside Newton and MuJoCo: a clamped block that sags under its weight.

    python -m tests.benchmarks.soft_speed [--seconds S] [--worlds N]

Every figure is measured in the run that prints it. All engines have nodes in the same places: PolyWorld as quadratic
tetrahedra, the others as linear ones. Engines whose package is not installed, or that fail, have
a row that says why.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from polyworld import World, simulator
from polyworld.model import mesh_of
from polyworld.model.soft import soft_form
from polyworld.world.representations.soft import Soft
from tests.benchmarks.speed_rows import THREADS, Row, header, print_rows, timed

SIZE, SPACING = (0.6, 0.2, 0.2), 0.05  # of the block, and of its nodes [m]
NODES = tuple(round(a / SPACING) + 1 for a in SIZE)
E, NU, DENSITY, GRAVITY = 1e6, 0.3, 1000.0, 9.81
DIFFERENCES = (
    "PolyWorld: 10-node tetrahedra, float64, step from the stiffness. Newton: linear tetrahedra, float32; "
    "SemiImplicit at our inner step, VBD at 1/600 s with 10 iterations, which may not be enough to converge. MuJoCo: "
    "dim-3 flex of linear tetrahedra, float64, its discrete integrator, at 0.5 ms. 'sag': how far the free end has "
    "come down in the given time; the row 'finer' shows what is right."
)


def scene(resolution: float, **more: Any) -> World:
    """Return the block as a world, its left face held."""
    half = [a / 2 for a in SIZE]
    return World.model_validate(
        {
            "deformables": [
                {
                    "name": "block",
                    "representation": "soft",
                    "shape": {"kind": "box", "half_extents": half},
                    "position": (half[0], 0.0, 0.0),
                    "resolution": resolution,
                    "youngs_modulus": E,
                    "poisson_ratio": NU,
                    "density": DENSITY,
                    **more,
                }
            ],
            "attachments": [
                {"name": "clamp", "object": "block", "region": {"lower": (-1e-6, -1, -1), "upper": (1e-6, 1, 1)}}
            ],
            "environment": {"gravity": (0, 0, -GRAVITY)},
        }
    )


def polyworld_row(name: str, worlds: int, seconds: float, resolution: float = 2 * SPACING, **more: Any) -> Row:
    """Whole rollouts, buffers and kernels made before."""
    world = scene(resolution, **more)
    block = world.deformables[0]
    assert isinstance(block, Soft)
    form = soft_form(world, block)
    run: Any = simulator(world, np.array([seconds / 10, seconds]), n_worlds=worlds, threads=THREADS)
    run.run(samples=1)
    result: list[Any] = []
    wall, cpu = timed(lambda: result.append(run.run()))
    shard = run._shards[0]
    dt = float(shard.world.time.substep / shard.clock.inner_steps.numpy()[0])
    sag = _sag(result[0].deformables["block"].points[0, -1], mesh_of(world, block).nodes)
    return Row(name, len(form.elements), worlds, dt, seconds, wall, cpu, sag)


def _sag(points: Any, start: Any) -> float:
    """Return how far the free end's nodes have come down on average."""
    end = start[:, 0] > start[:, 0].max() - 0.1 * SPACING
    return float((start[end, 2] - points[end, 2]).mean())


def newton_row(kind: str, worlds: int, seconds: float, explicit_dt: float) -> Row:
    """Newton's solver `kind`; the blocks of all worlds side by side in one model, steps in a captured graph."""
    import newton

    cells = [n - 1 for n in NODES]
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, -GRAVITY))
    for w in range(worlds):
        builder.add_soft_grid(
            pos=wp.vec3(0.0, 1.0 * w - SIZE[1] / 2, -SIZE[2] / 2),
            rot=wp.quat_identity(),
            vel=wp.vec3(0.0),
            dim_x=cells[0],
            dim_y=cells[1],
            dim_z=cells[2],
            cell_x=SPACING,
            cell_y=SPACING,
            cell_z=SPACING,
            density=DENSITY,
            k_mu=E / (2 * (1 + NU)),
            k_lambda=E * NU / ((1 + NU) * (1 - 2 * NU)),
            k_damp=0.0,
            fix_left=True,
            particle_radius=0.001,
        )
    if kind == "VBD":
        builder.color()
    with wp.ScopedDevice("cpu"):
        model = builder.finalize(device="cpu")
        solvers = {
            "SemiImplicit": lambda: newton.solvers.SolverSemiImplicit(model=model),
            "VBD": lambda: newton.solvers.SolverVBD(model=model, iterations=10),
        }
        solver = solvers[kind]()
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
        count = int(np.prod(NODES))
        sag = _sag(states[0].particle_q.numpy()[:count], model.particle_q.numpy()[:count])
        elements = model.tet_count // worlds
    return Row(f"Newton {newton.__version__} {kind}", elements, worlds, dt, 2 * pairs * dt, wall, cpu, sag)


def mujoco_row(worlds: int, seconds: float) -> Row:
    """MuJoCo's dim-3 flex; worlds one after the other on all cores."""
    import mujoco
    import mujoco.rollout

    dt = 0.5e-3
    held = " ".join(str(i) for i in range(NODES[1] * NODES[2]))
    model = mujoco.MjModel.from_xml_string(
        f"""
        <mujoco>
          <option timestep="{dt}" gravity="0 0 -{GRAVITY}" integrator="discrete"/>
          <size memory="2G"/>
          <worldbody>
            <flexcomp name="block" type="grid" dim="3" count="{NODES[0]} {NODES[1]} {NODES[2]}"
                      mass="{np.prod(SIZE) * DENSITY}"
                      spacing="{SPACING} {SPACING} {SPACING}" pos="{SIZE[0] / 2} 0 0" radius="0.001">
              <elasticity young="{E}" poisson="{NU}"/>
              <contact selfcollide="none" contype="0" conaffinity="0"/>
              <pin id="{held}"/>
            </flexcomp>
          </worldbody>
        </mujoco>"""
    )
    data = [mujoco.MjData(model) for _ in range(min(THREADS, worlds))]
    mujoco.mj_forward(model, data[0])
    before = data[0].flexvert_xpos.copy()
    start = np.zeros((worlds, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS.value)))
    mujoco.mj_getState(model, data[0], start[0], mujoco.mjtState.mjSTATE_FULLPHYSICS.value)
    start[:] = start[0]
    steps = round(seconds / dt)
    pool = mujoco.rollout.Rollout(nthread=THREADS if worlds > 1 else 0)
    pool.rollout(model, data, start, nstep=2)
    wall, cpu = timed(lambda: pool.rollout(model, data, start, nstep=steps))
    elements = int(model.flex_elemnum[0])
    sag = _sag(data[0].flexvert_xpos, before)
    return Row(f"MuJoCo {mujoco.__version__} flex", elements, worlds, dt, steps * dt, wall, cpu, sag)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--seconds", type=float, default=0.18, help="simulated seconds of one world; in 0.18 s the end sinks lowest"
    )
    parser.add_argument("--worlds", type=int, default=64, help="in one batch; many take Newton minutes")
    args = parser.parse_args()
    seconds, many = args.seconds, args.seconds / 10
    print(f"{int(np.prod(NODES))} nodes\n{header('tets', 'sag m')}")
    first = polyworld_row("PolyWorld", 1, seconds)
    print(first.text(), flush=True)
    rows: list[tuple[str, Callable[[], Row]]] = [
        ("PolyWorld, 3 times finer", lambda: polyworld_row("PolyWorld, 3 times finer", 1, seconds, 2 * SPACING / 3)),
        ("PolyWorld, damping 1 ms", lambda: polyworld_row("PolyWorld, damping 1 ms", 1, seconds, damping=0.001)),
        ("PolyWorld, yields", lambda: polyworld_row("PolyWorld, yields at 10 kPa", 1, seconds, yield_stress=1e4)),
        ("PolyWorld", lambda: polyworld_row("PolyWorld", args.worlds, many)),
        *(
            (f"Newton {kind}", lambda kind=kind, w=w, s=s: newton_row(kind, w, s, first.dt))
            for w, s in ((1, seconds), (args.worlds, many / 10))
            for kind in ("SemiImplicit", "VBD")
        ),
        ("MuJoCo flex", lambda: mujoco_row(1, seconds)),
        ("MuJoCo flex", lambda: mujoco_row(args.worlds, many)),
    ]
    print_rows(rows)
    print(DIFFERENCES, file=sys.stderr)


if __name__ == "__main__":
    main()
