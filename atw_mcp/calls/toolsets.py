"""Which tools a server serves: all, those of some toolsets, or those that change nothing."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atw_mcp.calls.toolbox import WorldTool

TOOLSETS: dict[str, tuple[str, ...]] = {
    "modeling": ("world construction", "world inspection"),
    "gap": ("gap", "world inspection"),
    "probing": ("world experimentation", "world inspection"),
}
"""Roles of the tools of each toolset; those of execution control are served with every one."""

ALWAYS = ("OpenCase",)  # a session of any kind begins with it


@dataclass(frozen=True)
class Selection:
    """Tools to serve. toolsets: names of `TOOLSETS`, all by default. read_only: only tools that change no case."""

    toolsets: tuple[str, ...] = tuple(TOOLSETS)
    read_only: bool = False

    @classmethod
    def of(cls, toolsets: str | None, read_only: bool) -> Selection:
        """Read the toolsets from text such as "modeling,gap"; raises ValueError naming those there are."""
        if toolsets is None:
            return cls(read_only=read_only)
        named = tuple(name.strip() for name in toolsets.split(","))
        unknown = [name for name in named if name not in TOOLSETS]
        if unknown:
            raise ValueError(f"no toolset {', '.join(map(repr, unknown))}; toolsets: {', '.join(TOOLSETS)}")
        return cls(tuple(name for name in TOOLSETS if name in named), read_only)

    def serves(self, tool: WorldTool) -> bool:
        """Whether a tool is served."""
        return self._writes_allowed(tool) and self._in_toolsets(tool)

    def served(self, tools: Iterable[WorldTool]) -> list[WorldTool]:
        """Return the tools that are served."""
        return [tool for tool in tools if self.serves(tool)]

    def why_not(self, tool: WorldTool) -> str:
        """Say of a tool that is not served how to get it."""
        ways = []
        if not self._in_toolsets(tool):
            own = next(name for name, roles in TOOLSETS.items() if tool.role in roles)
            ways.append(f"with --toolsets {','.join([*self.toolsets, own])}")
        if not self._writes_allowed(tool):
            ways.append("without --read-only")
        return f"{tool.name} is not served here: start the server {' and '.join(ways)}"

    def notes_on(self, text: str, tools: Sequence[WorldTool]) -> str:
        """Return how to get the tools that a text names although they are not served; empty where it names none."""
        words = set(re.findall(r"\w+", text))
        return "; ".join(self.why_not(tool) for tool in tools if tool.name in words and not self.serves(tool))

    def _in_toolsets(self, tool: WorldTool) -> bool:
        roles = {role for name in self.toolsets for role in TOOLSETS[name]}
        return tool.role in roles or tool.role == "execution control" or tool.name in ALWAYS

    def _writes_allowed(self, tool: WorldTool) -> bool:
        return not self.read_only or bool(tool.annotations and tool.annotations.read_only_hint)


ALL = Selection()

_ABOUT = {
    "modeling": "World Modeling: OpenCase, ObserveObjects, CalibrateCamera, BuildWorld, FitWorld, look at "
    "InspectFrames and InspectRollout, CommitWorld. Where the objects and the camera are known, ModelVideo makes all "
    "these steps up to FitWorld in one call.",
    "gap": "Where the fitted world still disagrees with the data: FindDiscrepancy, ProposeEffects, AddEffect.",
    "probing": "World Probing: Ask (a list of questions, each with interventions), then Rollout, ReadEvents, "
    "CompareWorlds, QueryWorld to look closer, then Finish with the evidence ids that decide the question.",
}


def instructions(selection: Selection) -> str:
    """Return what a server that serves this selection says of itself."""
    if selection == ALL:
        method = " ".join(_ABOUT.values())
    elif selection.read_only:
        method = (
            "This server only reads: the resource atw://cases lists the cases, ReadEvidence(case=...) the results of "
            "one. What texts name beside the tools listed is served without --read-only."
        )
    else:
        kept = [_ABOUT[name] for name in selection.toolsets]
        missing = ",".join(TOOLSETS)
        method = " ".join([*kept, f"Other tools that texts name are served by `atw-mcp serve --toolsets {missing}`."])
    return (
        "Answer physical questions about a video by building a small executable world that behaves like it, then "
        f"experimenting on that world. {method} SI units, z up; frames are numbered from 0. The list of tools is in "
        "short form: DescribeTool(tool, argument) and the resource atw://schema/tools/TOOL give every field, unit and "
        "bound, and the form of the result."
    )


def add_selection(parser: argparse.ArgumentParser) -> None:
    """Add the options that `Selection.of` reads."""
    parser.add_argument(
        "--toolsets", metavar="NAMES", help=f"serve only some tools: one or several of {','.join(TOOLSETS)}"
    )
    parser.add_argument("--read-only", action="store_true", help="serve only tools that change no case")
