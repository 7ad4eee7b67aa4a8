"""One step of a world, each stage a function of its own module."""

import warp as wp

from polyworld.solver.core.episodes import Log
from polyworld.solver.planar.constraints import separate_overlaps, solve_contact_velocities
from polyworld.solver.planar.contact_effects import set_row_friction
from polyworld.solver.planar.contacts import find_contacts
from polyworld.solver.planar.episodes import record_contacts
from polyworld.solver.planar.forces import find_pushes, note_reactions, renew_pushes
from polyworld.solver.planar.impact_time import time_to_impact
from polyworld.solver.planar.impacts import resolve_impacts
from polyworld.solver.planar.joints import hold_hinges
from polyworld.solver.planar.motion import couple_bodies, find_shifts, move_bodies, predict_rates
from polyworld.solver.planar.records import Bodies, Contacts, Joints, References, Samples, Scene, Step

wp.set_module_options({"enable_backward": False})


@wp.func(inline=True)  # a call would copy the records, which takes as long as the step
def advance(
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    joints: Joints,
    log: Log,
    samples: Samples,
    references: References,
    step: Step,
) -> Step:
    """Advance a world to the end of its step or to the first impact in it; how far is the `part` of what it returns."""
    step = find_pushes(scene, bodies, joints, references, samples, step)
    if step.diverged == 1:
        return step
    step = find_contacts(scene, bodies, contacts, samples, step)
    if scene.contact_laws > 0:
        set_row_friction(references.scene, references.bodies, references.contacts, step.w, step.half, step.rows)
    if step.rows > 0:
        resolve_impacts(scene, bodies, contacts, joints, references, step)
        couple_bodies(scene, bodies, contacts, step)
    if scene.forces > 0:
        renew_pushes(scene, bodies, contacts, step)
    predict_rates(scene, bodies, step)
    if step.rows > 0 or joints.count > 0:
        solve_contact_velocities(scene, bodies, contacts, joints, step)
    find_shifts(scene, bodies, step)
    if step.rows > 0:
        separate_overlaps(scene, bodies, contacts, step)
    step.part = time_to_impact(scene, bodies, contacts, step)
    if log.record == 1:
        record_contacts(bodies, contacts, log, step)
    if scene.forces > 0:
        note_reactions(scene, bodies, step)
    moved = move_bodies(scene, bodies, step)
    if joints.count > 0:
        moved += hold_hinges(scene, bodies, contacts, joints, step)
    step.room = step.room - wp.float64(2.0) * moved
    return step
