"""The forward model beside MuJoCo: speed on the six-body scene, accuracy on cases with known answers.

    python -m tests.benchmarks.forward [--json] [--repeat N]

Every figure is measured in the run that prints it, all engines on the same cores, repetitions interleaved.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np

from polyworld.solver.rollout import simulator
from polyworld.world import Environment, MotionPlane, StaticObject, TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Plane, Sphere
from tests.scenes.six_bodies import DURATION, SUBSTEP, initial_velocities, six_body_mjcf, six_body_world

GRAVITY = 9.81  # [m/s^2]
STEPS = round(DURATION / SUBSTEP)
THREADS = len(os.sched_getaffinity(0))
ENGINES = ("planar", "spatial", "mujoco")
FLOOR = StaticObject(name="floor", shape=Plane())
CUBE = Box(half_extents=(0.1, 0.1, 0.1))
DIFFERENCES = (
    "MuJoCo: default solver and contact parameters, elliptic cone, float64; no coefficient of restitution "
    "(bounce: direct solref, stiffness 1e5 1/s^2, the damping ratio of a half oscillation that returns e). "
    "planar: objects slide in the plane with a 2-D footprint; no rolling of balls, no height."
)


# --- speed -------------------------------------------------------------------------------------


def engine_runs(n_worlds: int) -> dict[str, Callable[[], None]]:
    """Return one call a rollout of the six-body scene over n_worlds, buffers and models made before."""
    times = np.arange(0.0, DURATION + 1e-9, 0.04)
    runs: dict[str, Callable[[], None]] = {}
    for name in ("planar", "spatial"):
        sim = simulator(six_body_world(planar=name == "planar"), times, n_worlds=n_worlds, threads=THREADS)
        runs[name] = lambda sim=sim: sim.run() and None
    model = mujoco.MjModel.from_xml_string(six_body_mjcf())
    start = np.tile(_mujoco_start(model), (n_worlds, 1))
    workers = [mujoco.MjData(model) for _ in range(min(THREADS, n_worlds))]
    pool = mujoco.rollout.Rollout(nthread=THREADS if n_worlds > 1 else 0)
    runs["mujoco"] = lambda: pool.rollout(model, workers, start, nstep=STEPS) and None
    return runs


def _mujoco_start(model: mujoco.MjModel) -> np.ndarray:
    data = mujoco.MjData(model)
    for i, (u, v) in enumerate(initial_velocities()):
        data.qvel[6 * i : 6 * i + 2] = u, v
    mujoco.mj_forward(model, data)
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    return state


def measure_speed(n_worlds: int, repeat: int) -> dict[str, dict[str, float]]:
    """Median wall and CPU seconds of a rollout by engine; repetitions of the engines alternate."""
    runs = engine_runs(n_worlds)
    wall: dict[str, list[float]] = {name: [] for name in ENGINES}
    cpu: dict[str, list[float]] = {name: [] for name in ENGINES}
    for run in runs.values():
        run()
    for _ in range(repeat):
        for name in ENGINES:
            w, c = time.perf_counter(), time.process_time()
            runs[name]()
            wall[name].append(time.perf_counter() - w)
            cpu[name].append(time.process_time() - c)
    return {
        name: {
            "wall_s": statistics.median(wall[name]),
            "cpu_s": statistics.median(cpu[name]),
            "cpu_us_per_world_step": statistics.median(cpu[name]) / (n_worlds * STEPS) * 1e6,
        }
        for name in ENGINES
    }


def first_rollout(planar: bool) -> dict[str, float]:
    """Wall and CPU seconds of a new process with an empty kernel cache, from its start to its first rollout's end."""
    code = (
        "import numpy as np;from polyworld.solver.rollout import simulator;"
        "from tests.scenes.six_bodies import six_body_world;"
        f"simulator(six_body_world(planar={planar}), np.arange(0, {DURATION} + 1e-9, 0.04), threads=1).run()"
    )
    with tempfile.TemporaryDirectory() as cache:
        begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ, "WARP_CACHE_PATH": cache})
        wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    return {"wall_s": wall, "cpu_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime}


# --- accuracy ----------------------------------------------------------------------------------


def _run(item: RigidObject | tuple[RigidObject, ...], statics: tuple[StaticObject, ...], **fields: Any) -> Any:
    duration, count = fields.pop("duration"), fields.pop("count", 201)
    substep = fields.pop("substep", SUBSTEP)
    objects = item if isinstance(item, tuple) else (item,)
    world = World(objects=objects, statics=statics, environment=Environment(**fields), time=TimeBase(substep=substep))
    return simulator(world, np.linspace(0.0, duration, count), threads=1).run()


def _object(planar: bool, shape: Any, **fields: Any) -> RigidObject:
    fields.setdefault("name", "b")
    return RigidObject(representation="rigid_planar" if planar else "rigid_spatial", shape=shape, mass=1.0, **fields)


def slide_length(planar: bool) -> float:
    """Return a cube with 2 m/s and mu = 0.2 [m]; exact v^2 / 2 mu g."""
    item = _object(planar, CUBE, position=(0, 0, 0.1), velocity=(2, 0, 0), friction=0.2)
    return float(_run(item, (FLOOR,), duration=2.0).positions[0, -1, 0, 0])


def creep(planar: bool) -> float:
    """Displacement in 2 s of a cube at 0.9 of the critical slope, mu = 0.5 [m]; exact 0."""
    angle = np.arctan(0.9 * 0.5)
    normal = (float(np.sin(angle)), 0.0, float(np.cos(angle)))
    q = (float(np.cos(angle / 2)), 0.0, float(np.sin(angle / 2)), 0.0)
    item = _object(planar, CUBE, position=tuple(0.1 * x for x in normal), orientation=q, friction=0.5)
    statics = () if planar else (StaticObject(name="slope", shape=Plane(normal=normal)),)
    out = _run(item, statics, duration=2.0, motion_plane=MotionPlane(normal=normal))
    return float(np.linalg.norm(out.positions[0, -1, 0] - out.positions[0, 0, 0]))


def bounce_apex(planar: bool, substep: float) -> float:
    """Height of the first rebound from 1 m with e = 0.8 [m]; exact 0.64."""
    item = _object(planar, Sphere(radius=0.1), position=(0, 0, 1.1), restitution=0.8)
    plane = MotionPlane(normal=(0, 1, 0), supports=False)
    out = _run(item, (FLOOR,), duration=1.1, count=1101, substep=substep, motion_plane=plane)
    height = out.positions[0, :, 0, 2] - 0.1
    return float(height[out.times[0] > 0.5].max())


# Three balls and three cubes in free space that run into each other [m, m/s].
_CLOUD = (
    ((-1.0, 0.02, 0.1), (1.0, 0.0, 0.0)),
    ((1.0, 0.1, 0.1), (-1.0, 0.0, 0.0)),
    ((0.0, -1.0, 0.1), (0.0, 1.0, 0.0)),
    ((0.05, 1.0, 0.1), (0.0, -0.9, 0.0)),
    ((-0.8, -0.7, 0.1), (0.8, 0.8, 0.0)),
    ((0.8, 0.9, 0.1), (-0.7, -0.8, 0.0)),
)


def momentum_drift(planar: bool) -> float:
    """Largest change of the momentum of six colliding bodies without gravity, over the sum of |m v| [1]; exact 0."""
    items = tuple(
        _object(
            planar,
            Sphere(radius=0.1) if k % 2 else CUBE,
            name=f"b{k}",
            position=x,
            velocity=v,
            friction=0.3,
            restitution=0.5,
        )
        for k, (x, v) in enumerate(_CLOUD)
    )
    out = _run(items, (), duration=3.0, gravity=(0, 0, 0))
    return _drift(out.velocities[0])


def _drift(velocities: np.ndarray) -> float:
    total = velocities.sum(axis=1)
    return float(np.abs(total - total[0]).max() / np.linalg.norm(velocities[0], axis=1).sum())


def _mjcf(geoms: str, *, gravity: str = "0 0 -9.81", substep: float = SUBSTEP) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{substep}" gravity="{gravity}" cone="elliptic"/>'
        f"<worldbody>{geoms}</worldbody></mujoco>"
    )


def mujoco_accuracy() -> dict[str, float]:
    """Return the same cases by MuJoCo."""
    cube = '<body pos="{}"><freejoint/><geom type="box" size=".1 .1 .1" mass="1" friction="{} 0 0" condim="3"/></body>'
    floor = '<geom type="plane" size="9 9 1" friction="{} 0 0"/>'
    model = _mjcf(floor.format(0.2) + cube.format("0 0 .1", 0.2))
    data = mujoco.MjData(model)
    data.qvel[0] = 2.0
    while data.time < 2.0:
        mujoco.mj_step(model, data)
    slide = float(data.qpos[0])
    angle = np.arctan(0.45)
    # The slope is made by turning gravity.
    down = f"{GRAVITY * np.sin(angle)} 0 {-GRAVITY * np.cos(angle)}"
    model = _mjcf(floor.format(0.5) + cube.format("0 0 .1", 0.5), gravity=down)
    data = mujoco.MjData(model)
    while data.time < 2.0:
        mujoco.mj_step(model, data)
    creeping = float(np.linalg.norm(data.qpos[:3] - [0, 0, 0.1]))
    apexes = {}
    # A damped oscillator returns e after half a period at this damping ratio; stiff, so that the contact is short.
    ratio = -np.log(0.8) / np.hypot(np.pi, np.log(0.8))
    stiffness = 1e5
    for substep in (0.002, 0.005):
        solref = f'solref="{-stiffness:g} {-2 * ratio * np.sqrt(stiffness):.6g}"'
        model = _mjcf(
            f'<geom type="plane" size="9 9 1" {solref}/><body pos="0 0 1.1"><freejoint/>'
            f'<geom type="sphere" size=".1" mass="1" {solref}/></body>',
            substep=substep,
        )
        data = mujoco.MjData(model)
        heights = []
        while data.time < 1.1:
            mujoco.mj_step(model, data)
            heights.append((data.time, data.qpos[2] - 0.1))
        apexes[substep] = max(h for t, h in heights if t > 0.55)
    bodies = "".join(
        '<body pos="{} {} {}"><freejoint/>'.format(*x)
        + f'<geom type="{"sphere" if k % 2 else "box"}" size=".1 .1 .1" mass="1" friction=".3 0 0"/></body>'
        for k, (x, _) in enumerate(_CLOUD)
    )
    model = _mjcf(bodies, gravity="0 0 0")
    data = mujoco.MjData(model)
    for k, (_, v) in enumerate(_CLOUD):
        data.qvel[6 * k : 6 * k + 3] = v
    velocities = [data.qvel.reshape(-1, 6)[:, :3].copy()]
    while data.time < 3.0:
        mujoco.mj_step(model, data)
        velocities.append(data.qvel.reshape(-1, 6)[:, :3].copy())
    return {
        "slide_m": slide,
        "creep_m": creeping,
        "apex_2ms_m": apexes[0.002],
        "apex_5ms_m": apexes[0.005],
        "momentum_drift": _drift(np.array(velocities)),
    }


def accuracy() -> dict[str, dict[str, float]]:
    """Return each engine's answers to the cases, and the exact ones."""
    result = {
        name: {
            "slide_m": slide_length(planar),
            "creep_m": creep(planar),
            "apex_2ms_m": bounce_apex(planar, 0.002),
            "apex_5ms_m": bounce_apex(planar, 0.005),
            "momentum_drift": momentum_drift(planar),
        }
        for name, planar in (("planar", True), ("spatial", False))
    }
    result["mujoco"] = mujoco_accuracy()
    exact = {"slide_m": 4 / (2 * 0.2 * GRAVITY), "creep_m": 0.0, "apex_2ms_m": 0.64, "apex_5ms_m": 0.64}
    result["exact"] = {**exact, "momentum_drift": 0.0}
    return result


# --- report ------------------------------------------------------------------------------------


def measure(repeat: int) -> dict[str, Any]:
    """Return everything, as JSON-ready values."""
    first = {name: first_rollout(name == "planar") for name in ("planar", "spatial")}
    speed = {str(n): measure_speed(n, repeat) for n in (1, 64)}
    ratio = {
        n: {name: values["mujoco"]["wall_s"] / values[name]["wall_s"] for name in ("planar", "spatial")}
        for n, values in speed.items()
    }
    return {
        "scene": f"six bodies, {DURATION} s, {STEPS} steps of {SUBSTEP} s",
        "threads": THREADS,
        "mujoco": mujoco.__version__,
        "repeat": repeat,
        "speed": speed,
        "times_as_fast_as_mujoco": ratio,
        "first_rollout_cold_s": first,
        "accuracy": accuracy(),
        "differences": DIFFERENCES,
    }


def table(report: dict[str, Any]) -> str:
    """Return the report as text."""
    lines = [
        f"{report['scene']}; {report['threads']} threads; MuJoCo {report['mujoco']}; median of {report['repeat']}",
        f"{'engine':9}{'1 world':>12}{'x MuJoCo':>10}{'64 worlds':>12}{'x MuJoCo':>10}{'CPU us/step':>13}"
        f"{'cold start, CPU':>20}",
    ]
    for name in ENGINES:
        one, many = report["speed"]["1"][name], report["speed"]["64"][name]
        ratios = [report["times_as_fast_as_mujoco"][n].get(name, 1.0) for n in ("1", "64")]
        cold = report["first_rollout_cold_s"].get(name)
        lines.append(
            f"{name:9}{one['wall_s']:10.4f} s{ratios[0]:10.2f}{many['wall_s']:10.4f} s{ratios[1]:10.2f}"
            f"{many['cpu_us_per_world_step']:13.3f}"
            + (f"{cold['wall_s']:10.2f} s {cold['cpu_s']:6.2f} s" if cold is not None else f"{'-':>20}")
        )
    lines += ["", f"{'engine':9}{'slide':>10}{'creep 2 s':>12}{'apex 2 ms':>11}{'apex 5 ms':>11}{'momentum drift':>16}"]
    for name in ("exact", *ENGINES):
        a = report["accuracy"][name]
        lines.append(
            f"{name:9}{a['slide_m']:8.4f} m{a['creep_m'] * 1e3:9.5f} mm{a['apex_2ms_m']:9.4f} m{a['apex_5ms_m']:9.4f} m"
            f"{a['momentum_drift']:16.1e}"
        )
    return "\n".join([*lines, "", report["differences"]])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--json", action="store_true", help="print JSON in place of the table")
    parser.add_argument("--repeat", type=int, default=5, help="repetitions of every timing")
    arguments = parser.parse_args()
    report = measure(arguments.repeat)
    print(json.dumps(report, indent=2) if arguments.json else table(report))


if __name__ == "__main__":
    main()
