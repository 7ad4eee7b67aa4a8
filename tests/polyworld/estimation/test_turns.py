"""Turns counted on beyond half a turn, held against the turns that bodies of known spin have made."""

import numpy as np
from scipy.spatial.transform import Rotation

from polyworld.estimation.rotation_counting import counted_angles, counted_vectors
from polyworld.world.symmetry import rotation_vector

TIMES = np.arange(0.0, 1.5, 1 / 60)


def turned(axis, angle):
    """Orientations (m, 4) after angles (m,) about an axis."""
    unit = np.asarray(axis) / np.linalg.norm(axis)
    return Rotation.from_rotvec(angle[:, None] * unit).as_quat(scalar_first=True)


def counted(simulated, observed):
    return counted_vectors(rotation_vector(simulated[None], observed), simulated[None], observed)[0]


def test_a_body_that_spins_too_fast_is_turns_ahead_by_the_end():
    axis = np.array([0.6, 0.0, 0.8])
    vectors = counted(turned(axis, 25.0 * TIMES), turned(axis, 12.0 * TIMES))
    np.testing.assert_allclose(vectors[-1], 13.0 * TIMES[-1] * axis, atol=1e-9)


def test_near_the_data_turns_are_the_rotation_vectors():
    observed, simulated = turned([1, 0, 0], 20.0 * TIMES), turned([1, 0.02, 0], 20.0 * TIMES)
    smallest = rotation_vector(simulated[None], observed)
    assert np.array_equal(counted_vectors(smallest, simulated[None], observed), smallest)


def test_an_orientation_measured_upside_down_once_leaves_the_others_as_they_are():
    observed = turned([0, 1, 0], 5.0 * TIMES)
    simulated = turned([0, 1, 0], 5.0 * TIMES + 0.05)
    observed[30] = turned([1, 0, 0], np.array([3.0]))[0]
    vectors = counted(simulated, observed)
    others = np.arange(len(TIMES)) != 30
    np.testing.assert_allclose(vectors[others], np.tile([0.0, 0.05, 0.0], (others.sum(), 1)), atol=1e-9)


def test_turns_in_a_plane_are_counted_by_what_looks_alike():
    half = np.pi / 4  # a square
    ahead = 3.0 * TIMES
    folded = ahead - 2 * half * np.round(ahead / (2 * half))
    np.testing.assert_allclose(counted_angles(folded[None], half)[0][-1], ahead[-1], rtol=1e-9)
