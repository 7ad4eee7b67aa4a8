"""Arrays, launches and captures of Warp, all on the device in use.

The device is chosen here and nowhere else: `use_device`, or the environment variable POLYWORLD_DEVICE; default the CPU.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from pathlib import Path
from typing import Any
from weakref import WeakSet

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core.capture_lock import CaptureLock
from polyworld.core.compile_lock import one_process_at_a_time
from polyworld.core.warp_settings import without_driver_warning

Shape = int | tuple[int, ...]
LOCK = CaptureLock()
THREADS_PER_BLOCK = 64  # on CUDA: a thread is a world, and small blocks spread few worlds over more multiprocessors
VARIABLE = "POLYWORLD_DEVICE"  # of the environment: the device to begin with
with without_driver_warning() if os.environ.get(VARIABLE, "cpu") == "cpu" else nullcontext():
    _chosen: Any = wp.get_device("cpu")  # starts Warp
_OVERRIDE: ContextVar[Any] = ContextVar("device", default=None)


def device() -> Any:
    """Return the device that arrays are made on and kernels run on."""
    return _OVERRIDE.get() or _chosen


def use_device(name: str) -> None:
    """Choose the device of all that is made from now on: "cpu", or "cuda", "cuda:0", ... where Warp finds such.

    Simulators made before belong to the device used then. Raises ValueError for a device that is not there.
    """
    global _chosen
    there = [d.alias for d in wp.get_devices()]
    valid = [*there, "cuda"] if "cuda:0" in there else there
    if name not in valid:
        raise ValueError(f"no device {name!r}; this machine has {', '.join(valid)}")
    _chosen = wp.get_device(name)


@contextmanager
def on_cpu() -> Iterator[None]:
    """Make arrays and run kernels on the CPU in this context, whatever device is chosen."""
    token = _OVERRIDE.set(wp.get_device("cpu"))
    try:
        yield
    finally:
        _OVERRIDE.reset(token)


def threads_serve() -> bool:
    """Return whether several launches at once use more of the device than one does: on a CPU each takes one core."""
    return bool(device().is_cpu)


def on_host(values: Any) -> bool:
    """Return whether NumPy can use an array's memory as it is."""
    return bool(values.device.is_cpu)


def running() -> AbstractContextManager[None]:
    """Return what to hold while Warp is called otherwise than through this module."""
    return LOCK.shared()


def array(values: Any, dtype: Any) -> Any:
    """Return an array that holds `values`."""
    with LOCK.shared():
        return wp.array(values, dtype=dtype, device=device())


def ints(values: Any) -> Any:
    """Return an array of 32-bit integers that holds `values`."""
    return array(np.asarray(values, dtype=np.int32), wp.int32)


def doubles(values: Any) -> Any:
    """Return an array of 64-bit floats that holds `values`."""
    return array(np.asarray(values, dtype=np.float64), wp.float64)


def zeros(shape: Shape, dtype: Any) -> Any:
    """Return an array of zeros."""
    with LOCK.shared():
        return wp.zeros(shape, dtype=dtype, device=device())


def per_world(shape: tuple[int, ...], dtype: Any) -> Any:
    """Return zeros (W, ...), one row a world: each world's values side by side on a CPU, whose threads take one world
    after the other; elsewhere all worlds' values of one element, which neighbouring threads read at the same time."""
    if threads_serve():
        return zeros(shape, dtype)
    return zeros((*shape[1:], shape[0]), dtype).transpose((len(shape) - 1, *range(len(shape) - 1)))


def full(shape: Shape, value: Any, dtype: Any) -> Any:
    """Return an array that holds `value` everywhere."""
    with LOCK.shared():
        return wp.full(shape, value, dtype=dtype, device=device())


def empty(shape: Shape, dtype: Any) -> Any:
    """Return an array whose values are not set."""
    with LOCK.shared():
        return wp.empty(shape, dtype=dtype, device=device())


def launch(kernel: Any, dim: Any, inputs: list[Any]) -> None:
    """Launch a kernel over `dim` threads."""
    with LOCK.shared():
        wp.launch(kernel, dim=dim, inputs=inputs, device=device(), block_dim=THREADS_PER_BLOCK)


def clear(values: Any) -> None:
    """Set an array to zero."""
    with LOCK.shared():
        values.zero_()


def fill(values: Any, value: Any) -> None:
    """Set an array to `value` everywhere."""
    with LOCK.shared():
        values.fill_(value)


def assign(values: Any, new: Any) -> None:
    """Copy `new` into an array."""
    with LOCK.shared():
        values.assign(new)


def read(values: Any) -> NDArray[Any]:
    """Return an array's values in NumPy, to be read only: its memory where that is the CPU's, else a copy."""
    with LOCK.shared():
        found: NDArray[Any] = values.numpy() if on_host(values) else values.numpy().copy()
    return found


def write(values: Any, new: Any, where: Any = ...) -> None:
    """Copy `new` into an array, or into the part `where` of it, a NumPy index; both broadcast as in NumPy."""
    with LOCK.shared():
        if on_host(values):
            values.numpy()[where] = new
            return
        content = values.numpy().copy()
        content[where] = new
        values.assign(content)


def copy(source: Any, target: Any, start: int, at: int, count: int) -> None:
    """Copy `count` elements of an array (N,), from `start` on, to another from `at` on."""
    if count:
        with LOCK.shared():
            wp.copy(target, source, at, start, count)


def write_bytes(values: Any, content: Any) -> None:
    """Copy a ctypes structure into the memory of an array of one."""
    size = ctypes.sizeof(content)
    if on_host(values):
        ctypes.memmove(values.ptr, ctypes.addressof(content), size)
        return
    with LOCK.shared():
        there: Any = wp.array(ptr=values.ptr, dtype=wp.uint8, shape=size, device=values.device)
        wp.copy(there, wp.array(ptr=ctypes.addressof(content), dtype=wp.uint8, shape=size, device="cpu"))
        wp.synchronize_device(values.device)


class Mirror:
    """An array's values in NumPy, looked up once: the array's own memory on the CPU, a copy of it elsewhere.

    values: to be read after `pull` and written before `push`, both of which do nothing on the CPU.
    """

    def __init__(self, array: Any) -> None:
        self._array = array
        with LOCK.shared():
            self._host: Any = array if on_host(array) else wp.clone(array, device="cpu")
            self.values: NDArray[Any] = self._host.numpy()

    def pull(self) -> NDArray[Any]:
        """Take the array's values from its device, and return them."""
        self._copy(self._array, self._host)
        return self.values

    def push(self) -> None:
        """Give the array the values."""
        self._copy(self._host, self._array)

    def _copy(self, source: Any, target: Any) -> None:
        if source is not target:
            with LOCK.shared():
                wp.copy(target, source)
                wp.synchronize_device(device())


@contextmanager
def capture() -> Iterator[wp.ScopedCapture]:
    """Record the launches of this thread as a graph, the `graph` of what is yielded.

    Warp records whatever any thread does meanwhile, so the others wait.
    """
    with LOCK.exclusive(), wp.ScopedCapture(device=device()) as captured:
        yield captured


def replay(graph: Any) -> None:
    """Run the launches that a graph has recorded."""
    with LOCK.shared():
        wp.capture_launch(graph)


_loaded: WeakSet[Any] = WeakSet()  # modules that need no lock any more


def load_kernel(kernel: Any) -> None:
    """Compile and load a kernel's module, before threads ask for it at the same time."""
    with LOCK.shared(), _compiling([kernel.module]):
        chosen = device()
        kernel.module.load(chosen, block_dim=1 if chosen.is_cpu else THREADS_PER_BLOCK)


def load(modules: Iterable[Any], workers: int) -> None:
    """Compile and load modules of kernels, `workers` at a time."""
    listed = list(modules)
    with _compiling(listed):
        wp.force_load(device=device(), modules=listed, max_workers=workers)


@contextmanager
def _compiling(modules: Iterable[Any]) -> Iterator[None]:
    """Let one process at a time load modules that are new to this one: the next finds them compiled."""
    new = [m for m in modules if m not in _loaded]
    if not new:
        yield
        return
    with one_process_at_a_time(Path(wp.config.kernel_cache_dir or ""), [m.name for m in new]):
        yield
    _loaded.update(new)


if VARIABLE in os.environ:
    use_device(os.environ[VARIABLE])
