"""A ball in free flight, whose motion is linear in its initial state: fits in closed form, without the engine."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import Design, design
from polyworld.estimation.noise import Noise
from polyworld.estimation.normal_equations import Linearised
from polyworld.estimation.profile import Fit
from polyworld.world import World

Array = NDArray[np.float64]
Draw = Callable[[np.random.Generator, tuple[int, int], float], Array]

G = 9.81
ERRORS = np.zeros((0, 0))


def white(rng: np.random.Generator, shape: tuple[int, int], sigma: float) -> Array:
    return rng.normal(0.0, sigma, shape)


def correlated(rng: np.random.Generator, shape: tuple[int, int], sigma: float, phi: float = 0.9) -> Array:
    steps = rng.normal(0.0, sigma * np.sqrt(1.0 - phi**2), (shape[0] + 300, shape[1]))
    result: Array = lfilter([1.0], [1.0, -phi], steps, axis=0)[300:]
    return result


def with_outliers(rng: np.random.Generator, shape: tuple[int, int], sigma: float) -> Array:
    far = rng.uniform(size=shape) < 0.02
    return white(rng, shape, sigma) + 10.0 * sigma * far * rng.choice([-1.0, 1.0], shape)


def flight_design(
    rng: np.random.Generator,
    draw: Draw = white,
    sigma: float = 0.001,
    *,
    runs: int = 8,
    count: int = 192,
    rate: float = 120.0,
    push: Array | None = None,
    since: float = 0.0,
) -> Design:
    """Runs of a flying ball; push (3,) [m/s^2] is an acceleration that the world does not know, from `since` [s] on."""
    times = np.arange(count) / rate
    late = np.maximum(times - since, 0.0)
    extra = np.zeros(3) if push is None else push
    made = []
    for k in range(runs):
        place, speed = rng.uniform(10.0, 20.0, 3), rng.uniform(-3.0, 3.0, 3)
        path = place + speed * times[:, None] + 0.5 * np.outer(late**2, extra)
        path[:, 2] -= 0.5 * G * times**2
        seen = path + draw(rng, path.shape, sigma)
        made.append(Run(f"run{k}", ("ball",), times, seen[:, None], np.full((count, 1, 4), np.nan)))
    return design(flight_world(), Recording(tuple(made)))


def flight_world() -> World:
    return World.model_validate(
        {"objects": [{"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0, 0, 1]}]}
    )


def flight_fit(plan: Design, noise: Noise) -> tuple[Fit, list[Array]]:
    """Generalised least squares under a noise: the fit, and the raw residuals of every run."""
    r, b, states, left = [], [], [], []
    for own in plan.runs:
        slopes, offset = np.zeros((own.length, own.count)), np.zeros(own.length)
        for s in own.series:
            t = own.times[s.rows]
            label = "xyz"[s.axis]
            slopes[s.where, own.labels.index(f"ball.position.{label}")] = 1.0
            slopes[s.where, own.labels.index(f"ball.velocity.{label}")] = t
            offset[s.where] = (-0.5 * G * t**2 if s.axis == 2 else 0.0) - own.run.positions[s.rows, 0, s.axis]
        wide = noise.whiten(own.index, slopes.T).T
        state = -np.linalg.lstsq(wide, noise.whiten(own.index, offset), rcond=None)[0]
        raw = offset + slopes @ state
        r.append(noise.whiten(own.index, raw))
        b.append(wide)
        states.append(state)
        left.append(raw)
    linear = Linearised(tuple(r), tuple(np.zeros((len(x), 0)) for x in r), tuple(b))
    return Fit(np.zeros(0), tuple(states), linear.chi2, ERRORS, linear, True, 1, 0), left
