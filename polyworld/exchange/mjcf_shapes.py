"""Shapes as geoms of MJCF, meshes as assets with their vertices written out."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from polyworld.exchange.mjcf_text import numbers
from polyworld.world import geometry
from polyworld.world.colors import rgb
from polyworld.world.description import Appearance
from polyworld.world.shapes import Box, Capsule, ConvexMesh, Cylinder, Plane, Sphere, TriangleMesh


class Assets:
    """The meshes of a document."""

    def __init__(self, element: ET.Element) -> None:
        self._element = element
        self._count = 0

    def add(self, vertices: Any, faces: Any) -> str:
        """Add a mesh of vertices (k, 3) and faces (m, 3), and return its name."""
        name = f"mesh{self._count}"
        self._count += 1
        corners = " ".join(str(int(v)) for v in np.ravel(faces))
        ET.SubElement(self._element, "mesh", name=name, vertex=numbers(np.ravel(vertices)), face=corners)
        return name


def add_geom(
    parent: ET.Element,
    assets: Assets,
    name: str,
    shape: Any,
    place: dict[str, str],
    appearance: Appearance,
    contact: dict[str, str],
) -> None:
    """Add a shape as a geom. place: its attributes pos and quat; contact: those of its surface."""
    given: dict[str, str] = {"name": name, **place, **contact}
    colour = rgb(appearance.color)
    if colour is not None:
        given["rgba"] = numbers((*(v / 255.0 for v in colour), 1.0))
    if isinstance(shape, Sphere):
        given |= {"type": "sphere", "size": numbers([shape.radius])}
    elif isinstance(shape, Box):
        given |= {"type": "box", "size": numbers(shape.half_extents)}
    elif isinstance(shape, Cylinder | Capsule):
        given |= {"type": shape.kind, "size": numbers([shape.radius, shape.half_height])}
    elif isinstance(shape, Plane):
        given |= {"type": "plane", "size": "0 0 1"}
    elif isinstance(shape, ConvexMesh):
        hull = geometry.hull(shape)
        given |= {"type": "mesh", "mesh": assets.add(hull.vertices, hull.faces)}
    else:
        assert isinstance(shape, TriangleMesh)
        given |= {"type": "mesh", "mesh": assets.add(shape.vertices, shape.faces)}
    ET.SubElement(parent, "geom", given)
