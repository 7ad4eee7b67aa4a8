"""Bodies of several convex pieces: mass, motion, contact, events, and measures of them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.probing.closest_approach import closest_approach
from polyworld.solver.rollout import rollout
from polyworld.world import StaticObject, geometry
from polyworld.world.shapes import Box, Capsule, Compound, ConvexMesh, Cylinder, Part, Sphere, TriangleMesh
from tests.verification.spatial_world import GRAVITY, body, make_world, run

Array = NDArray[np.float64]

HALF = Box(half_extents=(0.1, 0.1, 0.1))
WHOLE = Box(half_extents=(0.2, 0.1, 0.1))
# The pieces lie off the compound's origin, which its centre of mass replaces.
HALVES = Compound(
    parts=(Part(shape=HALF, position=(0.3, 0.2, 0.0)), Part(shape=HALF, position=(0.5, 0.2, 0.0))),
)


def dumbbell(spread: float = 0.3) -> Compound:
    ball = Sphere(radius=0.1)
    return Compound(parts=(Part(shape=ball, position=(-spread, 0, 0)), Part(shape=ball, position=(spread, 0, 0))))


def bucket(radius: float = 0.2, depth: float = 0.2, wall: float = 0.02) -> Compound:
    """An open box on a square bottom, its opening along +z."""
    side, half = radius + wall / 2, depth / 2
    return Compound(
        parts=(
            Part(shape=Box(half_extents=(radius + wall, radius + wall, wall / 2)), position=(0, 0, -half - wall / 2)),
            Part(shape=Box(half_extents=(wall / 2, radius + wall, half)), position=(side, 0, 0)),
            Part(shape=Box(half_extents=(wall / 2, radius + wall, half)), position=(-side, 0, 0)),
            Part(shape=Box(half_extents=(radius, wall / 2, half)), position=(0, side, 0)),
            Part(shape=Box(half_extents=(radius, wall / 2, half)), position=(0, -side, 0)),
        )
    )


def test_two_half_boxes_have_the_mass_properties_of_the_whole() -> None:
    whole, halves = geometry.mass_properties(WHOLE), geometry.mass_properties(HALVES)
    assert halves.volume == pytest.approx(whole.volume)
    np.testing.assert_allclose(halves.inertia, whole.inertia, atol=1e-15)


def test_mass_properties_of_turned_unlike_pieces_agree_with_sampling() -> None:
    """A tilted cylinder beside a tilted box; two million points in the box around them: 0.5%."""
    turn = (0.9, 0.3, -0.2, 0.25)
    shape = Compound(
        parts=(
            Part(shape=Cylinder(radius=0.1, half_height=0.3), position=(0.5, 0.1, 0.0), orientation=turn),
            Part(shape=Box(half_extents=(0.2, 0.1, 0.15)), position=(-0.4, 0.0, 0.2), orientation=turn),
        )
    )
    points = np.random.default_rng(3).uniform(-1.0, 1.0, size=(2_000_000, 3))
    inside = np.zeros(len(points), dtype=bool)
    for part in shape.parts:
        turned = geometry.quaternion_matrix(np.asarray(part.orientation))
        local = (points - part.position) @ turned
        if isinstance(part.shape, Cylinder):
            inside |= (np.hypot(local[:, 0], local[:, 1]) < 0.1) & (np.abs(local[:, 2]) < 0.3)
        else:
            inside |= np.all(np.abs(local) < (0.2, 0.1, 0.15), axis=1)
    kept = points[inside] - points[inside].mean(axis=0)
    share = 8.0 / len(points)
    expected = share * ((kept**2).sum() * np.eye(3) - kept.T @ kept)
    found = geometry.mass_properties(shape)
    assert found.volume == pytest.approx(share * len(kept), rel=5e-3)
    np.testing.assert_allclose(found.inertia, expected, atol=5e-3 * np.abs(expected).max())


def test_a_tumbling_box_of_two_pieces_flies_and_lands_like_the_whole() -> None:
    """In the air to rounding; up to and after the first impact to 5e-6 m."""
    paths = []
    for shape in (WHOLE, HALVES):
        tumbling = body(
            "box", shape, (0, 0, 1.0), orientation=(0.9, 0.1, 0.3, 0.2), angular_velocity=(1, 2, 3), restitution=0.5
        )
        paths.append(run(make_world(tumbling), 0.6, samples=61))
    np.testing.assert_allclose(paths[1].positions, paths[0].positions, atol=5e-6)
    first, second = (p.events[0][0] for p in paths)
    assert first.kind == second.kind == "contact_begin"
    assert second.participants == ("box", "floor")
    assert second.time == pytest.approx(first.time, abs=1e-6)
    assert second.impulse == pytest.approx(first.impulse, rel=1e-4)


def test_a_dumbbell_rests_on_both_balls_and_slides_as_coulomb_says() -> None:
    """1 m/s along its axis at mu = 0.5: stops after v^2 / (2 mu g), both balls on the floor."""
    thrown = body("dumbbell", dumbbell(), (0, 0, 0.1), velocity=(1.0, 0, 0), friction=0.5)
    motion = run(make_world(thrown), 1.0)
    assert motion.positions[0, -1, 0, 0] == pytest.approx(1.0 / (2 * 0.5 * GRAVITY), rel=2e-3)
    np.testing.assert_allclose(motion.positions[0, :, 0, 2], 0.1, atol=1e-4)


def test_a_dumbbell_struck_on_one_ball_turns_about_its_centre() -> None:
    """J = (1 + e) v / (1/m1 + 1/m2 + r^2/I), as for any rigid body struck r from its centre."""
    shape = dumbbell()
    struck = body("dumbbell", shape, (0, 0, 0), restitution=1.0, friction=0.0)
    ball = body("ball", Sphere(radius=0.1), (0.3, -1.0, 0), velocity=(0, 2.0, 0), restitution=1.0, friction=0.0)
    motion = run(make_world(struck, ball, statics=(), gravity=(0, 0, 0)), 0.5)
    solid = geometry.mass_properties(shape)
    inertia = solid.inertia[2, 2] / solid.volume
    impulse = 2 * 2.0 / (2.0 + 0.3**2 / inertia)
    assert motion.velocities[0, -1, 0, 1] == pytest.approx(impulse, rel=1e-9)
    assert motion.angular_velocities[0, -1, 0, 2] == pytest.approx(impulse * 0.3 / inertia, rel=1e-9)
    assert motion.velocities[0, -1, 1, 1] == pytest.approx(2.0 - impulse, abs=1e-8)


def test_a_ball_dropped_into_a_bucket_stays_in_it() -> None:
    """Also where the bucket is pushed along; the hollow is hollow."""
    tub = body("bucket", bucket(), (0, 0, 0.2), mass=2.0, velocity=(0.5, 0, 0), friction=0.3)
    ball = body("ball", Sphere(radius=0.06), (0.05, 0.02, 0.6), restitution=0.3, velocity=(0.5, 0, 0))
    result = rollout(make_world(tub, ball), 3.0)
    last = result.trajectory.positions[-1]
    assert np.abs(last[1, :2] - last[0, :2]).max() < 0.2
    assert last[1, 2] == pytest.approx(0.02 + 0.06, abs=2e-3)
    assert ("ball", "bucket") in {e.participants for e in result.events}
    assert ("ball", "floor") not in {e.participants for e in result.events}


def test_a_compound_rests_on_a_triangle_mesh() -> None:
    corners = [(x, y, 0.0) for x in (-2.0, 0.0, 2.0) for y in (-2.0, 0.0, 2.0)]
    squares = [(i, i + 1, i + 4, i + 3) for i in (0, 1, 3, 4)]
    faces = tuple(f for a, b, c, d in squares for f in ((a, c, b), (a, d, c)))
    ground = StaticObject(name="ground", shape=TriangleMesh(vertices=tuple(corners), faces=faces))
    landing = body("box", HALVES, (0.1, 0.2, 0.3), restitution=0.0)
    motion = run(make_world(landing, statics=(ground,)), 1.0)
    np.testing.assert_allclose(motion.positions[0, -1, 0], (0.1, 0.2, 0.1), atol=1e-4)
    begins = [e for e in motion.events[0] if e.kind == "contact_begin"]
    assert len(begins) == 1
    assert begins[0].impulse == pytest.approx(np.sqrt(2 * GRAVITY * 0.2), rel=2e-2)


def test_an_impact_on_two_pieces_at_once_counts_its_impulse_once() -> None:
    """A box of two halves falls flat without rebound: m v in all, and what it weighs for the rest of the step."""
    landing = body("box", HALVES, (0, 0, 0.3), restitution=0.0)
    motion = run(make_world(landing), 0.21)
    (begin,) = [e for e in motion.events[0] if e.kind == "contact_begin"]
    assert 0.0 <= begin.impulse - np.sqrt(2 * GRAVITY * 0.2) < GRAVITY * 0.002


def test_closest_approach_is_that_of_the_nearest_pieces() -> None:
    """A ball passes through a dumbbell's middle, 0.4 m of air to either side at the narrowest."""
    still = body("dumbbell", dumbbell(1.0), (0, 0, 0))
    ball = body("ball", Sphere(radius=0.1), (0.3, -2.0, 0), velocity=(0, 4.0, 0))
    world = make_world(still, ball, statics=(), gravity=(0, 0, 0))
    result = rollout(world, 1.0)
    assert not result.events
    nearest = closest_approach(world, result.trajectory, "ball", "dumbbell", (0.0, 1.0))
    assert nearest is not None
    assert nearest.gap == pytest.approx(0.7 - 0.2, abs=1e-6)
    assert nearest.time == pytest.approx(0.5, abs=1e-3)


def test_outline_of_a_compound_is_the_hull_of_its_pieces() -> None:
    outline, radius = geometry.planar_outline(dumbbell(), np.eye(3), np.eye(3))
    assert radius == 0.0
    np.testing.assert_allclose(np.ptp(outline, axis=0), (0.8, 0.2), rtol=2e-3)
    assert geometry.circumscribed_radius(dumbbell()) == pytest.approx(0.4)


def test_pieces_of_every_kind_touch_where_their_surfaces_are() -> None:
    """Each kind as the only, displaced piece of a body comes to rest on the floor as it does alone."""
    kinds = (
        Sphere(radius=0.1),
        HALF,
        Cylinder(radius=0.1, half_height=0.1),
        Capsule(radius=0.05, half_height=0.1),
        ConvexMesh(vertices=tuple((x, y, z) for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1))),
    )
    for shape in kinds:
        alone = body("a", shape, (0, 0, 0.25), restitution=0.0, angular_velocity=(0.3, 0.2, 0.0))
        piece = Compound(parts=(Part(shape=shape, position=(0.4, -0.3, 0.2)),))
        moved = body("a", piece, (0, 0, 0.25), restitution=0.0, angular_velocity=(0.3, 0.2, 0.0))
        expected, found = (run(make_world(b), 0.4, samples=21) for b in (alone, moved))
        np.testing.assert_allclose(found.positions, expected.positions, atol=1e-6, err_msg=shape.kind)
