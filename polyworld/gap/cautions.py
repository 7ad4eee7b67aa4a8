"""List what a recording leaves undetermined, whatever the verdict on it."""

from __future__ import annotations

import numpy as np

from polyworld.data.recording import Recording
from polyworld.estimation.linkage import is_held, linkages
from polyworld.estimation.readout import owner
from polyworld.world import World

FEW = 16  # instants of a series below which its noise is a guess


def cautions(world: World, recording: Recording) -> tuple[str, ...]:
    """State what no run measured and starts as the world says, and which series are too short to know their noise."""
    seen: dict[str, np.ndarray[tuple[int], np.dtype[np.bool_]]] = {}
    turned: set[str] = set()
    lengths: list[int] = []
    for run in recording.runs:
        for column, name in enumerate(run.names):
            counts = np.isfinite(run.positions[:, column]).sum(axis=0)
            seen[owner(name)] = seen.get(owner(name), np.zeros(3, dtype=bool)) | (counts > 0)
            turns = int(np.isfinite(run.orientations[:, column]).all(axis=-1).sum())
            spins = np.isfinite(run.angular_velocities[:, column]).sum(axis=0)
            if "#" not in name and (turns or spins.any()):
                turned.add(name)
            lengths += [int(n) for n in (*counts, turns, *spins) if n]
    found = [*_unmeasured(world, seen, turned), *_linked(world, set(seen))]
    if len(lengths) == 1:
        found.append("one coordinate of one run: laws of time, of place and of speed can look the same in it")
    if min(lengths, default=0) < FEW:
        found.append(
            f"series of {min(lengths, default=0)} instants are too short to separate noise from motion: the noise "
            "level, and with it the verdict and the intervals, is a guess"
        )
    return tuple(found)


def _unmeasured(
    world: World, seen: dict[str, np.ndarray[tuple[int], np.dtype[np.bool_]]], turned: set[str]
) -> list[str]:
    found = []
    for name in () if world.planar else sorted(n for n in seen if not is_held(world, n)):
        missing = ["xyz"[axis] for axis in range(3) if not seen[name][axis]]
        if missing:
            found.append(f"{' and '.join(missing)} of {name} was never measured: there it starts as the world says")
        if len(missing) < 2 and world.is_rigid(name) and name not in turned:
            spin = ", ".join(f"{v:g}" for v in world.object(name).angular_velocity)
            found.append(
                f"neither turns nor spins of {name} were measured: it starts with the described spin, ({spin}) rad/s, "
                "and what spin does, lift in flight or grip at a bounce, is right only as far as that is"
            )
    return found


def _linked(world: World, names: set[str]) -> list[str]:
    found = []
    trees = linkages(world)
    known = {link.item.name for tree in trees for link in tree.links}
    for tree in trees:
        bodies = [link.item.name for link in tree.links if link.free]
        unobserved = [name for name in bodies if name not in names]
        if unobserved and len(unobserved) < len(bodies):
            found.append(
                f"{' and '.join(unobserved)} hang together with what was measured: they start as the world says"
            )
    stuck = sorted(n for n in names if is_held(world, n) and n not in known)
    if stuck:
        found.append(
            f"{' and '.join(stuck)} are held by joints that are no tree of parallel hinges and sliders from "
            "the world outwards: they start as the world says"
        )
    return found
