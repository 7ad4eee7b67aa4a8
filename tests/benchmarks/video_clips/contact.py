"""Convert a coefficient of restitution into the simulator's contact stiffness and damping."""

from functools import lru_cache

import numpy as np

from .bodies import DT

STIFFNESS = 3.6e5  # 1/s^2: a contact lasts about 5 ms, one restitution scatters by about 0.03


@lru_cache(maxsize=1)
def _table() -> tuple[list[float], list[float]]:
    """Step x'' = max(0, -x - 2 z x') through one contact as the simulator does, for a range of damping ratios z.

    The rebound depends on where in a step the contact begins; the table averages over that.
    """
    ratios = np.concatenate([np.linspace(0.0, 0.4, 81), np.linspace(0.42, 1.6, 40)])
    h = DT * np.sqrt(STIFFNESS)
    out = []
    for z in ratios:
        x = -h * (np.arange(40) + 0.5) / 40
        v = -np.ones(40)
        for _ in range(60):
            v = v + np.where(x < 0.0, h * np.maximum(0.0, -x - 2.0 * z * v), 0.0)
            x = x + h * v
        out.append(max(float(v.mean()), 0.0))
    order = np.argsort(out)
    return [out[i] for i in order], [float(ratios[i]) for i in order]


def solref(restitution: float) -> str:
    """Return the simulator's (-stiffness, -damping) text for a coefficient of restitution between 0 and 1."""
    values, ratios = _table()
    ratio = float(np.interp(restitution, values, ratios))
    return f"{-STIFFNESS:.1f} {-2.0 * ratio * np.sqrt(STIFFNESS):.4f}"
