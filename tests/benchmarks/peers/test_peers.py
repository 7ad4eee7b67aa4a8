"""The measures of the comparison with peers, against known answers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import ellipk

from tests.benchmarks.peers import growth, measures, scenes
from tests.benchmarks.peers.__main__ import SECTIONS, chosen
from tests.benchmarks.peers.accuracy import slide_length
from tests.benchmarks.peers.markdown import markdown
from tests.benchmarks.peers.polyworld_engine import PolyWorld
from tests.benchmarks.peers.table import Table


def test_exponent_is_that_of_the_upper_half() -> None:
    sizes = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0]
    assert growth.exponent(sizes, [1.0, 1.0, 1.0, 64.0, 256.0, 1024.0]) == pytest.approx(2.0)
    assert math.isnan(growth.exponent(sizes, [0.0] * 6))


def test_reference_chain_of_one_rod_swings_as_a_pendulum() -> None:
    moment = (scenes.ROD / 2) ** 2 * 4 / 3 + scenes.THIN**2 / 3
    period = 4 * ellipk(math.sin(0.25) ** 2) * math.sqrt(moment / (scenes.GRAVITY * scenes.ROD / 2))
    angles = measures.chain_angles(1, 0.5, np.array([0.0, period / 4, period / 2, period]))
    assert angles[:, 0] == pytest.approx([0.5, 0.0, -0.5, 0.5], abs=1e-8)


@pytest.mark.parametrize("planar", [True, False])
def test_chain_follows_the_reference_and_keeps_its_energy(planar: bool) -> None:
    scene = scenes.chain(3, 0.5)
    run = PolyWorld(planar=planar).prepare(scene, 1, 0.02, 1)
    run.run()
    motion = run.motion()
    assert measures.chain_error(scene, motion, 0.5) < 1e-3
    assert measures.chain_drift(scene, motion) < 1e-3


def test_cube_slides_as_far_as_friction_lets_it() -> None:
    assert slide_length(PolyWorld(planar=True)) == pytest.approx(4 / (2 * 0.2 * scenes.GRAVITY), rel=1e-3)


def test_balls_of_a_pile_start_apart_and_in_the_box() -> None:
    for count in (2, 16, 64):
        for upright in (True, False):
            scene = scenes.pile(count, 0.0, upright=upright, duration=1.0)
            x = np.array([body.position for body in scene.bodies])
            nothing = np.zeros((1, count, 3))
            still = scenes.Motion(np.zeros(1), x[None], nothing, nothing, np.zeros((1, count, 3, 3)))
            assert measures.penetration(scene, still) <= 0.0
            assert len(scene.bodies) == count


def test_terrain_has_the_height_of_its_triangles() -> None:
    terrain = scenes.terrain(1, 1.0).terrain
    assert terrain is not None
    vertices, faces = terrain.mesh()
    corners = vertices[faces]
    assert np.all(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0), "seen from above"
    inside = corners.mean(axis=1)
    assert terrain.height(inside[:, :2]) == pytest.approx(inside[:, 2], abs=1e-12)


def test_sections_are_named_by_their_beginnings() -> None:
    assert chosen(None) == SECTIONS
    assert chosen("growth,real") == ("real_motion", "growth")
    with pytest.raises(SystemExit, match="no section is called speed"):
        chosen("speed")


def test_tables_have_columns_of_equal_width() -> None:
    text = markdown(Table("Title", "note", ("a", "long column"), (("wide cell", "1"), ("b", "2"))))
    lines = text.splitlines()
    assert lines[:4] == ["### Title", "", "note", ""]
    assert len({len(line) for line in lines[4:]}) == 1
