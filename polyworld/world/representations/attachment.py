"""Attachments of ropes, cloth and soft bodies: to the world or to other objects."""

from __future__ import annotations

import itertools
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from polyworld.world.description import Description, Name, NonNegative, Positive, Vec3, fixed_length


class Region(Description):
    """An axis-aligned box of space."""

    lower: Vec3 = Field(description="lower corner [m]")
    upper: Vec3 = Field(description="upper corner [m]")


class Attachment(Description):
    """Holds part of a rope, cloth or soft body to the world, to a rigid object, or to another deformable object.

    Give exactly one of end, nodes, region. To the world: the nodes keep their initial places, or are led along
    `motion`. To a rigid object: they keep their initial places in its axes. To another deformable object: each
    node keeps its initial offset from that object's nearest point. Whether the fastening carries a moment depends
    on what is held: one node is a pivot; `clamped` also holds the direction of a rope's end.
    """

    name: Name = Field(description="name, which nothing else in the world has")
    object: Name = Field(description="the rope, cloth or soft body")
    end: Literal["start", "end"] | None = Field(default=None, description="an end of a rope")
    nodes: tuple[int, ...] | None = Field(
        default=None,
        description="node indices, from 0. Rope: along it, the last is `segments`. Sheet of nu by nv divisions: "
        "i (nv + 1) + j lies at corner + edge_u i / nu + edge_v j / nv, so its corners are 0, nv, nu (nv + 1) and "
        "(nu + 1)(nv + 1) - 1. Mesh of cloth: its vertices, equal ones once. Soft body: InspectWorld says where they "
        "are, or give a region",
    )
    region: Region | None = Field(default=None, description="all nodes that are in this box at the start")
    clamped: bool = Field(default=False, description="of a rope's end: its direction is held too")
    to: Name | None = Field(default=None, description="rigid or deformable object it is held to; default: the world")
    motion: tuple[Annotated[tuple[float, float, float, float], fixed_length(4)], ...] = Field(
        default=(),
        max_length=10_000,
        description="of a fastening to the world: (time [s], displacement x, y, z [m]) rows, linear between",
    )
    release: Positive | None = Field(default=None, description="time at which it lets go [s]; default: never")
    strength: NonNegative | None = Field(default=None, description="force at which it breaks [N]; default: it does not")

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        given = [k for k in ("end", "nodes", "region") if getattr(self, k) is not None]
        if len(given) != 1:
            raise ValueError(f"attachment {self.name!r}: give exactly one of end, nodes, region; got {given}")
        if self.motion and self.to is not None:
            raise ValueError(f"attachment {self.name!r}: motion is for fastenings to the world, not to {self.to!r}")
        times = [row[0] for row in self.motion]
        if any(b <= a for a, b in itertools.pairwise(times)):
            raise ValueError(f"attachment {self.name!r}: times of its motion must increase")
        return self
