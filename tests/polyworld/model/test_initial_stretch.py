"""Ropes that start stretched: strain and tension against the length of their way."""

import numpy as np
import pytest

from polyworld.model.notes import model_notes
from tests.verification.rope_world import held, rope, world


def test_a_rope_shorter_than_its_way_is_reported_with_its_tension() -> None:
    way = 2.0 + 0.1 * np.pi
    wheel = {"name": "wheel", "rope": "rope", "centre": [0, 0, 0], "radius": 0.1, "after": 0}
    ends = [held("start"), held("end")]
    for points, pulleys, length in (([[-0.1, 0, -1], [0.1, 0, -1]], [wheel], way), ([[0, 0, 0], [3, 0, 0]], [], 3.0)):
        cord = rope(points, 20, stretch_stiffness=2e4, length=length / 1.062)
        (found,) = model_notes(world(cord, attachments=ends, pulleys=pulleys))
        assert f"rope starts stretched by 6.2 %, with a tension of 1.24e+03 N: give it length {length:.4g}" in found
        for slack in (length / 1.005, 1.1 * length, None):
            cord = rope(points, 20, length=slack)
            assert model_notes(world(cord, attachments=ends, pulleys=pulleys)) == ()


def test_a_pulley_beside_the_rope_is_refused() -> None:
    cord = rope([[0, 0, 2], [1, 0, 2]], 10)
    wheel = {"name": "wheel", "rope": "rope", "centre": [0.5, 5, 1.9], "radius": 0.1, "after": 0}
    with pytest.raises(ValueError, match="5 m beside the wheel of pulley 'wheel'"):
        model_notes(world(cord, attachments=[held("start"), held("end")], pulleys=[wheel]))
