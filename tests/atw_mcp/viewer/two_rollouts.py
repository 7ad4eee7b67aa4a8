"""A document of two bodies in two rollouts, with all that the page around the scene shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from atw_mcp.viewer import document as view
from atw_mcp.viewer import parts, world_parts
from atw_mcp.viewer.packing import Blocks, packed
from atw_mcp.viewer.page import page

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
    moving = [
        world_parts.Moving(
            name=name,
            kind="rigid",
            color=color,
            mass=1.5,
            shape=parts.Sphere(radius=0.1),
            radius=None,
            segments=None,
            triangles=None,
            start_time=0,
        )
        for name, color in zip(names, ["#d55e00", "#0072b2"], strict=False)
    ]
    return world_parts.WorldView(
        id=identifier,
        label=label,
        origin="built",
        parent=None,
        committed=False,
        planar=False,
        seconds_per_frame=SECONDS_PER_FRAME,
        frame_count=FRAMES,
        gravity=[0, 0, -9.81],
        camera=None,
        moving=moving,
        statics=[],
        joints=[],
        regions=[],
        effects=[],
        floor=None,
        parameters=[],
    )


def _rollout(blocks: Blocks, branch: bool, events: list[view.EventMark]) -> view.RolloutView:
    where = positions(branch)
    count = where.shape[1]
    return view.RolloutView(
        id="rollout-branch" if branch else "rollout-base",
        world="world-branch" if branch else "world-base",
        label="without blue_cube" if branch else "as built",
        base="rollout-base" if branch else None,
        edits=[view.EditWords(action="remove", object="blue_cube", text="without blue_cube")] if branch else [],
        status="truncated" if branch else "completed",
        why_ended="red_ball left the world" if branch else None,
        horizon=3,
        names=NAMES[:count],
        times=blocks.floats(TIMES),
        positions=blocks.floats(where),
        orientations=blocks.floats(np.broadcast_to([1.0, 0, 0, 0], (len(TIMES), count, 4))),
        velocities=blocks.floats(np.gradient(where, TIMES, axis=0)),
        spins=blocks.floats(np.zeros_like(where)),
        active=blocks.raw(np.ones((len(TIMES), count), np.uint8)),
        deformed=[],
        quantities=[],
        events=events,
        pushes=[],
        misfits=[],
        sampled="",
        spread=None
        if branch
        else view.Spread(
            members=40,
            times=blocks.floats(TIMES),
            low=blocks.floats(where - SPREAD),
            high=blocks.floats(where + SPREAD),
        ),
    )


def _row(identifier: str, tool: str, rollout: str | None, interval: list[float | None] | None) -> view.EvidenceRow:
    return view.EvidenceRow(
        id=identifier,
        tool=tool,
        status="completed",
        summary=f"a result of {tool}",
        world=None,
        rollout=rollout,
        observation=None,
        objects=["red_ball"],
        interval=interval,
    )


def report() -> str:
    """Return the page with the document inside."""
    blocks = Blocks()
    seen = np.arange(FRAMES) * SECONDS_PER_FRAME
    track = np.zeros((FRAMES, 1, 3))
    track[:, 0, 0] = np.sin(seen) + 0.01
    document = view.ViewDocument(
        made_by="a test",
        case=view.CaseView(
            id="two-rollouts",
            kind="video",
            file="clip.mp4",
            questions=["Does the ball hit the cube?"],
            answers=[
                view.Answer(
                    question="Does the ball hit the cube?",
                    answer="true",
                    confidence=0.9,
                    evidence=["ev-2"],
                    missing="",
                )
            ],
            bindings=[],
            committed_world=None,
        ),
        missing=["The video has moved: its frames are not shown."],
        film=None,
        observed=None,
        tracks=[
            view.Tracks(
                id="observation",
                run="",
                names=["red_ball"],
                times=blocks.floats(seen),
                positions=blocks.floats(track),
                sigma=blocks.floats(np.full((FRAMES, 1), SIGMA)),
                held_out_from=1.6,
            )
        ],
        worlds=[_world("world-base", "as built", NAMES), _world("world-branch", "without blue_cube", NAMES[:1])],
        rollouts=[_rollout(blocks, False, [GROUND, HIT, REST]), _rollout(blocks, True, [GROUND, LATER])],
        comparisons=[
            view.ComparisonView(
                base="rollout-base",
                edited="rollout-branch",
                evidence="ev-3",
                summary="Without the cube the ball goes twice as far.",
                displaced=[view.Displaced(object="red_ball", most=0.9975, time=1.55)],
                gone=[HIT, REST],
                new=[LATER],
            )
        ],
        fits=[],
        gaps=[],
        evidence=[
            _row("ev-1", "BuildWorld", None, None),
            _row("ev-2", "QueryWorld", "rollout-base", [1.2, 1.3]),
            _row("ev-3", "CompareWorlds", "rollout-branch", None),
            _row("ev-4", "Note", "rollout-base", [NOTED, NOTED]),
        ],
        provenance=view.Provenance(nodes=[], edges=[]),
        running=[],
        shown=["rollout-base", "rollout-branch"],
    )
    return page(packed(document, blocks))
