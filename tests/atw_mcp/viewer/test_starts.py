"""A world that was not run is shown where each object begins."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from atw_mcp.viewer import parts
from atw_mcp.viewer.packing import Blocks
from atw_mcp.viewer.worlds import world_view
from polyworld.model import mesh_of
from polyworld.world import World
from tests.atw_mcp.viewer import scenes

ABOUT: dict[str, Any] = {"label": "", "origin": "built", "parent": None, "committed": False}


def numbers(blocks: Blocks, block: parts.Block) -> NDArray[Any]:
    kind = np.dtype(block.dtype)
    flat: NDArray[Any] = np.frombuffer(blocks.joined(), kind, int(np.prod(block.shape)), block.offset)
    return flat.reshape(block.shape)


@pytest.mark.parametrize("name", ["joints", "soft", "tap"])
def test_world_without_a_rollout_has_its_start(name: str) -> None:
    world: World = scenes.SCENES[name]().world
    blocks = Blocks()
    start = world_view(world, blocks, dict.fromkeys(world.moving_names, "#000000"), **ABOUT).start
    assert start is not None
    assert tuple(start.names) == world.moving_names
    places = numbers(blocks, start.positions)[0]
    for item in world.objects:
        assert_allclose(places[start.names.index(item.name)], item.position, atol=1e-6)
    assert numbers(blocks, start.active).all()
    for item in world.deformables:
        (found,) = (d for d in start.deformed if d.name == item.name)
        assert_allclose(numbers(blocks, found.points)[0], mesh_of(world, item).nodes, atol=1e-6)
