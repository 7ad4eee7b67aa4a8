"""What is too coarse says so, with the number that resolves it; what is fine enough says nothing."""

from __future__ import annotations

from typing import Any

import pytest

from polyworld import World
from polyworld.model.notes import model_notes


def soft(resolution: float | None) -> dict[str, Any]:
    """A soft ball of 0.1 m."""
    ball = {"name": "ball", "representation": "soft", "shape": {"kind": "sphere", "radius": 0.1}}
    return {"deformables": [{**ball, "position": (0, 0, 1), "youngs_modulus": 1e5, "resolution": resolution}]}


def drum(segments: int) -> dict[str, Any]:
    """A rope of 2 m across a drum of 0.1 m."""
    rope = {"name": "rope", "representation": "rope", "points": [(-1, 0, 1), (1, 0, 1)], "segments": segments}
    shape = {"kind": "cylinder", "radius": 0.1, "half_height": 0.2}
    return {"deformables": [rope], "statics": [{"name": "drum", "shape": shape, "position": (0, 0, 0.85)}]}


def pool(cell: float) -> dict[str, Any]:
    """A light ball of 0.1 m over water."""
    volume = {"shape": {"kind": "box", "half_extents": (0.2, 0.2, 0.1)}, "position": (0.2, 0.2, 0.1)}
    shape = {"kind": "sphere", "radius": 0.1}
    return {
        "objects": [{"name": "float", "shape": shape, "density": 100.0, "position": (0.2, 0.2, 0.4)}],
        "deformables": [{"name": "water", "representation": "fluid", "volumes": [volume]}],
        "fluid_grid": {"lower": (0, 0, 0), "upper": (0.4, 0.4, 0.6), "cell": cell},
    }


@pytest.mark.parametrize(
    ("coarse", "advice", "fine"),
    [
        (soft(0.1), "resolution 0.05 m", soft(0.05)),
        (drum(20), "segments 64", drum(64)),
        (pool(0.05), "fluid_grid.cell 0.04 m", pool(0.04)),
    ],
    ids=["soft ball", "rope on a drum", "body in water"],
)
def test_a_coarse_world_says_what_resolves_it(coarse: dict[str, Any], advice: str, fine: dict[str, Any]) -> None:
    notes = model_notes(World.model_validate(coarse))
    assert len(notes) == 1
    assert advice in notes[0]
    assert model_notes(World.model_validate(fine)) == ()
