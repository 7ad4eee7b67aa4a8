"""How far a rollout is from the measured positions, as the page shows it."""

from __future__ import annotations

from atw_mcp.probing.misfits import misfits
from atw_mcp.viewer import document as view
from atw_mcp.viewer.packing import Blocks
from polyworld.data.tracks import ObservedTracks
from polyworld.trajectory import Trajectory
from polyworld.world import World


def misfits_view(world: World, run: Trajectory, tracks: ObservedTracks, blocks: Blocks) -> list[view.Misfit]:
    """Return the distance of each object to its track; tracks: in the time base of the world."""
    return [
        view.Misfit(
            object=misfit.name,
            times=blocks.floats(misfit.times),
            distance=blocks.floats(misfit.distance),
            sigmas=blocks.floats(misfit.sigmas),
            rms=misfit.rms,
        )
        for misfit in misfits(world, run, tracks)
    ]
