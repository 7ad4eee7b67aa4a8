"""List what a recording leaves undetermined, whatever the verdict on it."""

from __future__ import annotations

from polyworld.estimation.design import Design, owner
from polyworld.estimation.linkage import is_held, linkages
from polyworld.estimation.predictability import swings_on_others
from polyworld.estimation.run_segments import MOST
from polyworld.gap.single_coordinate import is_single_coordinate

FEW = 16  # instants of a series below which its noise is a guess


def cautions(plan: Design) -> tuple[str, ...]:
    """State what no run measured and starts as the world says, and which series are too short to know their noise."""
    found = []
    measured = {(owner(s.name), s.axis) for s in plan.series if s.kind == "position"}
    turned = {owner(s.name) for s in plan.series if s.kind != "position"}
    names = sorted({name for name, _ in measured})
    held = {name for name in names if is_held(plan.world, name)}
    for name in () if plan.world.planar else [n for n in names if n not in held]:
        missing = ["xyz"[axis] for axis in range(3) if (name, axis) not in measured]
        if missing:
            found.append(f"{' and '.join(missing)} of {name} was never measured: there it starts as the world says")
        if len(missing) < 2 and plan.world.is_rigid(name) and name not in turned:
            spin = ", ".join(f"{v:g}" for v in plan.world.object(name).angular_velocity)
            found.append(
                f"neither turns nor spins of {name} were measured: it starts with the described spin, ({spin}) rad/s, "
                "and what spin does, lift in flight or grip at a bounce, is right only as far as that is"
            )
    trees = linkages(plan.world)
    known = {link.item.name for tree in trees for link in tree.links}
    stuck = sorted(held - known)
    there = {name for run in plan.recording.runs for name in run.names}
    for tree in trees:
        bodies = [link.item.name for link in tree.links if link.free]
        unobserved = [name for name in bodies if name not in there]
        if unobserved and len(unobserved) < len(bodies):
            found.append(
                f"{' and '.join(unobserved)} hang together with what was measured: they start as the world says"
            )
    if stuck:
        found.append(
            f"{' and '.join(stuck)} are held by joints that are no tree of parallel hinges and sliders from "
            "the world outwards: they start as the world says"
        )
    if plan.world.planar and not plan.world.coupled and any(j.kind == "hinge" for j in plan.world.joints):
        found.append(
            "hinges of a planar world turn freely: damping, friction and motors of joints are not among the effects "
            "that were tried; describe the objects as rigid_spatial, with the hinges' axes, to have them tried"
        )
    if is_single_coordinate(plan):
        found.append("one coordinate of one run: laws of time, of place and of speed can look the same in it")
    whole = sorted({r.run.part_of for r in plan.runs if r.run.part_of is not None})
    for name in whole:
        lengths = [len(r.times) for r in plan.runs if r.run.part_of == name]
        long = sum(lengths) > MOST
        why = "long" if long else "too chaotic to be predicted as a whole"
        if long and swings_on_others(plan.world):
            why = "long, or too chaotic to be predicted as a whole"
        found.append(
            f"run {name} is {why}: it was fitted in {len(lengths)} parts of {min(lengths)} to {max(lengths)} instants, "
            "each with an initial state of its own; what shows only over a longer time was not asked"
        )
    shortest = min((len(s.rows) for s in plan.series), default=0)
    if shortest < FEW:
        found.append(
            f"series of {shortest} instants are too short to separate noise from motion: the noise level, and with it "
            "the verdict and the intervals, is a guess"
        )
    return tuple(found)
