"""Numbers that no quantity of a world can have are refused, with the range it may have; moons and cells are not."""

from __future__ import annotations

from typing import Any

import pytest

from polyworld.world import World

BALL = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "position": (0.0, 0.0, 1.0)}


@pytest.mark.parametrize(
    ("world", "says"),
    [
        ({"objects": [{**BALL, "position": (1e300, 0.0, 0.0)}]}, "objects.ball.position has the value 1e.300.*1e.09 m"),
        ({"objects": [{**BALL, "velocity": (0.0, -1e12, 0.0)}]}, "objects.ball.velocity.*at most 3e.08 m/s"),
        ({"objects": [{**BALL, "mass": 1e-300}]}, "objects.ball.mass.*1e-24 to 1e.28 kg"),
        ({"objects": [{**BALL, "shape": {"kind": "sphere", "radius": 1e-200}}]}, "objects.ball.shape.radius.*1e-09 to"),
        ({"time": {"substep": 1e-12}}, "time.substep has the value 1e-12.*1e-08 to 10000 s"),
        ({"environment": {"gravity": (0.0, 0.0, -1e20)}}, "environment.gravity.*m/s.2"),
        ({"effects": [{"name": "a", "kind": "linear_drag", "parameters": {"coefficient": 1e200}}]}, "coefficient"),
        ({"deformables": [{"name": "r", "representation": "rope", "points": [(0, 0, 0), (1e50, 0, 0)]}]}, "r.points"),
        (
            {
                "deformables": [
                    {
                        "name": "r",
                        "representation": "rope",
                        "points": [(float(i), 0.0, 1e10 * (i == 70)) for i in range(90)],
                    }
                ]
            },
            "1e.10",
        ),
    ],
)
def test_an_impossible_number_is_refused_with_its_range(world: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        World.model_validate(world)


def test_worlds_of_moons_and_of_cells_are_worlds() -> None:
    moon = {
        "name": "moon",
        "shape": {"kind": "sphere", "radius": 1.7e6},
        "mass": 7.3e22,
        "position": (3.8e8, 0.0, 0.0),
        "velocity": (0.0, 1.0e3, 0.0),
    }
    cell = {"name": "cell", "shape": {"kind": "sphere", "radius": 5e-6}, "mass": 1e-12, "position": (1e-6, 0.0, 0.0)}
    World.model_validate({"objects": [moon], "environment": {"gravity": (0.0, 0.0, 0.0)}})
    World.model_validate({"objects": [cell], "time": {"substep": 1e-6}})
