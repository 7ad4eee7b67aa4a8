"""Which tools a server serves, all or those that change nothing, and which of them it lists.

An agent pays for the list in every session, so that it holds few tools by default; `CallTool` reaches the others.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atw_mcp.calls.toolbox import WorldTool

CALL = "CallTool"
CORE = frozenset(
    {"OpenCase", "ObserveObjects", "ModelVideo", "InspectFrames", "InspectRollout", "CommitWorld", "Ask", "Rollout"}
    | {"FindDiscrepancy", "ProposeEffects", "AddEffect", "DescribeTool", CALL, "ReadEvidence", "Finish"}
)
"""Tools that are always listed: from a video to an answer, and to the effect that a world lacks."""

TOOLSETS: dict[str, tuple[str, ...]] = {
    "modeling": ("world construction", "world inspection", "execution control"),
    "probing": ("world experimentation", "world inspection"),
    "all": ("world construction", "gap", "world inspection", "world experimentation", "execution control"),
}
"""Roles of the tools that each toolset lists beside the core."""


@dataclass(frozen=True)
class Selection:
    """Tools to list beside the core, by names of `TOOLSETS`; read_only: serve, and list, what changes no case alone."""

    toolsets: tuple[str, ...] = ()
    read_only: bool = False

    @classmethod
    def of(cls, toolsets: str | None, read_only: bool) -> Selection:
        """Read the toolsets from text such as "modeling,probing"; raises ValueError naming those there are."""
        named = tuple(name.strip() for name in (toolsets or "").split(",") if name.strip() not in ("", "core"))
        unknown = [name for name in named if name not in TOOLSETS]
        if unknown:
            raise ValueError(f"no toolset {', '.join(map(repr, unknown))}; toolsets: core, {', '.join(TOOLSETS)}")
        return cls(named, read_only)

    def serves(self, tool: WorldTool) -> bool:
        """Whether a tool is served."""
        return not self.read_only or bool(tool.annotations and tool.annotations.read_only_hint)

    def served(self, tools: Iterable[WorldTool]) -> list[WorldTool]:
        """Return the tools that are served."""
        return [tool for tool in tools if self.serves(tool)]

    def unlisted(self, tools: Iterable[WorldTool]) -> list[str]:
        """Return the names of tools that are served and not listed."""
        roles = {role for name in self.toolsets for role in TOOLSETS[name]}
        served = [] if self.read_only else self.served(tools)
        hidden = [tool.name for tool in served if tool.name not in CORE and tool.role not in roles]
        return hidden or [CALL]  # which is of no use where there is nothing to call by it

    def notes_on(self, text: str, tools: Sequence[WorldTool]) -> str:
        """Return how to get the tools that a text names although they are not served; empty where it names none."""
        words = set(re.findall(r"\w+", text))
        refused = [tool.name for tool in tools if tool.name in words and not self.serves(tool)]
        return "; ".join(f"{name} is not served here: start the server without --read-only" for name in refused)


METHOD = (
    "World Modeling: OpenCase, then ModelVideo, which finds the objects, builds a world and fits it; look at "
    "InspectFrames and InspectRollout, correct by ObserveObjects, CommitWorld. Where the fitted world still disagrees "
    "with the data: FindDiscrepancy, ProposeEffects, AddEffect. World Probing: Ask (a list of questions, each with "
    "interventions), Rollout to look closer, then Finish with the evidence ids that decide the question. Step by step, "
    "and for measured data or described worlds: ImportObservation, CalibrateCamera, BuildWorld, FitWorld."
)
READING = (
    "This server only reads: the resource atw://cases lists the cases, ReadEvidence(case=...) the results of one. What "
    "texts name beside the tools listed is served without --read-only."
)


def instructions(selection: Selection) -> str:
    """Return what a server that serves this selection says of itself."""
    return (
        "Answer physical questions about a video by building a small executable world that behaves like it, then "
        f"experimenting on that world. {READING if selection.read_only else METHOD} SI units, z up; frames are "
        "numbered from 0. The list of tools is short: DescribeTool(tool, argument) and the resource "
        "atw://schema/tools/TOOL give every field, unit and bound, and the form of the result"
        + (
            ". Tools that are not in the list are called by CallTool(tool, arguments)."
            if not selection.read_only
            else "."
        )
    )


def add_selection(parser: argparse.ArgumentParser) -> None:
    """Add the options that `Selection.of` reads."""
    parser.add_argument(
        "--toolsets",
        metavar="NAMES",
        help=f"tools to list beside the core, some of {','.join(TOOLSETS)}; CallTool reaches the others",
    )
    parser.add_argument("--read-only", action="store_true", help="serve only tools that change no case")
