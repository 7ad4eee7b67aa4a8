"""What ropes do besides what the verification cases measure: slack, letting go, batches, limits."""

import numpy as np
import pytest

from polyworld import rollout
from tests.verification.rope_world import G, ball, held, rope, run, world


def test_slack_rope_does_not_push() -> None:
    """A ball thrown up from a hanging straight rope flies as if there were none, until the rope is taut again."""
    cord = rope([[0, 0, 0], [0, 0, -1]], 20, linear_density=0.001, stretch_stiffness=1e4)
    thrown = ball("ball", [0, 0, -1], 1.0, velocity=[0, 0, 2.0])
    scene = world(cord, objects=[thrown], attachments=[held("start"), held("end", "ball")])
    trajectory, _ = run(scene, 0.3)
    # The rope's own gram changes a kilogram's flight by a thousandth.
    assert trajectory.positions[-1, 0, 2] == pytest.approx(-1.0 + 2.0 * 0.3 - 0.5 * G * 0.09, abs=1e-3)


def test_stiff_rod_carries_its_euler_load_in_compression() -> None:
    """A ball on a clamped upright rod stays up below the buckling load pi^2 EI/(4 L^2), and comes down above it."""
    bending, length = 0.5, 0.5
    critical = np.pi**2 * bending / (4 * length**2)

    def height(share: float) -> float:
        rod = rope(
            [[0, 0, 0], [0.002, 0, length]],
            12,
            linear_density=0.1,
            stretch_stiffness=1e5,
            bending_stiffness=bending,
            linear_damping=2.0,
        )
        top = ball("top", [0.002, 0, length], share * critical / G, linear_damping=2.0)
        scene = world(rod, objects=[top], attachments=[held("start", clamped=True), held("end", "top")])
        return float(run(scene, 3.0)[0].positions[-1, 0, 2])

    assert height(0.8) == pytest.approx(length, abs=5e-3)
    assert height(1.2) < 0.9 * length


def test_end_lets_go_at_its_time_and_its_strength() -> None:
    cord = rope([[0, 0, 0], [0, 0, -1]], 10, linear_density=0.01, stretch_damping=0.005)
    load = ball("load", [0, 0, -1], 1.0)
    for rule in ({"release": 0.5}, {"strength": 5.0}):
        scene = world(cord, objects=[load], attachments=[held("start"), held("end", "load") | rule])
        trajectory, motion = run(scene, 1.0, 0.5)
        assert trajectory.positions[-1, 0, 2] < -2.0
        assert motion.points[-1, -1, 2] > -1.5
    scene = world(cord, objects=[load], attachments=[held("start"), held("end", "load") | {"strength": 25.0}])
    assert run(scene, 1.0)[0].positions[-1, 0, 2] == pytest.approx(-1.0, abs=0.01)


def test_snatched_rope_throws_its_load_back() -> None:
    """A load that falls into a stiff slack rope without damping rises again to where it fell from, within 1 cm."""
    cord = rope(
        [[0, 0, 0], [0.3, 0, -0.2], [0.01, 0, -0.5]], 15, length=1.0, linear_density=0.005, stretch_stiffness=1e4
    )
    scene = world(cord, objects=[ball("load", [0.01, 0, -0.5], 1.0)], attachments=[held("start"), held("end", "load")])
    trajectory, _ = run(scene, 0.75, 0.0025)
    z = trajectory.positions[:, 0, 2]
    lowest = int(np.argmin(z))
    assert z[lowest] == pytest.approx(-1.0 - (G + np.sqrt(G**2 + 1e4 * G)) / 1e4, abs=2e-3)
    assert z[lowest:].max() == pytest.approx(-0.5, abs=0.01)


def test_two_ropes_share_a_load() -> None:
    """M g/(2 cos 45 deg) in each of two ropes at right angles, to 1%."""
    cords = [
        rope([[s, 0, 0], [0, 0, -1]], 15, linear_density=0.005, stretch_stiffness=1e5, stretch_damping=0.002)
        | {"name": name}
        for name, s in (("one", -1.0), ("two", 1.0))
    ]
    ends = [held("start") | {"name": f"s-{n}", "object": n} for n in ("one", "two")]
    ends += [held("end", "load") | {"name": f"e-{n}", "object": n} for n in ("one", "two")]
    result = rollout(world(*cords, objects=[ball("load", [0, 0, -1], 2.0)], attachments=ends), 1.0, sample_interval=1.0)
    for name in ("one", "two"):
        tension = result.trajectory.deformables[name].quantities["tension"][-1]
        assert tension.mean() == pytest.approx(2.0 * G / np.sqrt(2.0), rel=0.01)


def test_curved_rod_keeps_its_shape_and_a_helix_is_a_spring() -> None:
    """k = GJ/(2 pi R^3 n) of a close-coiled spring (Timoshenko), with the pitch's share of bending; 5% at 20 a turn."""
    radius, pitch, turns, bending, twist, load = 0.05, 0.02, 2, 0.004, 0.003, 0.02
    angle = np.linspace(0.0, 2 * np.pi * turns, 161)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), -pitch * angle / (2 * np.pi)], axis=1)
    rod = rope(
        points.tolist(),
        20 * turns,
        linear_density=0.05,
        stretch_stiffness=1e4,
        bending_stiffness=bending,
        twist_stiffness=twist,
        curved_at_rest=True,
        linear_damping=8.0,
    )
    seat = ball("seat", [0, 0, -pitch * turns], 0.01, linear_damping=8.0, angular_damping=8.0)
    ends = [held("start", clamped=True), held("end", "seat", clamped=True)]
    free = world(rod, attachments=ends[:1], gravity=(0.0, 0.0, 0.0))
    _, motion = run(free, 0.2)
    np.testing.assert_allclose(motion.points[-1], motion.points[0], atol=1e-9)
    push = {"name": "load", "kind": "uniform_acceleration", "parameters": {"z": -load / 0.01}, "objects": ["seat"]}
    loaded = world(rod, objects=[seat], attachments=ends, gravity=(0.0, 0.0, 0.0), effects=[push])
    trajectory, _ = run(loaded, 1.5)
    slope = np.arctan2(pitch, 2 * np.pi * radius)
    give = 2 * np.pi * turns * radius**3 / np.cos(slope)
    give *= np.cos(slope) ** 2 / twist + np.sin(slope) ** 2 / bending
    assert -pitch * turns - trajectory.positions[-1, 0, 2] == pytest.approx(load * give, rel=0.05)


def test_planar_rope_stays_in_its_plane() -> None:
    cord = rope([[0, 0, 0], [0.5, 0, -0.2], [1, 0, 0.1]], 15, length=1.3, bending_stiffness=1e-3)
    scene = world(
        cord | {"representation": "rope_planar"},
        attachments=[held("start")],
        environment={"motion_plane": {"normal": [0, 1, 0], "supports": False}},
    )
    _, motion = run(scene, 0.5)
    np.testing.assert_array_equal(motion.points[-1, :, 1], 0.0)


def test_what_ropes_over_pulleys_cannot_do_is_refused() -> None:
    wheel = {"name": "wheel", "rope": "rope", "centre": [0, 0, 0], "radius": 0.1, "after": 0}
    for more, message in (({"twist_stiffness": 0.1}, "twist"), ({"curved_at_rest": True}, "curved_at_rest")):
        cord = rope([[-0.1, 0, -1], [0.1, 0, -1]], 10, **more)
        with pytest.raises(ValueError, match=message):
            rollout(world(cord, pulleys=[wheel]), 0.1)
