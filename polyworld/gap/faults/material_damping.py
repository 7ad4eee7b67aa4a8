"""Other damping of ropes, cloth and soft bodies than the world's: within the material, and by the air."""

from __future__ import annotations

from polyworld.estimation.candidate import Candidate
from polyworld.gap.faults.material_fields import CLOTH, ROPES, SOFT, Field, of_fields

CANDIDATES = (
    Candidate(
        name="material_damping",
        group="material",
        law="stress = C (strain + tau strain rate)",
        signature="vibrations of the shape that last too long, or too short; the motion as a whole is right",
        reference="Kelvin & Voigt; Landau & Lifshitz, Theory of Elasticity, 34",
        variants=of_fields(
            Field("stretch_damping", ROPES | CLOTH, 0.01, "of stretching"),
            Field("bending_damping", ROPES | CLOTH, 0.01, "of bending"),
            Field("damping", SOFT, 0.01, "of soft bodies"),
        ),
        confused_with={"air_drag": "the motion as a whole: inner damping leaves it alone"},
    ),
    Candidate(
        name="air_drag",
        group="material",
        law="dv/dt = -c v of ropes and soft bodies; rho C_n v_n^2 / 2 per area of cloth",
        signature="fall and swing too fast, and for too long",
        reference="Batchelor, An Introduction to Fluid Dynamics, 5.11",
        variants=of_fields(
            Field("linear_damping", ROPES, 0.1, "of ropes"),
            Field("linear_damping", SOFT, 0.1, "of soft bodies"),
            Field("drag_normal", CLOTH, 1.0, "across the sheet"),
            Field("drag_tangential", CLOTH, 0.05, "along the sheet"),
        ),
        confused_with={"material_damping": "the motion as a whole", "wind": "opposite headings"},
    ),
)
