"""Observations of a case as the tools need them: the camera, and the tracks a world is to model."""

from __future__ import annotations

from atw_mcp.app import App
from atw_mcp.track_records import TrackRecord, read_record
from evidence_store import Case
from polyworld.camera import Camera
from polyworld.world import World


def latest_camera(app: App, case: Case) -> Camera | None:
    """The camera the case was last calibrated with, or None."""
    found = app.store.cases.observations(case.id, "camera")
    if not found:
        return None
    return Camera.model_validate(app.store.observations.get(found[0][1]).document["camera"])


def tracks_to_model(app: App, case: Case, identifier: str | None) -> TrackRecord:
    """The track record asked for, else the latest of the case; raises ValueError saying what to do first."""
    record = read_record(app.store, case, identifier)
    if record is None:
        raise ValueError(f"case {case.id!r} has no tracks in world coordinates yet")
    return record


def modelled_tracks(app: App, case: Case, world: World) -> TrackRecord:
    """The track record that a world of the case models, else the case's latest."""
    return tracks_to_model(app, case, app.store.cases.modelled_observation(case.id, world.id))
