"""Track records of a case: observed motion in world coordinates, with what was seen of each object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

from pydantic import TypeAdapter

from atw_mcp.worlds.building import ObservedObject
from evidence_store import Case, Content, EvidenceStore
from polyworld.data.tracks import ObservedTracks
from polyworld.world import MotionPlane
from polyworld.world.shapes import BodyShape

KIND = "tracks"
_SHAPE: TypeAdapter[Any] = TypeAdapter(BodyShape)


@dataclass(frozen=True)
class TrackRecord:
    """Observed tracks as stored.

    heights_assumed: positions were got by assuming that objects move in `plane`. source["kind"] is `derived` from
    the video or `imported`.
    """

    id: str
    tracks: ObservedTracks
    objects: tuple[ObservedObject, ...]
    heights_assumed: bool
    source: dict[str, Any]
    plane: MotionPlane | None

    @classmethod
    def of(cls, content: Content) -> Self:
        """The record in an observation of kind `tracks`."""
        document = content.document
        return cls(
            id=content.id,
            tracks=ObservedTracks.from_dict(document["tracks"]),
            objects=tuple(_object(item) for item in document["objects"]),
            heights_assumed=bool(document["heights_assumed"]),
            source=document["source"],
            plane=None if document["plane"] is None else MotionPlane.model_validate(document["plane"]),
        )


def to_document(
    tracks: ObservedTracks,
    objects: Sequence[ObservedObject],
    *,
    heights_assumed: bool,
    source: dict[str, Any],
    plane: MotionPlane | None = None,
) -> dict[str, Any]:
    """Return what is stored of a track record; `TrackRecord.of` reads it back."""
    return {
        "names": list(tracks.names),
        "tracks": tracks.to_dict(),
        "objects": [
            {
                "name": item.name,
                "shape": None if item.shape is None else item.shape.model_dump(mode="json"),
                "color": item.color,
                "material": item.material,
            }
            for item in objects
        ],
        "heights_assumed": heights_assumed,
        "source": source,
        "plane": None if plane is None else plane.model_dump(mode="json"),
    }


def read_record(store: EvidenceStore, case: Case, identifier: str | None = None) -> TrackRecord | None:
    """A track record of the case, by default the latest; None where it has none.

    Raises ValueError naming the records there are for an id that is not one of the case's.
    """
    known = [observation for _, observation in store.cases.observations(case.id, KIND)]
    if identifier is None:
        return TrackRecord.of(store.observations.get(known[0])) if known else None
    if identifier not in known:
        raise ValueError(f"case {case.id!r} has no track record {identifier!r}; its records, latest first: {known}")
    return TrackRecord.of(store.observations.get(identifier))


def at_rate(tracks: ObservedTracks, seconds_per_frame: float) -> ObservedTracks:
    """The same tracks with another physical time between frames."""
    return replace(tracks, seconds_per_frame=seconds_per_frame)


def _object(item: dict[str, Any]) -> ObservedObject:
    shape = None if item["shape"] is None else _SHAPE.validate_python(item["shape"])
    return ObservedObject(item["name"], shape, item["color"], item["material"])
