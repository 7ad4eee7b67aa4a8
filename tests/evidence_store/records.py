"""A store with a record in every table, and ways to damage it."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np

from evidence_store import Answer, Binding, Evidence, EvidenceStore

PICTURE = b"\x89PNG and the rest of a picture"


def filled(path: Path, case: str = "ball") -> EvidenceStore:
    """A store with one case and at least one record in every table; its evidence are ev-1 to ev-3."""
    store = EvidenceStore(path)
    store.cases.add(case, content=f"content of {case}", kind="video", path=f"/{case}.mp4", facts={"frames": 3})
    store.cases.add_question(case, "will it bounce?")
    store.cases.bind(case, Binding("the ball", "track-1", "ball", "only one"))
    store.cases.add_answer(case, Answer("will it bounce?", "yes", 0.9, ("ev-1",), ""))
    tracks = store.observations.put("tracks", {"video": case}, {"names": ["ball"]}, {"x": np.arange(3.0)})
    store.cases.add_observation(case, "tracks", tracks.id)
    store.worlds.put("world-a", '{"a":1}')
    store.worlds.put("world-b", '{"b":1}', parent="world-a", how="fitted", detail={"loss": 0.5})
    store.cases.add_world(case, "world-a", "built", tracks.id)
    store.cases.add_world(case, "world-b", "fitted", tracks.id)
    store.cases.commit_world(case, "world-b")
    rollout = store.rollouts.put("rollout", {"world": "world-b"}, {"n": 2}, {"x": np.array([1.0, np.nan])})
    store.fits.put("fit", {"world": "world-b", "start": "world-a"}, {"loss": 0.5})
    store.evidence.add(
        Evidence(
            "Rollout", {"horizon": 2.0}, case=case, world="world-b", rollout=rollout.id, objects=("ball",),
            interval=(0.0, 2.0), summary="fällt", payload={"data": {"x": [1, None]}}, pictures={"a.png": PICTURE},
        )
    )  # fmt: skip
    store.evidence.add(Evidence("OpenCase", {}))
    store.evidence.add(Evidence("FitWorld", {}, case=case, observation=tracks.id, world="world-b", status="failed"))
    return store


def tamper(path: Path, statement: str) -> None:
    """Change rows past the store, as damage or another program would."""
    database = sqlite3.connect(path)
    with database:
        assert database.execute(statement).rowcount > 0
    database.close()
