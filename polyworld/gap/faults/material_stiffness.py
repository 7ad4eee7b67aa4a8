"""Other stiffness of ropes, cloth and soft bodies than the world's, in bending and in stretching."""

from __future__ import annotations

import numpy as np

from polyworld.estimation.candidate import Candidate, Variant
from polyworld.gap.faults.material_fields import CLOTH, ROPES, SOFT, Field, field_variants, of_fields
from polyworld.recording import Recording
from polyworld.world import World


def _bending(world: World, recording: Recording) -> tuple[Variant, ...]:
    """Where nothing bends stiffly yet: what bends a rope's own weight back over a tenth of its length."""
    del recording
    weights = [0.0]
    g = float(np.linalg.norm(world.environment.gravity)) or 9.81
    for soft in world.deformables:
        if soft.representation in ROPES:
            points = np.asarray(getattr(soft, "points"))  # noqa: B009
            length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
            weights.append(float(getattr(soft, "linear_density")) * g * (0.1 * length) ** 3)  # noqa: B009
    return field_variants(
        world,
        (
            Field("bending_stiffness", ROPES, max(weights) or 1e-4, "of ropes"),
            Field("bending_stiffness", CLOTH, 1e-5, "of cloth"),
        ),
    )


CANDIDATES = (
    Candidate(
        name="bending_stiffness",
        group="material",
        law="moment = EI curvature; D curvature per width of a sheet",
        signature="curves too tight, or too wide; short waves too slow or too fast",
        reference="Landau & Lifshitz, Theory of Elasticity, 11 and 17",
        variants=_bending,
        confused_with={"stretch_stiffness": "lengths: bending keeps them"},
    ),
    Candidate(
        name="stretch_stiffness",
        group="material",
        law="tension = EA strain; stress = E strain",
        signature="sags too far or too little; bounces along its length too slowly or too fast",
        reference="Hooke (1678); Landau & Lifshitz, Theory of Elasticity, 5",
        variants=of_fields(
            Field("stretch_stiffness", ROPES, 1e3, "of ropes"),
            Field("stretch_stiffness", CLOTH, 100.0, "of cloth"),
            Field("youngs_modulus", SOFT, 1e4, "of soft bodies"),
        ),
        confused_with={"bending_stiffness": "lengths", "gravity_error": "free fall"},
    ),
)
