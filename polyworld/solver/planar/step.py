"""One part of a world's step, each stage a function of its own module."""

import warp as wp

from polyworld.solver.planar.constraints import separate_overlaps, solve_contact_velocities
from polyworld.solver.planar.contact_effects import set_row_friction
from polyworld.solver.planar.contacts import find_contacts
from polyworld.solver.planar.forces import find_pushes, note_reactions, renew_pushes
from polyworld.solver.planar.impact_time import find_impacts
from polyworld.solver.planar.impacts import resolve_impacts
from polyworld.solver.planar.islands import sort_by_islands
from polyworld.solver.planar.motion import couple_bodies, find_shifts, predict_rates
from polyworld.solver.planar.records import Bodies, Contacts, Joints, References, Samples, Scene, Step

wp.set_module_options({"enable_backward": False})


@wp.func(inline=True)  # a call would copy the records, which takes as long as the step
def set_paths(
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    joints: Joints,
    samples: Samples,
    references: References,
    step: Step,
) -> Step:
    """Set the paths of the members to the end of the step, and find when they next collide."""
    step = find_pushes(scene, bodies, joints, references, samples, step)
    if step.diverged == 1:
        return step
    step = find_contacts(references.scene, references.bodies, references.contacts, samples, step)
    if scene.contact_laws > 0:
        set_row_friction(
            references.scene, references.bodies, references.contacts, step.w, step.slot, step.half, step.active
        )
    step.islands = 0
    if step.active > 0 or joints.count > 0:
        couple_bodies(scene, bodies, contacts, step)
        step = sort_by_islands(scene, bodies, contacts, joints, step)
    if step.active > 0:
        resolve_impacts(references.scene, references.bodies, references.contacts, references.joints, step)
    if scene.forces > 0:
        renew_pushes(scene, bodies, contacts, references, step)
    predict_rates(bodies, step)
    step.alike = wp.where(step.begin == wp.float64(0.0), 1, 0)
    if step.islands > 0:
        solve_contact_velocities(references.scene, references.bodies, references.contacts, references.joints, step)
    find_shifts(bodies, step)
    if step.active > 0:
        separate_overlaps(references.scene, references.bodies, references.contacts, step)
    if scene.forces > 0:
        note_reactions(bodies, step)
    return find_impacts(scene, bodies, contacts, references, step)
