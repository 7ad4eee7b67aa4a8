"""Kernels of a world's materials, compiled side by side: one after the other would keep a first user waiting."""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType
from typing import Any

import warp as wp

from polyworld.core import buffers
from polyworld.core.cores import available_cores
from polyworld.world import World
from polyworld.world.materials import material_of

# Loaded when first launched: which of them a world needs depends on its parameters.
_LATER = frozenset({"solids_plastic", "solids_viscous", "viscosity", "viscosity_solve", "tension"})


def load_kernels(world: World) -> None:
    """Compile, or load from Warp's cache, what the coupled solver needs for a world, on all cores."""
    materials = {material_of(d).kind: material_of(d) for d in world.deformables}
    fluids_alone = all(m.form == "liquid" for m in materials.values())
    packages = [m.kernels for _, m in sorted(materials.items()) if m.kernels is not None]
    if not fluids_alone:
        packages.insert(0, "polyworld.solver.coupled")
    unneeded = {"twist"} if all(getattr(d, "twist_stiffness", 0.0) == 0.0 for d in world.deformables) else set()
    if not world.attachments:
        unneeded |= {"attachment_kernels", "attachment_jointed", "attachment_ropes"}
    if "rope" not in materials:
        unneeded |= {"attachment_ropes"}
    if fluids_alone:
        unneeded |= {"immersed"}
    if not (world.emitters or world.drains):
        unneeded |= {"sources"}
    if not (world.objects or world.statics):
        unneeded |= {"bodies"}
    if not world.joints:
        unneeded |= {"mechanism_response", "attachment_jointed"}
    if not world.effects:
        unneeded |= {"mass_effects"}
    representations = {d.representation for d in world.deformables}
    unneeded |= ({"solids"} if "soft" not in representations else set()) | _LATER
    unneeded |= {"slices"} if "soft_planar" not in representations else set()
    found: list[Any] = []
    for package in packages:
        home = importlib.import_module(package)
        for part in pkgutil.iter_modules(home.__path__):
            if part.name not in unneeded:
                found += _kernel_modules(importlib.import_module(f"{home.__name__}.{part.name}"))
    if world.objects or world.statics:
        from polyworld.solver.spatial.kernels import load_worlds, step_kernel

        found.append(load_worlds.module)
        if world.objects:
            found.append(step_kernel(bool(world.joints)).module)
    unique = list({id(m): m for m in found}.values())
    buffers.load(unique, workers=available_cores())


def _kernel_modules(module: ModuleType) -> list[Any]:
    """Return the Warp modules of the kernels that a Python module defines."""
    return [k.module for k in vars(module).values() if isinstance(k, wp.Kernel) and k.module.name == module.__name__]
