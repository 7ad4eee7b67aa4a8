"""Requirements to run a model: the extra that brings PyTorch, a device, batches, a limit of memory, provenance."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from atw_mcp.models.folders import ModelError, ModelFolder

DEVICE, BATCH, MEMORY = "ATW_MODELS_DEVICE", "ATW_MODELS_BATCH", "ATW_MODELS_MEMORY_GB"
EXTRA = "pip install 'atw-mcp[models]' (torch and transformers)"
# Of activations for each pixel of the input: SAM 2 (hiera-tiny's size, 1024 x 1024, two objects, CPU) peaked at
# 1.49 GB, of which some 0.5 are taken for the process itself and 0.16 are weights. Other networks were not measured.
PIXEL_BYTES = 800


@dataclass(frozen=True)
class Limits:
    """device: "auto" (the first of cuda, mps, cpu there is) or a PyTorch device. batch: frames, or objects of a
    segmentation, computed at once. memory_gb: most memory that weights and work may take; None: no limit."""

    device: str = "auto"
    batch: int = 4
    memory_gb: float | None = None

    @classmethod
    def from_environment(cls) -> Limits:
        """Limits as ATW_MODELS_DEVICE, ATW_MODELS_BATCH and ATW_MODELS_MEMORY_GB set them; raises ModelError."""
        batch, memory = _number(BATCH), _number(MEMORY)
        if batch is not None and (batch < 1 or batch != int(batch)):
            raise ModelError(f"{BATCH} must be a whole number of 1 or more, got {os.environ[BATCH]!r}")
        if memory is not None and memory <= 0:
            raise ModelError(f"{MEMORY} must be a positive number of gigabytes, got {os.environ[MEMORY]!r}")
        return cls(os.environ.get(DEVICE) or "auto", cls.batch if batch is None else int(batch), memory)


def _number(name: str) -> float | None:
    text = os.environ.get(name)
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        raise ModelError(f"{name} must be a number, got {text!r}") from None


def extra(name: str) -> Any:
    """Return the module torch or transformers; raises ModelError saying what to install."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ModelError(f"learned models need {name}, which is not installed: {EXTRA}") from error


def pretrained(model: ModelFolder, class_name: str, device: str) -> Any:
    """Load a transformers model with the weights of a local folder; raises ModelError where they do not fit it."""
    transformers = extra("transformers")
    if not hasattr(transformers, class_name):
        raise ModelError(f"transformers {transformers.__version__} has no {class_name}: {EXTRA}")
    transformers.utils.logging.disable_progress_bar()
    try:
        network, found = getattr(transformers, class_name).from_pretrained(
            str(model.path), local_files_only=True, output_loading_info=True, dtype=extra("torch").float32
        )
    except (OSError, ValueError, RuntimeError, KeyError) as error:
        raise ModelError(f"{model.name}: the weights cannot be loaded: {error}") from error
    if found["missing_keys"]:
        missing = sorted(found["missing_keys"])
        raise ModelError(f"{model.name}: the weights lack {len(missing)} tensors of {class_name}, as {missing[:3]}")
    return network.to(device).eval()


def chosen_device(limits: Limits) -> str:
    """Return the device to run on; raises ModelError where the one asked for is not there."""
    torch = extra("torch")
    there = ["cpu"]
    if torch.backends.mps.is_available():
        there.insert(0, "mps")
    if torch.cuda.is_available():
        there = ["cuda", *(f"cuda:{k}" for k in range(torch.cuda.device_count())), *there]
    if limits.device == "auto":
        return there[0]
    if limits.device not in there:
        raise ModelError(f"{DEVICE}={limits.device!r} is not there; devices: auto, {', '.join(there)}")
    return limits.device


def check_memory(model: ModelFolder, limits: Limits, pixels: int) -> None:
    """Refuse a model that would not fit: its weights, and the work on `pixels` of input at once."""
    if limits.memory_gb is None:
        return
    needed = model.size + PIXEL_BYTES * pixels
    if needed > 1e9 * limits.memory_gb:
        raise ModelError(
            f"{model.name} would need about {needed / 1e9:.2g} GB ({model.size / 1e9:.2g} GB of weights, batch "
            f"{limits.batch}), above {MEMORY}={limits.memory_gb:g}: raise it, lower {BATCH}, or take a smaller model"
        )


@contextmanager
def bounded(limits: Limits, device: str) -> Iterator[None]:
    """Inference on a device within the limits; running out of its memory becomes a ModelError."""
    torch = extra("torch")
    if device.startswith("cuda") and limits.memory_gb is not None:
        total = torch.cuda.get_device_properties(device).total_memory
        torch.cuda.set_per_process_memory_fraction(min(1e9 * limits.memory_gb / total, 1.0), torch.device(device))
    try:
        with torch.inference_mode():
            yield
    except torch.OutOfMemoryError as error:
        raise ModelError(f"out of memory on {device} at batch {limits.batch}: lower {BATCH}") from error


@dataclass(frozen=True)
class Provenance:
    """Provenance of a model's result."""

    model: ModelFolder
    device: str
    batch: int

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {
            "model": self.model.name,
            "task": self.model.task,
            "family": self.model.family,
            "licence": self.model.licence,
            "weights_sha256": self.model.sha256(),
            "device": self.device,
            "batch": self.batch,
            "versions": {name: _version(name) for name in ("torch", "transformers", "atw-mcp")},
        }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
