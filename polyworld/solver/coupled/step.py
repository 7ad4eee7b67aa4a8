"""One coupling step of a shard's worlds: nodes in inner steps, then rigid bodies and fluids.

Each line launches a stage of its own module. `capture` records the launches as graphs once; `advance` runs these.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from polyworld.core import buffers, interruption
from polyworld.solver.coupled import motion, room
from polyworld.solver.coupled.stage import Paced

if TYPE_CHECKING:
    from polyworld.solver.coupled.shard import Shard

BLOCK = 8  # inner steps in one graph


def begin(shard: Shard) -> None:
    """Launch the start of a coupling step: what takes part, how many inner steps it needs, what may touch in it."""
    nodes, clock = shard.nodes, shard.clock
    buffers.launch(motion.begin_coupling_step, 1, [clock])
    buffers.launch(motion.activate, nodes.x.shape, [clock, nodes, shard.start, shard.time_scale])
    for stage in shard.stages:
        if isinstance(stage, Paced):
            stage.launch_begin(nodes, clock)
    if shard.carried is not None:
        shard.carried.launch_begin(clock)
    shard.attachments.launch_begin(nodes, clock)
    shard.contacts.launch_search(nodes, clock)


def inner(shard: Shard) -> None:
    """Launch one inner step of the nodes, and of the bodies that they push."""
    nodes, clock = shard.nodes, shard.clock
    buffers.launch(motion.begin_inner_step, shard.n_worlds, [clock])

    # Forces: weight and damping, effects, the materials' own.
    buffers.launch(motion.external_forces, nodes.x.shape, [clock, nodes, shard.damping, shard.before])
    shard.effects.launch(nodes, clock)
    for stage in shard.stages:
        stage.launch_forces(nodes, clock)
    shard.attachments.launch_forces(nodes, clock)

    # Velocities: from the forces, and warm started from the impulses of the inner step before.
    buffers.launch(motion.accelerate, nodes.x.shape, [clock, nodes])
    if shard.carried is not None:
        shard.carried.launch_velocities(clock)
    shard.attachments.launch_push(nodes, clock)
    shard.contacts.launch_push(nodes, clock)

    # Constraints: implicit parts of the materials, attachments, contacts.
    for stage in shard.stages:
        stage.launch_velocities(nodes, clock)
        if hasattr(stage, "links"):  # of ropes
            shard.attachments.launch_tensions(nodes, clock, stage.links)
    shard.attachments.launch_velocities(nodes, clock, shard.contacts.reaction)
    shard.contacts.launch_solve(nodes, clock)

    # Positions, and what follows them: twist, plastic flow.
    buffers.launch(motion.move, nodes.x.shape, [clock, nodes])
    if shard.carried is not None:
        shard.carried.launch_positions(clock)
    for stage in shard.stages:
        stage.launch_positions(nodes, clock)
    buffers.launch(motion.count_inner_step, 1, [clock])


def end(shard: Shard) -> None:
    """Launch the end of a coupling step: rigid bodies with the nodes' and fluids' push, fluids, the time."""
    nodes, clock = shard.nodes, shard.clock
    if shard.rigid is not None and shard.carried is not None:
        if shard.solids:
            shard.carried.launch_end(clock)
        if shard.fluid is not None:
            shard.fluid.apply_prediction(clock)
        shard.rigid.launch_step(clock.time, clock.h)
    if shard.fluid is not None:
        shard.fluid.step(clock)
    if shard.solids:
        shard.contacts.launch_tally()
    buffers.launch(motion.advance_time, shard.n_worlds, [clock])
    diverged = [shard.diverged_node, shard.diverged_time]
    buffers.launch(motion.find_divergence, shard.n_worlds, [clock, nodes, *diverged])


@dataclass(frozen=True)
class Graphs:
    """The launches of a coupling step as Warp graphs; block: of BLOCK inner steps."""

    begin: Any
    inner: Any
    block: Any
    end: Any


def capture(shard: Shard) -> Graphs:
    """Load the kernels and record the launches. Fluids alone have no nodes, and no inner steps."""

    def nothing(_: Shard) -> None:
        pass

    def graph(launch: Any, repeats: int = 1) -> Any:
        with buffers.capture() as captured:
            for _ in range(repeats):
                launch(shard)
        return captured.graph

    start, middle = (begin, inner) if shard.solids else (nothing, nothing)
    return Graphs(graph(start), graph(middle), graph(middle, BLOCK), graph(end))


def advance(shard: Shard) -> None:
    """Take one coupling step of `clock.h`, in as many inner steps as the slowest world needs."""
    buffers.replay(shard.prepare().begin)
    room.search_again(shard)
    graphs = shard.prepare()
    left = int(buffers.read(shard.clock.inner_steps).max()) if shard.solids else 0
    while left > 0:
        interruption.check()
        size = BLOCK if left >= BLOCK else 1
        buffers.replay(graphs.block if size == BLOCK else graphs.inner)
        left -= size
    buffers.replay(graphs.end)
