"""Numbers of ropes, cloth, soft bodies and fluids that may be wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from polyworld.estimation.candidate import Candidate, Variant
from polyworld.estimation.unknown import Unknown
from polyworld.gap.catalogue.adding import neutral, of_path
from polyworld.parameters import parameter_paths, read_parameter
from polyworld.recording import Recording
from polyworld.world import World

ROPES = frozenset({"rope", "rope_planar"})
SOFT = frozenset({"soft", "soft_planar"})
FLUIDS = frozenset({"fluid", "fluid_planar"})
FACTOR = 100.0  # by which a value may be wrong either way


@dataclass(frozen=True)
class _Kind:
    """A field of some representations. floor: an ordinary change where the value is zero."""

    field: str
    representations: frozenset[str]
    floor: float
    label: str = ""


def _variants(world: World, kinds: Sequence[_Kind]) -> tuple[Variant, ...]:
    """A variant for each field; objects of equal value share one unknown."""
    made: list[Variant] = []
    fields = [k for k in kinds if any(d.representation in k.representations for d in world.deformables)]
    for kind in fields:
        owners = [d.name for d in world.deformables if d.representation in kind.representations]
        unknowns = _shared(world, [f"objects.{n}.{kind.field}" for n in owners], kind.field, kind.floor)
        if unknowns:
            strength = unknowns[0].name if len(unknowns) == 1 else None
            label = kind.label if len(fields) > 1 else ""
            made.append(Variant(world, tuple(unknowns), (neutral(unknowns),), label, strength))
    return tuple(made)


def _shared(world: World, paths: Sequence[str], name: str, floor: float) -> list[Unknown]:
    known = parameter_paths(world)
    groups: dict[float, list[str]] = {}
    for path in paths:
        value = read_parameter(world, path) if path in known else None
        if value is not None:
            groups.setdefault(value, []).append(path)
    unknowns = []
    for value, listed in groups.items():
        owner = listed[0].split(".")[1]
        typical = 0.3 * value if value > 0.0 else floor
        unknowns.append(
            of_path(
                world,
                tuple(listed),
                name if len(groups) == 1 else f"{name}_{owner}",
                value,
                typical,
                lower=value / FACTOR,
                upper=FACTOR * (value if value > 0.0 else floor),
            )
        )
    return unknowns


def _of(*kinds: _Kind) -> Callable[[World, Recording], tuple[Variant, ...]]:
    def variants(world: World, recording: Recording) -> tuple[Variant, ...]:
        del recording
        return _variants(world, kinds)

    return variants


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
    return _variants(
        world,
        (
            _Kind("bending_stiffness", ROPES, max(weights) or 1e-4, "of ropes"),
            _Kind("bending_stiffness", frozenset({"cloth"}), 1e-5, "of cloth"),
        ),
    )


def _source(world: World, recording: Recording) -> tuple[Variant, ...]:
    del recording
    unknowns = _shared(world, [f"emitters.{e.name}.rate" for e in world.emitters], "rate", 1e-5)
    return (Variant(world, tuple(unknowns), (neutral(unknowns),)),) if unknowns else ()


CANDIDATES = (
    Candidate(
        name="material_damping",
        group="material",
        law="stress = C (strain + tau strain rate)",
        representations=ROPES | SOFT | {"cloth"},
        signature="vibrations of the shape that last too long, or too short; the motion as a whole is right",
        reference="Kelvin & Voigt; Landau & Lifshitz, Theory of Elasticity, 34",
        variants=_of(
            _Kind("stretch_damping", ROPES | {"cloth"}, 0.01, "of stretching"),
            _Kind("bending_damping", ROPES | {"cloth"}, 0.01, "of bending"),
            _Kind("damping", SOFT, 0.01, "of soft bodies"),
        ),
        confused_with={"air_drag": "the motion as a whole: inner damping leaves it alone"},
    ),
    Candidate(
        name="air_drag",
        group="material",
        law="dv/dt = -c v of ropes and soft bodies; rho C_n v_n^2 / 2 per area of cloth",
        representations=ROPES | SOFT | {"cloth"},
        signature="fall and swing too fast, and for too long",
        reference="Batchelor, An Introduction to Fluid Dynamics, 5.11",
        variants=_of(
            _Kind("linear_damping", ROPES, 0.1, "of ropes"),
            _Kind("linear_damping", SOFT, 0.1, "of soft bodies"),
            _Kind("drag_normal", frozenset({"cloth"}), 1.0, "across the sheet"),
            _Kind("drag_tangential", frozenset({"cloth"}), 0.05, "along the sheet"),
        ),
        confused_with={"material_damping": "the motion as a whole", "wind": "opposite headings"},
    ),
    Candidate(
        name="bending_stiffness",
        group="material",
        law="moment = EI curvature; D curvature per width of a sheet",
        representations=ROPES | {"cloth"},
        signature="curves too tight, or too wide; short waves too slow or too fast",
        reference="Landau & Lifshitz, Theory of Elasticity, 11 and 17",
        variants=_bending,
        confused_with={"stretch_stiffness": "lengths: bending keeps them"},
    ),
    Candidate(
        name="stretch_stiffness",
        group="material",
        law="tension = EA strain; stress = E strain",
        representations=ROPES | SOFT | {"cloth"},
        signature="sags too far or too little; bounces along its length too slowly or too fast",
        reference="Hooke (1678); Landau & Lifshitz, Theory of Elasticity, 5",
        variants=_of(
            _Kind("stretch_stiffness", ROPES, 1e3, "of ropes"),
            _Kind("stretch_stiffness", frozenset({"cloth"}), 100.0, "of cloth"),
            _Kind("youngs_modulus", SOFT, 1e4, "of soft bodies"),
        ),
        confused_with={"bending_stiffness": "lengths", "gravity_error": "free fall"},
    ),
    Candidate(
        name="viscosity",
        group="material",
        law="stress = mu (grad v + grad v^T)",
        representations=FLUIDS,
        signature="spreads or comes to rest too fast or too slowly",
        reference="Stokes (1845); Batchelor, An Introduction to Fluid Dynamics, 3.3",
        variants=_of(_Kind("viscosity", FLUIDS, 1e-3)),
        confused_with={"source_rate": "the volume there is at the end"},
    ),
    Candidate(
        name="surface_tension",
        group="material",
        law="pressure jump = sigma curvature",
        representations=FLUIDS,
        signature="small drops and thin jets that should draw together, or do so too much",
        reference="Laplace (1806); Batchelor, An Introduction to Fluid Dynamics, 1.9",
        variants=_of(_Kind("surface_tension", FLUIDS, 0.02)),
        confused_with={"viscosity": "fluid at rest: only tension acts there"},
    ),
    Candidate(
        name="source_rate",
        group="material",
        law="volume per time of emitters",
        representations=FLUIDS,
        signature="more, or less, fluid than there should be, growing evenly while a source runs",
        reference="conservation of volume",
        variants=_source,
        confused_with={"viscosity": "the volume there is at the end"},
    ),
)
