import numpy as np
import pytest
import warp as wp

from polyworld.core import buffers
from polyworld.solver.coupled.surface_grid import Grid, bucket_at, make_grid, sort_points, span_of, visited


@wp.kernel(enable_backward=False)
def look(
    grid: Grid,
    low: wp.array[wp.vec3d],
    high: wp.array[wp.vec3d],
    seen: wp.array2d[wp.int32],
    visits: wp.array[wp.int32],
) -> None:
    sort_points(grid, 0)
    for q in range(low.shape[0]):
        span = span_of(grid, 0, low[q], high[q])
        visits[q] = span.visits
        for visit in range(span.visits):
            bucket = bucket_at(grid, span, visit)
            for s in range(grid.start[0, bucket], grid.start[0, bucket + 1]):
                item = grid.items[0, s]
                if visited(grid, 0, item, span, visit):
                    seen[q, item] = seen[q, item] + 1


@pytest.mark.parametrize("spread", [1.0, 1e6])
def test_a_box_of_any_size_shows_each_of_its_points_once_in_few_visits(spread: float) -> None:
    # What flies apart asks for boxes of 1e20 cells: a rollout once stood for an hour in one of them.
    rng = np.random.default_rng(0)
    points = spread * rng.normal(size=(60, 3))
    centre, half = spread * rng.normal(size=(20, 3)), 10.0 ** rng.uniform(-1, 7, (20, 1))
    grid = make_grid(1, 60, 0.5)
    buffers.assign(grid.point, points[None])
    seen, visits = buffers.zeros((20, 60), wp.int32), buffers.zeros((20,), wp.int32)
    boxes = [buffers.array(centre + s * half, wp.vec3d) for s in (-1.0, 1.0)]
    buffers.launch(look, 1, [grid, *boxes, seen, visits])
    inside = (np.abs(points[None] - centre[:, None]) <= half[:, None]).all(axis=2)
    assert inside.sum() > 100
    assert (seen.numpy()[inside] == 1).all()
    assert seen.numpy().max() == 1
    assert visits.numpy().max() <= 8 * 128
