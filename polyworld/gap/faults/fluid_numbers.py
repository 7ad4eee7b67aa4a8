"""Other numbers of fluids than the world's: viscosity, surface tension, the rate of sources."""

from __future__ import annotations

from polyworld.estimation.candidate import Candidate, Variant
from polyworld.gap.adding import one_start
from polyworld.gap.faults.material_fields import FLUIDS, Field, of_fields, shared_values
from polyworld.recording import Recording
from polyworld.world import World


def _source(world: World, recording: Recording) -> tuple[Variant, ...]:
    del recording
    unknowns = shared_values(world, [f"emitters.{e.name}.rate" for e in world.emitters], "rate", 1e-5)
    return (one_start(world, unknowns),) if unknowns else ()


CANDIDATES = (
    Candidate(
        name="viscosity",
        group="material",
        law="stress = mu (grad v + grad v^T)",
        signature="spreads or comes to rest too fast or too slowly",
        reference="Stokes (1845); Batchelor, An Introduction to Fluid Dynamics, 3.3",
        variants=of_fields(Field("viscosity", FLUIDS, 1e-3)),
        confused_with={"source_rate": "the volume there is at the end"},
    ),
    Candidate(
        name="surface_tension",
        group="material",
        law="pressure jump = sigma curvature",
        signature="small drops and thin jets that should draw together, or do so too much",
        reference="Laplace (1806); Batchelor, An Introduction to Fluid Dynamics, 1.9",
        variants=of_fields(Field("surface_tension", FLUIDS, 0.02)),
        confused_with={"viscosity": "fluid at rest: only tension acts there"},
    ),
    Candidate(
        name="source_rate",
        group="material",
        law="volume per time of emitters",
        signature="more, or less, fluid than there should be, growing evenly while a source runs",
        reference="conservation of volume",
        variants=_source,
        confused_with={"viscosity": "the volume there is at the end"},
    ),
)
