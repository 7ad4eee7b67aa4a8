"""A rich effect beside another gives way to the simple one that it passes for."""

import numpy as np
from scipy.integrate import solve_ivp

from polyworld.data.recording import Array, Recording, Run
from polyworld.estimation.design import design
from polyworld.estimation.hypothesis import extended
from polyworld.gap.catalogue import named
from polyworld.gap.examine import fitted_base
from polyworld.gap.search import Search
from polyworld.gap.settings import SearchSettings
from tests.polyworld.gap_scenes import puck_world

DRAG = 0.05  # [kg/m]
TILT = np.array([0.4, -0.3])  # [m/s^2]
TABLE = puck_world(friction=0.0)


def slides() -> Recording:
    """Four slides of a puck on a tilted table, in air that drags it by the square of its speed, from SciPy."""
    rng = np.random.default_rng(11)
    mass = TABLE.objects[0].mass
    times = np.arange(90) / 60.0

    def slopes(_: float, y: Array) -> Array:
        v = y[2:]
        return np.concatenate([v, TILT - DRAG / mass * np.linalg.norm(v) * v])

    runs = []
    for k in range(4):
        start = [0.0, 0.0, *rng.uniform(-2.0, 2.0, 2)]
        path = solve_ivp(slopes, (0.0, times[-1]), start, t_eval=times, rtol=1e-9, atol=1e-11).y[:2].T
        places = np.full((90, 1, 3), np.nan)
        places[:, 0, :2] = path + rng.normal(0.0, 1e-3, path.shape)
        runs.append(Run(f"slide{k}", ("puck",), times, places, np.full((90, 1, 4), np.nan)))
    return Recording(tuple(runs))


def test_wind_that_is_still_gives_way_to_drag_beside_a_tilt() -> None:
    recording = slides()
    ground = fitted_base(design(TABLE, recording), ())
    offered = named(["quadratic_drag", "wind", "tilt", "linear_drag", "spring"])
    search = Search.begin(ground, tuple(offered), SearchSettings(), lambda *_: None, TABLE.time.substep)
    tilted = extended(ground.hypothesis, offered[2], recording)[0]
    windy = extended(tilted, offered[1], recording)[0]
    values = np.array([*TILT, DRAG] + [0.0] * (len(windy.unknowns) - 3))
    search.whole.take(ground.context.fit(windy, values, ground.fit.states))
    rich = search.best(2)
    assert rich is not None
    assert rich.passes
    search.improve(2)
    best = search.best(2)
    assert best is not None
    assert best.hypothesis.names == ("tilt", "quadratic_drag")
    assert best.passes
    assert best.ebic < rich.ebic - 5.0
    np.testing.assert_allclose(best.values, [*TILT, DRAG], rtol=0.02)
