"""A world is made into a model once: equal worlds share it, changed ones do not."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.model import mesh_of, model_of
from polyworld.world import World
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Pulley, Rope
from polyworld.world.shapes import Sphere


def world(length: float = 1.0) -> World:
    sheet = Sheet(corner=(0, 0, 1), edge_u=(length, 0, 0), edge_v=(0, 2, 0), divisions=(2, 3))
    rope = Rope(name="rope", points=((-1, 0, 0), (1, 0, 0)), segments=20)
    return World(
        objects=(RigidObject(name="ball", shape=Sphere(radius=0.5), position=(5, 0, 0)),),
        deformables=(Cloth(name="flag", geometry=sheet), rope),
        pulleys=(Pulley(name="wheel", rope="rope", centre=(0, 0, -0.5), radius=0.5, after=0, turns_positive=False),),
    )


def test_equal_worlds_have_one_model_and_changed_ones_another() -> None:
    assert model_of(world()) is model_of(World.model_validate_json(world().canonical_json()))
    assert model_of(world()).mesh("flag") is model_of(world()).mesh("flag")
    wide = model_of(world(3.0)).mesh("flag")
    assert np.ptp(wide.nodes[:, 0]) == pytest.approx(3.0)
    assert np.ptp(model_of(world()).mesh("flag").nodes[:, 0]) == pytest.approx(1.0)


def test_sizes_and_solids_are_those_of_the_shapes() -> None:
    model = model_of(world())
    assert model.size("flag") == pytest.approx(2.0)
    assert model.size("rope") >= 2.0  # what lies on its wheel belongs to it
    assert model.solids[0].volume == pytest.approx(4.0 / 3.0 * np.pi * 0.5**3)
    assert model.names == ("ball", "flag", "rope")
    assert model.meshes["rope"] is mesh_of(model.world, model.world.deformable("rope"))


def test_an_unknown_name_is_refused_with_the_choices() -> None:
    with pytest.raises(KeyError, match=r"unknown deformable object 'sail'; deformables: \['flag', 'rope'\]"):
        model_of(world()).mesh("sail")


def test_nodes_of_sheets_and_ropes_are_numbered_as_the_schema_says() -> None:
    """Node i (nv + 1) + j of a sheet lies i along u and j along v; a rope's begin at its start."""
    found = world()
    nodes = mesh_of(found, found.deformables[0]).nodes
    np.testing.assert_allclose(nodes[1 * 4 + 2], (0.5, 2 * 2 / 3, 1), atol=1e-12)
    np.testing.assert_allclose(nodes[[0, 3, 8, 11]], [(0, 0, 1), (0, 2, 1), (1, 0, 1), (1, 2, 1)], atol=1e-12)
    rope = mesh_of(found, found.deformables[1]).nodes
    assert len(rope) == 21
    np.testing.assert_allclose(rope[[0, 20]], [(-1, 0, 0), (1, 0, 0)], atol=1e-12)
