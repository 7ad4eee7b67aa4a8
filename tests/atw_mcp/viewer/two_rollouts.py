"""A document of two bodies in two rollouts, with all that the page around the scene shows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.viewer import document as view
from atw_mcp.viewer import world_parts
from atw_mcp.viewer.packing import Blocks, packed
from atw_mcp.viewer.page import page
from tests.atw_mcp.viewer.blank import ball_rollout, ball_world, document

SECONDS_PER_FRAME = 0.04
FRAMES = 51
TIMES: NDArray[np.float64] = np.linspace(0, 3, 61)  # s; the video ends at 2 s
NAMES = ["red_ball", "blue_cube"]
SIGMA = 0.02  # m
SPREAD = 0.3  # m that members of the ensemble are off to either side


def positions(branch: bool = False) -> NDArray[np.float64]:
    """Return positions (T, n, 3) [m]: the first body moves along x and the second, absent in the branch, along y."""
    still = np.zeros_like(TIMES)
    red = np.stack([np.sin(TIMES) * (2 if branch else 1), still, still + 0.1], axis=-1)
    blue = np.stack([still + 0.5, TIMES**2 / 4, still + 0.1], axis=-1)
    return np.stack([red] if branch else [red, blue], axis=1)


def contact(time: float, impulse: float, *participants: str) -> view.EventMark:
    """Return the beginning of a contact."""
    return view.EventMark(
        kind="contact_begin", time=time, participants=list(participants), position=None, impulse=impulse, speed=None
    )


NOTED = 1.5  # s
GROUND = contact(0.5, 0.2, "red_ball", "floor")
HIT = contact(1.25, 0.75, "red_ball", "blue_cube")
REST = view.EventMark(kind="rest", time=2.5, participants=["red_ball"], position=None, impulse=None, speed=None)
LATER = contact(2.125, 0.5, "red_ball", "floor")


def _world(identifier: str, label: str, names: list[str]) -> world_parts.WorldView:
    return ball_world(identifier, names, ["#d55e00", "#0072b2"], 0.1, mass=1.5, label=label, origin="built",
                      seconds_per_frame=SECONDS_PER_FRAME, frame_count=FRAMES)  # fmt: skip


def _rollout(blocks: Blocks, branch: bool, events: list[view.EventMark]) -> view.RolloutView:
    where = positions(branch)
    given: dict[str, Any] = {"world": "world-base", "label": "as built"}
    if branch:
        edit = view.EditWords(action="remove", object="blue_cube", text="without blue_cube")
        given = {"world": "world-branch", "label": "without blue_cube", "base": "rollout-base", "edits": [edit],
                 "status": "truncated", "why_ended": "red_ball left the world"}  # fmt: skip
    else:
        low, high = (blocks.floats(where + sign * SPREAD) for sign in (-1, 1))
        given["spread"] = view.Spread(members=40, times=blocks.floats(TIMES), low=low, high=high)
    identifier = "rollout-branch" if branch else "rollout-base"
    names = NAMES[: where.shape[1]]
    return ball_rollout(identifier, names, TIMES, where, blocks, horizon=3, events=events, **given)


def _row(identifier: str, tool: str, rollout: str | None, interval: list[float | None] | None) -> view.EvidenceRow:
    return view.EvidenceRow(id=identifier, tool=tool, status="completed", summary=f"a result of {tool}", world=None,
                            rollout=rollout, observation=None, objects=["red_ball"], interval=interval)  # fmt: skip


def report() -> str:
    """Return the page with the document inside."""
    blocks = Blocks()
    seen = np.arange(FRAMES) * SECONDS_PER_FRAME
    track = np.zeros((FRAMES, 1, 3))
    track[:, 0, 0] = np.sin(seen) + 0.01
    asked = "Does the ball hit the cube?"
    answer = view.Answer(question=asked, answer="true", confidence=0.9, evidence=["ev-2"], missing="")
    tracks = view.Tracks(id="observation", run="", names=["red_ball"], times=blocks.floats(seen),
                         positions=blocks.floats(track), sigma=blocks.floats(np.full((FRAMES, 1), SIGMA)),
                         held_out_from=1.6)  # fmt: skip
    compared = view.ComparisonView(base="rollout-base", edited="rollout-branch", evidence="ev-3",
                                   summary="Without the cube the ball goes twice as far.",
                                   displaced=[view.Displaced(object="red_ball", most=0.9975, time=1.55)],
                                   gone=[HIT, REST], new=[LATER])  # fmt: skip
    made = document(
        "two-rollouts",
        about={"kind": "video", "file": "clip.mp4", "questions": [asked], "answers": [answer]},
        missing=["The video has moved: its frames are not shown."],
        tracks=[tracks],
        worlds=[_world("world-base", "as built", NAMES), _world("world-branch", "without blue_cube", NAMES[:1])],
        rollouts=[_rollout(blocks, False, [GROUND, HIT, REST]), _rollout(blocks, True, [GROUND, LATER])],
        comparisons=[compared],
        evidence=[
            _row("ev-1", "BuildWorld", None, None),
            _row("ev-2", "QueryWorld", "rollout-base", [1.2, 1.3]),
            _row("ev-3", "CompareWorlds", "rollout-branch", None),
            _row("ev-4", "Note", "rollout-base", [NOTED, NOTED]),
        ],
        shown=["rollout-base", "rollout-branch"],
    )
    return page(packed(made, blocks))
