"""Ropes, sheets, soft bodies and fluids with one number that is wrong.

Data come from SciPy or closed forms that share no code with the engine: a chain of point masses on springs (a rope, a
sheet that swings), a bar that rings along its length (a sheet, a soft block), a flat sheet that falls through air, a
box that fills, honey that sinks between plates, water that sways in a box. What generator and world share are the
scene's numbers and the laws of their material (springs that are linear in strain, Kelvin-Voigt damping, quadratic
drag), and in the chains also the number of links: a rope of ten straight links is what is given, and what is true.
What is observed are markers on the bodies, or the centre of a fluid, with video-like noise. Where a marker sits on its
body is known from a hundred frames before it is let go. The noise of fluids is above what their coarse grids err.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.benchmarks.gaps.case import NOTHING, Case, Names
from tests.scenes import materials
from tests.scenes.fluids import filling_case, sinking_case, swaying_case
from tests.scenes.materials import falling_case, rope_case, soft_case, strip_case, swinging_case

CASES: tuple[tuple[Callable[[np.random.Generator, str | None], materials.Case], str | None], ...] = tuple(
    (scene, effect)
    for scene, effects in (
        (rope_case, ("air_drag", "stretch_stiffness", "material_damping", "bending_stiffness")),
        (soft_case, ("stretch_stiffness", "material_damping")),
        (strip_case, ("stretch_stiffness", "material_damping")),
        (falling_case, ("air_drag",)),
        (swinging_case, ("bending_stiffness", "air_drag")),
        (filling_case, ("source_rate",)),
        (sinking_case, ("viscosity",)),
        (swaying_case, ("surface_tension",)),
    )
    for effect in (None, *effects)
)


def listed() -> list[str]:
    """Return scenes and effects."""
    return [f"{scene.__name__.removesuffix('_case')} {effect or 'nothing'}" for scene, effect in CASES]


def drawn(index: int, level: None, seed: int) -> Case:  # noqa: ARG001  (as of sets whose noise is chosen)
    """Return a case; each scene has its noise."""
    scene, effect = CASES[index]
    rng = np.random.default_rng([seed, index])
    made = scene(rng, effect)
    recording, held_out = made.recordings(rng)
    return Case(
        listed()[index],
        made.world,
        recording,
        NOTHING if effect is None else (Names((effect,)),),
        held_out=held_out,
        candidates=made.candidates,
        alike={n: min(made.same) for n in made.same},
    )
