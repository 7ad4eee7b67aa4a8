"""One part of a world's step, each stage a function of its own module."""

import warp as wp

from polyworld.solver.planar.constraints import separate_overlaps, solve_contact_velocities
from polyworld.solver.planar.contact_effects import set_row_friction
from polyworld.solver.planar.contacts import find_contacts
from polyworld.solver.planar.forces import note_reactions, renew_pushes
from polyworld.solver.planar.impact_time import find_impacts
from polyworld.solver.planar.impacts import resolve_impacts
from polyworld.solver.planar.islands import sort_by_islands
from polyworld.solver.planar.motion import couple_bodies, find_shifts, measure_paths, predict_rates, set_free_paths
from polyworld.solver.planar.records import Bodies, Contacts, References, Samples, Scene, Step

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)


@wp.func(inline=True)  # a call would copy the records, which takes as long as the step
def set_paths(
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    samples: Samples,
    references: References,
    step: Step,
) -> Step:
    """Set the paths of the members to the end of the step, and find when they next collide."""
    step = find_contacts(references.scene, references.bodies, references.contacts, samples, step)
    if scene.contact_laws > 0:
        set_row_friction(
            references.scene, references.bodies, references.contacts, step.w, step.slot, step.half, step.active
        )
    step.islands = 0
    if step.active > 0:
        couple_bodies(scene, bodies, contacts, step)
        step.islands = sort_by_islands(scene, bodies, contacts, step)
    if step.active > 0:
        resolve_impacts(references.scene, references.bodies, references.contacts, step)
    if scene.forces > 0:
        renew_pushes(scene, bodies, contacts, references, step)
    path = wp.vec3d()
    if step.islands == 0:
        path = set_free_paths(scene, bodies, step)
    else:
        predict_rates(bodies, step)
        solve_contact_velocities(references.scene, references.bodies, references.contacts, step)
        find_shifts(bodies, step)
        separate_overlaps(references.scene, references.bodies, references.contacts, step)
        path = measure_paths(scene, bodies, step)
    if scene.forces > 0:
        note_reactions(bodies, step)
    step.alike = wp.where(step.begin == ZERO, 1, 0)
    step.longest = path[0]
    step.lost = wp.where(path[1] < ZERO, 1, step.lost)
    step.renew = wp.where(path[2] < ZERO, 1, step.renew)
    return find_impacts(scene, bodies, contacts, references, step)
