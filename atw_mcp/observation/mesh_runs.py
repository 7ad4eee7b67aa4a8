"""Shapes of objects from a model that reconstructs them from pictures."""

from __future__ import annotations

from functools import partial
from typing import Any

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import Progress
from atw_mcp.models import (
    Provenance,
    meshes,
)
from atw_mcp.observation.run_requests import (
    Prepared,
    RunOutcome,
    RunRequest,
    asked_names,
    callbacks_of,
    frames_of,
    inputs_of,
    latest_observed,
)
from atw_mcp.perception.observation import ImageObservation
from evidence_store import Case


def prepare_mesh(app: App, case: Case, request: RunRequest) -> Prepared:
    """Check a run that gives meshes of observed objects."""
    identifier, seen = latest_observed(app, case, request)
    inputs = {
        **inputs_of(case, request),
        "observation": identifier,
        "objects": asked_names(request, seen),
        "sizes": {o.name: o.size for o in request.objects if o.size is not None},
    }
    return Prepared("model_mesh", inputs, partial(_shape, app, case, request, seen, inputs))


def _shape(
    app: App, case: Case, request: RunRequest, seen: ImageObservation, inputs: dict[str, Any], progress: Progress
) -> RunOutcome:
    rate = float(case.facts.get("frames_per_second") or 0.0)
    step = 1.0 / rate if rate > 0 else 0.04
    names, sizes = inputs["objects"], inputs["sizes"]
    frames = frames_of(app, case, seen)
    found = meshes(request.model, seen, frames, names, sizes, step, request.limits, **callbacks_of(progress))
    provenance = Provenance(request.model, request.limits.device, request.limits.batch)
    rows = []
    for name, made in found.items():
        low, high = made.mesh.vertices.min(axis=0), made.mesh.vertices.max(axis=0)
        document = {
            "file": f"{request.model.name}: {name}",
            "vertices": len(made.mesh.vertices),
            "faces": len(made.mesh.faces),
            "watertight": made.mesh.watertight,
            "lower": low.tolist(),
            "upper": high.tolist(),
            "model": provenance.to_dict(),
        }
        arrays = {"vertices": made.mesh.vertices, "faces": made.mesh.faces}
        with app.store.transaction():
            kept = app.store.observations.put("mesh", {**inputs, "object": name}, document, arrays)
            if request.use != "report":
                app.store.cases.add_observation(case.id, "mesh", kept.id)
        rows.append(
            {
                "object": name,
                "mesh": kept.id,
                "extent": (high - low).tolist(),
                "scale_from": made.scale_from,
                "watertight": made.mesh.watertight,
            }
        )
    shape = {"kind": "mesh", "mesh": rows[0]["mesh"]}
    return RunOutcome(
        str(rows[0]["mesh"]),
        f"{request.model.name}: meshes of {', '.join(found)}",
        {
            "meshes": rows,
            "made_with": provenance.to_dict(),
            "next": f"BuildWorld(case={case.id!r}, objects=[{{name: {names[0]!r}, shape: {shape}}}]): bodies are the "
            "convex hulls of their meshes",
        },
        tuple(found),
    )
