"""A world moves alike on every device, and where NumPy cannot use the device's memory."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator

import numpy as np
import pytest
import warp as wp

from polyworld.core import buffers
from polyworld.core.warp_settings import NO_DRIVER, without_driver_warning
from polyworld.estimation.fit import FitOptions, fit
from polyworld.estimation.study import Study
from polyworld.solver.rollout import simulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World
from tests.polyworld.estimation import pucks
from tests.polyworld.solver import test_batches as materials
from tests.scenes.six_bodies import six_body_world

TIMES = np.array([0.0, 0.02, 0.04])
ACCELERATORS = [d.alias for d in wp.get_devices() if not d.is_cpu]
SHARED: dict[str, Callable[[], World]] = {
    made.__name__: made for made in (materials.rope, materials.cloth, materials.soft, materials.fluid)
}
RUN_ON_CUDA = ("planar", "spatial")
WORLDS: dict[str, Callable[[], World]] = {
    "planar": lambda: six_body_world(planar=True),
    "spatial": lambda: six_body_world(planar=False),
    **SHARED,
}


def motion(world: World, n_worlds: int = 1) -> BatchTrajectory:
    return simulator(world, TIMES, n_worlds=n_worlds, record_events=True).run()


def content(found: BatchTrajectory) -> bytes:
    arrays = [found.positions, found.orientations, found.velocities, found.angular_velocities]
    for points in found.deformables.values():
        arrays += [points.points, points.velocities, *points.quantities.values()]
    return b"".join(values.tobytes() for values in arrays) + repr(found.events).encode()


@pytest.fixture
def accelerator() -> Iterator[str]:
    if not ACCELERATORS:
        pytest.skip(f"Warp finds no device but {', '.join(d.alias for d in wp.get_devices())}")
    buffers.use_device(ACCELERATORS[0])
    yield ACCELERATORS[0]
    buffers.use_device("cpu")


@pytest.mark.parametrize("name", WORLDS)
def test_motion_does_not_depend_on_whether_memory_is_shared_with_numpy(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = WORLDS[name]()
    shared = content(motion(world))
    with monkeypatch.context() as patch:
        patch.setattr(buffers, "on_host", lambda _: False)
        copied = content(motion(world))
    assert copied == shared


@pytest.mark.parametrize("name", RUN_ON_CUDA)
def test_worlds_move_on_an_accelerator_as_on_the_cpu(name: str, accelerator: str) -> None:
    world = WORLDS[name]()
    there = motion(world, 3)
    buffers.use_device("cpu")
    here = motion(world, 3)
    assert accelerator != "cpu"
    np.testing.assert_allclose(there.positions, here.positions, atol=1e-9)
    np.testing.assert_allclose(there.velocities, here.velocities, atol=1e-7)


@pytest.mark.parametrize("name", SHARED)
def test_liquids_and_other_materials_stay_on_the_cpu(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(buffers, "_chosen", None)  # a device on which nothing can be made
    assert not motion(WORLDS[name]()).diverged.any()


@pytest.mark.parametrize(("device", "warned"), [("cpu", False), ("cuda", True)])
def test_the_missing_driver_is_mentioned_where_a_gpu_was_asked_for(device: str, warned: bool) -> None:
    if ACCELERATORS:
        pytest.skip("this machine has a driver")
    environment = {**os.environ, buffers.VARIABLE: device}
    program = "import polyworld.core.buffers"
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False)
    assert ("CUDA driver" in done.stderr) == warned
    assert ("no device 'cuda'" in done.stderr) == warned


def test_all_else_that_is_written_while_warp_starts_is_passed_on(capfd: pytest.CaptureFixture[str]) -> None:
    with without_driver_warning():
        os.write(2, NO_DRIVER + b". GPU execution will not be available.\nan error\n")
    assert capfd.readouterr().err == "an error\n"


def test_batches_fit_on_an_accelerator_as_on_the_cpu(accelerator: str) -> None:
    options = FitOptions(share=0.0)
    assert accelerator != "cpu"
    study = Study((pucks.clip(pucks.discs([0.1, 0.2]), pucks.CROSSING, 30),))
    there = fit(study, options)
    buffers.use_device("cpu")
    here = fit(study, options)
    assert [c.value for c in there.constants] == pytest.approx([c.value for c in here.constants], rel=1e-6)


def test_a_device_that_is_not_there_is_refused_with_those_that_are() -> None:
    with pytest.raises(ValueError, match=r"no device 'tpu'; this machine has cpu"):
        buffers.use_device("tpu")
    assert buffers.device().alias == "cpu"
