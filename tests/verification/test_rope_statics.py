"""Ropes and rods at rest: catenary, elastica, torsion, buckling. Half the resolution within twice the tolerance."""

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.verification.rope_world import G, ball, held, rope, run, run_batch, world

ELASTICA = {1.0: 0.30172, 2.0: 0.49346, 5.0: 0.71379, 10.0: 0.81061}


def catenary(segments: int) -> tuple[float, float]:
    """Sag over span, and tension at the ends over weight per length and span."""
    density = 0.1
    hanging = rope(
        [[0, 0, 0], [0.5, 0, -0.33], [1, 0, 0]],
        segments,
        length=1.2,
        linear_density=density,
        stretch_stiffness=1e5,
        linear_damping=3.0,
    )
    _, motion = run(world(hanging, attachments=[held("start"), held("end")]), 6.0)
    points, tension = motion.points[-1], motion.quantities["tension"][-1]
    weight = density * G
    # The first segment's tension is that at its middle: the end carries the weight of half a segment more.
    along = (points[0] - points[1]) / np.linalg.norm(points[0] - points[1])
    end = np.linalg.norm(along * tension[0] + np.array([0.0, 0.0, 0.5 * weight * 1.2 / segments]))
    return float(-points[:, 2].min()), float(end / weight)


@pytest.mark.parametrize(("segments", "tolerance"), [(40, 0.002), (20, 0.004)])
def test_hanging_rope_is_a_catenary(segments: int, tolerance: float) -> None:
    """L/d = 1.2: sinh(u)/u = 1.2, sag/d = (cosh(u) - 1)/(2 u) = 0.29234, end tension/(w d) = cosh(u)/(2 u) = 0.7619.

    Held to 0.2% at 40 segments; the chain of straight segments is second order.
    """
    u = brentq(lambda u: np.sinh(u) / u - 1.2, 0.1, 3.0)
    assert (np.cosh(u) - 1) / (2 * u) == pytest.approx(0.29234, abs=1e-5)
    sag, tension = catenary(segments)
    assert sag == pytest.approx((np.cosh(u) - 1) / (2 * u), rel=tolerance)
    assert tension == pytest.approx(np.cosh(u) / (2 * u), rel=tolerance)


def elastica_tips(segments: int) -> np.ndarray:
    """Tip drop over length of a rod clamped at one end, for all loads of ELASTICA at once."""
    load, length = 0.5, 1.0
    rod = rope(
        [[0, 0, 0], [length, 0, 0]],
        segments,
        linear_density=0.1,
        stretch_stiffness=1e5,
        bending_stiffness=0.1,
        linear_damping=6.0,
    )
    scene = world(
        rod,
        objects=[ball("tip", [length, 0, 0], 0.005)],
        attachments=[held("start", clamped=True), held("end", "tip")],
        gravity=(0.0, 0.0, 0.0),
        effects=[
            {"name": "load", "kind": "uniform_acceleration", "parameters": {"z": -load / 0.005}, "objects": ["tip"]}
        ],
    )
    stiffness = load * length**2 / np.array(list(ELASTICA))
    batch = run_batch(scene, 3.5, {"objects.rope.bending_stiffness": stiffness})
    return -batch.deformables["rope"].points[:, -1, -1, 2] / length


@pytest.mark.parametrize(("segments", "tolerance"), [pytest.param(40, 0.005, marks=pytest.mark.benchmark), (20, 0.01)])
def test_loaded_cantilever_is_an_elastica(segments: int, tolerance: float) -> None:
    """Bisshopp & Drucker 1945 (Q. Appl. Math. 3, 272): drop/L at P L^2/EI = 1, 2, 5, 10, to 0.5% at 40 segments."""
    np.testing.assert_allclose(elastica_tips(segments), list(ELASTICA.values()), rtol=tolerance)


def test_elastica_converges() -> None:
    """From 10 to 20 segments the error falls by more than half."""
    exact = np.array(list(ELASTICA.values()))
    coarse, fine = (np.abs(elastica_tips(n) / exact - 1.0).max() for n in (10, 20))
    assert fine < 0.5 * coarse
    assert coarse < 0.02


def test_stretched_rope_shows_its_load() -> None:
    """A hanging load stretches the rope by M g L/EA, to which its weight adds half; tension is M g at the load."""
    mass, stiffness, density = 2.0, 2000.0, 0.05
    hanging = rope(
        [[0, 0, 0], [0, 0, -1]], 20, stretch_stiffness=stiffness, linear_density=density, stretch_damping=0.02
    )
    scene = world(hanging, objects=[ball("load", [0, 0, -1], mass)], attachments=[held("start"), held("end", "load")])
    trajectory, motion = run(scene, 3.0)
    stretch = (mass + 0.5 * density) * G / stiffness
    assert -trajectory.positions[-1, 0, 2] - 1.0 == pytest.approx(stretch, rel=1e-3)
    tension = motion.quantities["tension"][-1]
    middles = 1.0 - (np.arange(20) + 0.5) / 20
    np.testing.assert_allclose(tension, (mass + density * middles) * G, rtol=1e-3)


def twisted(moment_ratio: float) -> float:
    """Deflection over length of a clamped straight rod twisted to a share of its critical moment."""
    bending, twist, length, rate = 0.02, 0.015, 1.0, 5.0
    angle = moment_ratio * 8.9868 * bending / twist
    rod = rope(
        [[0, 0, 0], [length, 0, 0]],
        24,
        linear_density=0.05,
        stretch_stiffness=20.0,  # the ends keep their distance: a stiffer rod would be held straight by its tension
        bending_stiffness=bending,
        twist_stiffness=twist,
        linear_damping=2.0,
    )
    anchor = ball("wheel", [length, 0, 0], 1e3, angular_velocity=[angle * rate, 0, 0], angular_damping=rate)
    scene = world(
        rod,
        objects=[anchor],
        attachments=[held("start", clamped=True), held("end", "wheel", clamped=True)],
        gravity=(0.0, 0.0, 0.0),
        effects=[{"name": "nudge", "kind": "uniform_acceleration", "parameters": {"z": -0.01}, "objects": ["rope"]}],
    )
    _, motion = run(scene, 12.0)
    return float(np.linalg.norm(motion.points[-1][:, 1:], axis=1).max()) / length


def test_straight_rod_buckles_at_greenhills_moment() -> None:
    """A clamped straight rod under torque M stays straight below M L/EI = 8.987 (2 x 4.4934, the root of tan x = x:
    Greenhill 1883; Timoshenko & Gere, Theory of Elastic Stability) and buckles above, here within 5%.

    Below, the nudge deflects it by w L^4/(384 EI) = 6.5e-5 L, raised by 1/(1 - 0.95^2).
    """
    assert twisted(0.95) < 2e-3
    assert twisted(1.05) > 1.5e-2


def test_torsion_pendulum_has_its_period() -> None:
    """omega^2 = GJ/(L I): a disc on a clamped wire, to 0.1%; twist waves in the wire are not computed."""
    twist, length, radius, mass = 0.02, 0.5, 0.1, 1.0
    wire = rope(
        [[0, 0, 0], [0, 0, -length]],
        10,
        linear_density=0.02,
        stretch_stiffness=1e4,
        bending_stiffness=0.01,
        twist_stiffness=twist,
        stretch_damping=0.01,
    )
    disc = ball("disc", [0, 0, -length], mass, angular_velocity=[0, 0, 1.0])
    disc["shape"] = {"kind": "cylinder", "radius": radius, "half_height": 0.01}
    scene = world(wire, objects=[disc], attachments=[held("start", clamped=True), held("end", "disc", clamped=True)])
    omega = np.sqrt(twist / (length * 0.5 * mass * radius**2))
    trajectory, _ = run(scene, 2 * np.pi / omega, np.pi / omega)
    np.testing.assert_allclose(trajectory.angular_velocities[:, 0, 2], [1.0, -1.0, 1.0], rtol=1e-3)
