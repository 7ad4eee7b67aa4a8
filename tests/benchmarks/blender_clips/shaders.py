"""Build the shader nodes of a surface."""

import numpy as np

from tests.benchmarks.video_clips.bodies import Array, Vec, vec

from .engine import Graph, Socket, Value
from .surfaces import Surface


def linear(rgb: Vec) -> Vec:
    """Convert a displayed colour to linear light."""
    return vec(to_linear(np.asarray(rgb)))


def to_linear(displayed: Array) -> Array:
    """Convert displayed values of 0 to 1 to linear light (sRGB, IEC 61966-2-1)."""
    dark = displayed <= 0.04045
    return np.asarray(np.where(dark, displayed / 12.92, ((displayed + 0.055) / 1.055) ** 2.4))


def _coordinates(graph: Graph, surface: Surface, stretch: Vec = (1.0, 1.0, 1.0)) -> Socket:
    """Return coordinates in features: object space in m, or the uv map, times scale and stretch."""
    base = graph.add("ShaderNodeTexCoord").out("UV" if surface.uv else "Object")
    factor = tuple(surface.scale * s for s in stretch)
    turn = (np.pi / 2, 0.0, 0.0) if surface.upright else (0.0, 0.0, 0.0)
    inputs: dict[str, Value] = {"Vector": base, "Scale": factor, "Rotation": turn}
    return graph.add("ShaderNodeMapping", inputs, vector_type="POINT").out()


def _noise(graph: Graph, at: Socket, scale: float, detail: float = 3.0, distortion: float = 0.0) -> Socket:
    inputs: dict[str, Value] = {"Vector": at, "Scale": scale, "Detail": detail, "Distortion": distortion}
    return graph.add("ShaderNodeTexNoise", inputs).out(0)


def _bricks(
    graph: Graph, at: Socket, a: Vec, b: Vec, joint: Vec, shape: tuple[float, float], gap: float
) -> list[Socket]:
    node = graph.add(
        "ShaderNodeTexBrick",
        {
            "Vector": at,
            "Color1": a,
            "Color2": b,
            "Mortar": joint,
            "Scale": 1.0,
            "Mortar Size": gap,
            "Mortar Smooth": 0.3,
            "Brick Width": shape[0],
            "Row Height": shape[1],
        },
    )
    return [node.out("Color"), node.out(1)]


def _mixed(graph: Graph, factor: Socket | float, a: Socket, b: Socket, how: str) -> Socket:
    node = graph.add("ShaderNodeMix", {0: factor, 6: a, 7: b}, data_type="RGBA", blend_type=how)
    return node.out(2)


def _pattern(graph: Graph, s: Surface) -> tuple[Socket | Vec, Socket | None]:
    """Return the colour and the height (0 to 1) of a pattern."""
    a, b = linear(s.rgb), linear(s.second)
    if s.pattern in ("noise", "carpet", "marble", "grain", "weave", "stripes"):
        if s.pattern == "noise":
            f = _noise(graph, _coordinates(graph, s), 1.0, 5.0)
            return graph.ramp(f, b, a, 0.35, 0.65), f
        if s.pattern == "carpet":
            f = _noise(graph, _coordinates(graph, s), 1.0, 2.0)
            return graph.ramp(f, b, a, 0.3, 0.65), f
        if s.pattern == "marble":
            f = _noise(graph, _coordinates(graph, s), 1.0, 6.0, 2.5)
            return graph.ramp(f, b, a, 0.44, 0.56), None
        if s.pattern == "grain":
            f = _noise(graph, _coordinates(graph, s, (0.35, 4.0, 4.0)), 1.0, 6.0, 0.6)
            return graph.ramp(f, b, a, 0.35, 0.65), f
        if s.pattern == "weave":
            at = _coordinates(graph, s)
            f = graph.add("ShaderNodeTexChecker", {"Vector": at, "Scale": 1.0}).out("Fac")
            return graph.ramp(f, a, b), f
        wave = graph.add("ShaderNodeTexWave", {"Vector": _coordinates(graph, s), "Scale": 0.314}, bands_direction="X")
        return graph.ramp(wave.out("Fac"), a, b, 0.45, 0.55), None
    if s.pattern == "checker":
        node = graph.add(
            "ShaderNodeTexChecker", {"Vector": _coordinates(graph, s), "Color1": a, "Color2": b, "Scale": 1.0}
        )
        return node.out("Color"), None
    if s.pattern in ("speckle", "patches"):
        cells = graph.add("ShaderNodeTexVoronoi", {"Vector": _coordinates(graph, s), "Scale": 1.0})
        if s.pattern == "speckle":
            return graph.ramp(cells.out("Distance"), b, a, 0.28, 0.34), None
        value = graph.add("ShaderNodeSeparateColor", {0: cells.out("Color")}).out(0)
        return graph.ramp(value, a, b, 0.62, 0.64), None
    if s.pattern in ("planks", "tiles", "brick"):
        at = _coordinates(graph, s)
        if s.pattern == "tiles":
            color, gap = _bricks(graph, at, a, vec(0.92 * np.asarray(a)), b, (1.0, 1.0), 0.02)
            return color, gap
        if s.pattern == "brick":
            color, gap = _bricks(graph, at, a, vec(0.6 * np.asarray(a)), b, (1.0, 0.35), 0.025)
            return color, gap
        color, gap = _bricks(graph, at, a, b, vec(0.25 * np.asarray(b)), (8.0, 1.0), 0.012)
        f = _noise(graph, _coordinates(graph, s, (0.5, 7.0, 7.0)), 1.0, 6.0, 0.5)
        streaks = graph.ramp(f, (0.62, 0.6, 0.58), (1.0, 1.0, 1.0), 0.3, 0.7)
        return _mixed(graph, 1.0, color, streaks, "MULTIPLY"), gap
    return a, None


def paint(surface: Surface, name: str = "surface") -> Graph:
    """Make the material of a surface."""
    graph = Graph(name)
    color, height = _pattern(graph, surface)
    inputs: dict[str, Value] = {
        "Base Color": color,
        "Roughness": surface.roughness,
        "Metallic": surface.metallic,
        "Coat Weight": surface.coat,
        "Coat Roughness": 0.08,
    }
    if surface.skin:
        inputs["Specular IOR Level"] = 0.35
        inputs["Sheen Weight"] = 0.15
    if height is not None and surface.bump > 0:
        invert = surface.pattern in ("tiles", "brick", "planks")
        bump = graph.add("ShaderNodeBump", {"Height": height, "Distance": surface.bump, "Strength": 0.9}, invert=invert)
        inputs["Normal"] = bump.out()
    graph.finish(graph.add("ShaderNodeBsdfPrincipled", inputs).out())
    return graph
