"""A material is one registry entry: one made up in a package of its own runs through everything, unchanged."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from atw_mcp.cases.material_facts import about_deformable
from atw_mcp.worlds.parts import read_part, takes
from polyworld import branch, query, rollout, simulator
from polyworld.edits.interventions import Move
from polyworld.model import mesh_of
from polyworld.pictures.render import default_camera, render
from polyworld.probing.predicates import Deformed
from polyworld.probing.readouts.kinds import Outline, Tension
from polyworld.probing.readouts.read import check_readable, read
from polyworld.world import World, materials
from polyworld.world.materials import BUILT_IN, kinds_of, register
from polyworld.world.materials import material as entry
from tests.polyworld.materials import flake
from tests.polyworld.materials.flake import Flake

ROOT = Path(__file__).parents[3]
G, K, M, R, STRETCH = 9.81, 100.0, 0.1, 0.2, 0.05
OMEGA = float(np.sqrt(3.0 * K / M))


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Register the material for one test: others see the built-in ones alone."""
    monkeypatch.setattr(materials, "_KNOWN", dict(materials._KNOWN))
    register(flake.MATERIAL)


def falling() -> World:
    item = Flake(name="flake", position=(0, 0, 3), circumradius=R, stretch=STRETCH, mass=M, stiffness=K)
    return World.model_validate({"deformables": [item.model_dump()]})


def circumradius(points: Any) -> Any:
    return np.linalg.norm(points - points.mean(axis=-2, keepdims=True), axis=-1).mean(axis=-1)


def test_it_falls_and_breathes_at_its_frequency() -> None:
    result = rollout(falling(), 0.5, sample_interval=0.01)
    times = result.trajectory.times
    points = result.trajectory.deformables["flake"].points
    np.testing.assert_allclose(points.mean(axis=1)[:, 2], 3.0 - 0.5 * G * times**2, atol=2e-3)
    np.testing.assert_allclose(circumradius(points), R * (1 + STRETCH * np.cos(OMEGA * times)), atol=0.05 * R * STRETCH)


def test_its_parameters_differ_among_the_worlds_of_a_batch() -> None:
    times = np.linspace(0.0, 0.2, 21)
    run = simulator(falling(), times, n_worlds=2).run({"objects.flake.stiffness": np.array([K, 4.0 * K])})
    slow, fast = circumradius(run.deformables["flake"].points)
    np.testing.assert_allclose(slow, R * (1 + STRETCH * np.cos(OMEGA * times)), atol=0.05 * R * STRETCH)
    np.testing.assert_allclose(fast, R * (1 + STRETCH * np.cos(2 * OMEGA * times)), atol=0.05 * R * STRETCH)


def test_readouts_of_its_form_apply_and_its_own_quantities_are_kept() -> None:
    world = falling()
    motion = rollout(world, 0.1).trajectory
    outline = Outline(object="flake", directions=((1.0, 0.0, 0.0),))
    check_readable(outline, world)
    assert read(outline, world, motion)[0, 0, 0] == pytest.approx(R * (1 + STRETCH))
    lengths = motion.deformables["flake"].quantities["spring_length"]
    assert lengths[0] == pytest.approx(np.full(3, np.sqrt(3.0) * R * (1 + STRETCH)))
    with pytest.raises(ValueError, match="tension is read off rope"):
        check_readable(Tension(object="flake"), world)


def test_statements_about_its_form_are_decided() -> None:
    world = falling()
    done = rollout(world, 0.3)
    assert query(done, world, Deformed(object="flake", strain=0.04)).value is True
    assert query(done, world, Deformed(object="flake", strain=0.5)).value is False


def test_it_is_seen_where_it_is() -> None:
    world = falling()
    points = {"flake": mesh_of(world, world.deformable("flake")).nodes}
    camera = default_camera(world, points["flake"])
    picture = render(world, np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]), camera, points=points)
    rows, columns = np.nonzero(picture.labels == 0)
    seen = camera.project(points["flake"])
    assert len(rows) > 100
    assert columns.mean() == pytest.approx(seen[:, 0].mean(), abs=2.0)
    assert rows.mean() == pytest.approx(seen[:, 1].mean(), abs=2.0)


def test_it_is_moved_described_and_built_like_any_other() -> None:
    world = falling()
    higher = branch(world, [Move(object="flake", position=(1.0, 0.0, 4.0))])
    assert mesh_of(higher, higher.deformable("flake")).nodes.mean(axis=0) == pytest.approx([1.0, 0.0, 4.0])
    facts = about_deformable(world, world.deformable("flake"))
    assert facts["facts"]["springs"] == 3
    assert facts["mass"] == pytest.approx(3 * M)
    assert "circumradius" in takes("flake")
    assert read_part("flake", {"name": "flake", "position": (0, 0, 3), "circumradius": R}).stiffness == 100.0
    again = World.model_validate_json(world.canonical_json())
    assert again.id == world.id
    assert again.deformable("flake") == world.deformable("flake")


def test_a_kind_is_registered_once() -> None:
    with pytest.raises(ValueError, match="registered already"):
        register(flake.MATERIAL)
    assert set(kinds_of("sheet")) == {"cloth", "flake"}


def test_no_file_but_its_own_knows_it() -> None:
    sources = [p for room in ("polyworld", "atw_mcp") for p in (ROOT / room).rglob("*.py")]
    assert len(sources) > 300
    assert not [p for p in sources if "flake" in p.read_text()]
    assert flake.__name__.endswith("flake")


def test_representations_are_distinguished_by_the_registry_alone() -> None:
    names = {entry(kind).description.__name__ for kind in BUILT_IN} | {"RigidObject"}
    found = []
    for room in ("polyworld", "atw_mcp"):
        for path in (ROOT / room).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Call) and ast.unparse(node.func) == "isinstance":
                    used = {n.id for n in ast.walk(node.args[1]) if isinstance(n, ast.Name)}
                    if used & names:
                        found.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert not found
