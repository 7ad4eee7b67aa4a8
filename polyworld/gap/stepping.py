"""How coarsely a world may be stepped while hypotheses are compared: no finer than the noise asks for."""

from __future__ import annotations

import numpy as np

from polyworld.data.recording import Recording
from polyworld.estimation import profile
from polyworld.estimation.design import design
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.noise import measured_noise
from polyworld.world import World

HALVINGS = 4
NEGLIGIBLE = 0.05  # error of the steps, in standard deviations of the noise, that no fit can resolve
LONGEST = 0.05  # [s]


def coarsened(world: World, recording: Recording) -> World:
    """Return the world with the longest step, between its own and one a sample, whose rollouts from the data's own
    starts differ from those of half the step by less than a twentieth of the noise.

    Worlds with deformable objects keep their step: theirs is bound to their stability.
    """
    own = world.time.substep
    interval = max(float(np.median(np.diff(r.times))) for r in recording.runs if len(r.times) > 1)
    if world.coupled or interval <= own:
        return world
    plan = design(world, recording)
    noise = measured_noise(plan)
    states = profile.start_states(plan)
    settings = [Settings(r.index, np.zeros((1, 0)), states[r.index][None]) for r in plan.runs]
    steps = [min(1.001 * interval, LONGEST) / 2**k for k in range(HALVINGS + 1)]
    steps = [*(s for s in steps if s > own), own]
    finer = Forward(plan, world.with_substep(steps[-1]), ()).residuals(settings)
    best = own
    for step in reversed(steps[:-1]):
        coarser = Forward(plan, world.with_substep(step), ()).residuals(settings)
        difference = max(
            float(np.sqrt(np.mean(((a - b) / noise.sigma[r.index]) ** 2)))
            for r, a, b in zip(plan.runs, coarser, finer, strict=True)
        )
        if not difference < NEGLIGIBLE:  # also where a rollout diverged
            break
        best, finer = step, coarser
    return world.with_substep(best)
