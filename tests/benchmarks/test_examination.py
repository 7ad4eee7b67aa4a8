"""Parts by which the policy of the examination describes pulleys, ropes and cloth move as closed forms say."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from tests.atw_mcp.clips import write_tracks
from tests.atw_mcp.session import Session
from tests.benchmarks.examination import _known, pulley

SCENE = {"seconds_per_frame": 0.04}
COMMON = {"calibration": [], "side_view": True, "floor_height": 0.0, "fixed": [], "strings": []}
G = 9.81  # [m/s^2]


@pytest.fixture(autouse=True)
def _allowed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ATW_MCP_ALLOW", str(tmp_path))


def ends(folder: Path, arguments: dict[str, Any], places: dict[str, list[float]], seconds: float) -> dict[str, Any]:
    """Build a world of bodies at places, run it, and return where what is rigid ends, and its deformable objects."""
    session, path = Session(folder / "atw.db"), write_tracks(folder / "slide.csv")
    session("OpenCase", data=str(path), name="scene")
    objects = [{**item, "position": places[item["name"]]} for item in arguments["objects"]]
    for item in objects:
        if item.pop("across", False):  # its axis, z of its own, along y
            item["orientation"] = [math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0]
    facts = {name: arguments[name] for name in ("motion_plane", "floor", "seconds_per_frame")}
    built = session("BuildWorld", case="scene", only=[], objects=objects, **facts, **arguments["build"])
    session("CommitWorld", case="scene", world=built["data"]["world"])
    rolled = session("Rollout", case="scene", horizon_seconds=seconds)
    found = {row["object"]: row["end"] for row in rolled["data"]["objects"] if row.get("end")}
    return {**found, "deformables": built["data"]["deformables"]}


def body(name: str, shape: dict[str, Any], mass: float) -> dict[str, Any]:
    return {"name": name, "shape": shape, "color": name.split("_")[0], "material": "metal", "mass": mass}


def test_weights_on_the_string_accelerate_as_atwood_computed(tmp_path: Path) -> None:
    light, heavy, wheel, half = 0.5, 0.6, 0.1, 0.06
    shape = {"kind": "cylinder", "radius": half, "half_height": half}
    fixed = [{"name": "pulley", "kind": "pulley", "position": [0.0, 0.0, 2.0], "radius": wheel}]
    strings = [{"over": "pulley", "objects": ["blue_weight", "red_weight"]}]
    objects = [body("red_weight", shape, light), body("blue_weight", shape, heavy)]
    scene = {**SCENE, "known": {**COMMON, "fixed": fixed, "strings": strings, "objects": objects}}
    places = {"red_weight": [-wheel, 0.0, 0.6], "blue_weight": [wheel, 0.0, 1.1]}
    found = ends(tmp_path, {**_known(scene), **pulley(scene, places)}, places, 0.4)
    rise = G * (heavy - light) / (heavy + light) * 0.4**2 / 2.0
    assert found["red_weight"][2] == pytest.approx(0.6 + rise, abs=0.003)
    assert found["blue_weight"][2] == pytest.approx(1.1 - rise, abs=0.003)
    length = math.pi * wheel + (2.0 - 0.6 - half) + (2.0 - 1.1 - half)
    assert found["deformables"][0]["length"] == pytest.approx(length, rel=0.005)


def test_a_rope_bears_its_bead_and_a_cloth_its_weight(tmp_path: Path) -> None:
    """Both hang as they are described; a rope stretches by its weights over its stiffness."""
    ball = {"kind": "sphere", "radius": 0.03}
    rope = {"name": "rope", "top": [0.0, 0.0, 1.5], "length": 0.8, "mass": 0.15, "bead_at_end": "red_bead"}
    scene = {**SCENE, "known": {**COMMON, "soft": rope, "objects": [body("red_bead", ball, 0.1)]}}
    folder = tmp_path / "rope"
    folder.mkdir()
    found = ends(folder, _known(scene), {"red_bead": [0.0, 0.0, 0.7]}, 0.4)
    assert found["red_bead"] == pytest.approx([0.0, 0.0, 0.7], abs=0.003)
    cloth = {"name": "cloth", "top": [0.0, 0.0, 1.5], "length": 0.7, "mass": 0.17}
    far = [2.0, 0.0, 0.03]
    scene = {**SCENE, "known": {**COMMON, "soft": cloth, "objects": [body("red_bead", ball, 0.1)]}}
    folder = tmp_path / "cloth"
    folder.mkdir()
    found = ends(folder, _known(scene), {"red_bead": far}, 0.2)
    assert found["red_bead"] == pytest.approx(far, abs=0.001)
    (about,) = found["deformables"]
    assert about["mass"] == pytest.approx(0.17, rel=1e-6)
    assert about["held_by"] == ["end_0"]
    assert found["cloth"][2] == pytest.approx(1.5 - 0.35, abs=0.02)


def test_what_floats_in_a_tank_stays_as_deep_as_archimedes_says(tmp_path: Path) -> None:
    """Both bodies are as deep as the tank and half as dense as water; they begin where they float."""
    size, deep, level = 0.06, 0.12, 0.2
    flat = [4 * size**2, math.pi * size**2]
    shapes = [
        {"kind": "box", "half_extents": [2 * size, deep / 2, size / 2]},
        {"kind": "cylinder", "radius": size, "half_height": deep / 2},
    ]
    names = ["red_plank", "blue_roller"]
    objects = [body(n, s, 500.0 * a * deep) for n, s, a in zip(names, shapes, flat, strict=True)]
    sides = {"x": [0.0, 1.0], "y": [-deep / 2, deep / 2], "z": [0.0, 0.4]}
    water = {"tank": sides, "at_first": {"x": [0.0, 1.0], "z": [0.0, level]}, "density": 1000.0}
    scene = {**SCENE, "known": {**COMMON, "water": water, "objects": objects}}
    places = {"red_plank": [0.3, 0.0, level], "blue_roller": [0.7, 0.0, level]}
    found = ends(tmp_path, _known(scene), places, 0.4)
    for name in names:
        assert found[name][2] == pytest.approx(level, abs=0.008)
