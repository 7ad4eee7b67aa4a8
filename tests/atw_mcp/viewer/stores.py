"""A small store of a video's case whose every number is known: two discs, seen a little aside of where they are."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.calls.app import App
from atw_mcp.observation.track_records import to_document
from atw_mcp.perception.masks import RunLengthMask
from atw_mcp.perception.observation import Cue, ImageObservation, ObservedObject, measure
from atw_mcp.perception.video import VideoInfo
from atw_mcp.worlds.building import ObservedObject as Looks
from atw_mcp.worlds.rollouts import compute_rollout
from evidence_store import Answer, Evidence, EvidenceStore
from polyworld.data.tracks import ObservedTracks
from polyworld.edits.interventions import Remove, branch
from polyworld.world import World
from tests.atw_mcp.two_discs import FRAME, case_with, two_discs

ASIDE, SIGMA = 0.003, 0.002  # [m] that the striker is seen off its place, and the noise stated of that
HORIZON = 1.2  # [s]
SIZE = (240, 320)
SEEN = (0, 1, 3)  # frames


def mask(frame: int, row: int) -> NDArray[np.bool_]:
    """A disc with a hole and a detached speck, at another place in each frame."""
    image = np.zeros(SIZE, dtype=np.uint8)
    cv2.circle(image, (60 + 20 * frame, 80 + 60 * row), 23, 1, -1)
    cv2.circle(image, (66 + 20 * frame, 78 + 60 * row), 6, 0, -1)
    image[10 + 3 * row : 14 + 3 * row, 300:309] = 1
    return image.astype(bool)


def observation() -> ImageObservation:
    """Two objects in three frames, the second hidden in the last."""
    info = VideoInfo("/clips/discs.mp4", 4, SIZE[1], SIZE[0], 25.0, "0" * 64, 4)
    objects = []
    for row, (name, color) in enumerate((("striker", "red"), ("target", "red"))):
        hidden = (False, False, row == 1)
        masks = tuple(None if out else RunLengthMask.encode(mask(f, row)) for f, out in zip(SEEN, hidden, strict=True))
        centroid, box, area = measure(masks)
        cue = Cue(color, 0.9, {})
        objects.append(
            ObservedObject(
                name=name,
                colour=cue,
                material=Cue("unknown", 0.0, {}),
                shape=Cue("unknown", 0.0, {}),
                status=tuple("hidden" if out else "visible" for out in hidden),
                confidence=np.where(hidden, 0.0, 0.9),
                centroid=centroid,
                box=box,
                area=area,
                masks=masks,
                entry_frame=0,
                exit_frame=3,
                enters=False,
                exits=False,
            )
        )
    return ImageObservation(info, SEEN, tuple(objects))


def tracks(world: World) -> ObservedTracks:
    """What is seen of the striker until it meets the target, every 5th frame, and nothing of the target's third."""
    frames = np.arange(0, 40, 5)
    positions = np.zeros((len(frames), 2, 3))
    for column, item in enumerate(world.objects):
        positions[:, column] = np.asarray(item.position) + np.outer(frames * FRAME, item.velocity)
    positions[:, 0] += [0.0, ASIDE, 0.5]  # half a metre above the plane, which is no misfit in it
    confidence = np.ones((len(frames), 2))
    confidence[2, 1] = 0.0
    return ObservedTracks(
        names=("striker", "target"),
        frames=frames,
        seconds_per_frame=0.5 * FRAME,  # the world says otherwise
        positions=positions,
        position_sigma=np.full((len(frames), 2), SIGMA),
        orientations=np.full((len(frames), 2, 4), np.nan),
        confidence=confidence,
        orientation_confidence=np.zeros((len(frames), 2)),
        symmetry=(0, 0),
    )


def discs_store(path: Path) -> tuple[str, str]:
    """Write the store; returns its rollouts: of the world, and of the branch without the target."""
    app = App(path)
    world = two_discs()
    case = case_with(app, world, committed=True, video=Path("/clips/discs.mp4"))
    store = app.store
    seen = store.observations.put("objects", {}, {"names": [], "observation": observation().to_dict()})
    looks = [Looks(item.name, item.shape, "red", None) for item in world.objects]
    document = to_document(tracks(world), looks, heights_assumed=True, source={"kind": "derived"})
    measured = store.observations.put("world_tracks", {}, document)
    store.cases.add_observation(case.id, "objects", seen.id)
    store.cases.add_observation(case.id, "tracks", measured.id)
    without = branch(world, [Remove(object="target")])
    edits = [{"action": "remove", "object": "target"}]
    app.keep_world(case, without, how="intervention", parent=world, detail={"edits": edits})
    base, _ = compute_rollout(app, world, HORIZON)
    edited, _ = compute_rollout(app, without, HORIZON)
    names = world.moving_names
    store.evidence.add(Evidence("OpenCase", {"video": "discs.mp4"}, case=case.id, summary="case discs"))
    store.evidence.add(Evidence("Rollout", {}, case=case.id, world=world.id, rollout=base, objects=names))
    store.evidence.add(Evidence("Rollout", {}, case=case.id, world=without.id, rollout=edited, interval=(0.0, HORIZON)))
    arguments = {"base": base, "edited": edited}
    store.evidence.add(Evidence("CompareWorlds", arguments, case=case.id, rollout=edited, summary="it goes on"))
    store.cases.add_question(case.id, "Would it go on?")
    store.cases.add_answer(case.id, Answer("Would it go on?", "true", None, ("ev-4",), ""))
    app.close()
    return base, edited


def opened(path: Path) -> EvidenceStore:
    """Open a store as the report does."""
    return EvidenceStore.to_read(path)
