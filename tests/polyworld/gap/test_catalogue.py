"""The catalogue: candidates that do nothing until they are fitted, and then find what SciPy put into the data."""

# ruff: noqa: ARG005 - laws take time, place, velocity and spin, whichever of them they need.

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.gap import GapSettings
from polyworld.gap.catalogue import catalogue, named
from polyworld.gap.fitting import fit
from polyworld.gap.ground import ground_of
from polyworld.gap.hypothesis import Hypothesis
from polyworld.gap.propose import proposals
from polyworld.gap.verdict import intervals
from polyworld.solver.rollout import simulator
from polyworld.world import World
from polyworld.world.parameters import parameter_paths
from tests.polyworld import gap_scenes as scenes
from tests.polyworld.gap_scenes import Bouncing

NAMES = [
    "gravity_error",
    "restitution_error",
    "friction_error",
    "rolling_resistance",
    "mass_error",
    "tilt",
    "linear_drag",
    "quadratic_drag",
    "wind",
    "magnus_lift",
    "coriolis",
    "buoyancy",
    "spin_damping",
    "viscous_friction",
    "spring",
    "tether",
    "central_force",
    "periodic_forcing",
    "fan",
    "restitution_speed",
    "bounce_friction",
    "spin_coupling",
    "friction_patch",
    "hidden_wall",
    "hidden_body",
    "joint_friction",
    "joint_damping",
    "motor",
    "actuator_delay",
    "material_damping",
    "air_drag",
    "bending_stiffness",
    "stretch_stiffness",
    "viscosity",
    "surface_tension",
    "source_rate",
    "length_error",
    "stiffness_error",
    "observer_scale",
    "observer_clock",
    "observer_time_offset",
    "observer_tilt",
    "observer_distortion",
    "observer_keystone",
    "dropped_frames",
]
# What stands at a place, grips or comes late cannot be there and do nothing at the places where fits begin.
NEVER_NEUTRAL = {"hidden_wall", "hidden_body", "spin_coupling"}


def unmeasured(count, objects=1):
    return np.full((count, objects, 4), np.nan)


def ball():
    rng = np.random.default_rng(0)
    recording = scenes.ball_recording(Bouncing(), scenes.launches(rng, 3), rng, duration=0.8, orientations=True)
    return scenes.ball_world(friction=0.2), recording


def rolling_ball():
    """Three rolls along x on a floor, for a world with friction: contacts that last."""
    times = np.arange(60) / 60.0
    runs = []
    for k, speed in enumerate((0.5, 1.0, 2.0)):
        places = np.stack([speed * times, 0.1 * k + 0 * times, scenes.RADIUS + 0 * times], axis=1)
        runs.append(Run(f"run{k}", ("ball",), times, places[:, None], unmeasured(60)))
    return scenes.ball_world(friction=0.3, position=[0, 0, scenes.RADIUS]), Recording(tuple(runs))


def puck():
    return scenes.puck_world(), scenes.puck_recording(lambda x, v: 1.0, np.random.default_rng(1), runs=3)


def pendulum():
    recording = scenes.pendulum_recording(lambda rate: 0.0, np.random.default_rng(2))
    world = scenes.pendulum_world()
    driven = world.joints[0].model_dump() | {"motor": {"limit": 0.2, "start": 0.5}}
    return World.model_validate(world.model_dump() | {"joints": [driven]}), recording


def plain_pendulum():
    return scenes.pendulum_world(), pendulum()[1]


def colliding_pucks():
    times = np.arange(50) / 50.0
    hit = 0.45 / 1.0
    left = np.where(times < hit, -0.5 + times, -0.05 + 0.3 * (times - hit))
    right = np.where(times < hit, 0.05, 0.05 + 0.6 * (times - hit))
    zero = np.zeros_like(times)
    places = np.stack([np.stack([left, zero, zero], axis=1), np.stack([right, zero, zero], axis=1)], axis=1)
    one = scenes.puck_world().objects[0].model_dump()
    objects = [
        one | {"name": "a", "position": (-0.5, 0, 0)},
        one | {"name": "b", "position": (0.05, 0, 0), "mass": 0.4},
    ]
    world = World.model_validate({"objects": objects, "time": {"substep": 0.004}})
    return world, Recording((Run("run", ("a", "b"), times, places, unmeasured(50, 2)),))


def rope():
    world = World.model_validate(
        {
            "deformables": [
                {
                    "name": "rope",
                    "representation": "rope_planar",
                    "points": [(0, 0, 1), (0.5, 0, 1)],
                    "segments": 6,
                    "bending_stiffness": 1e-4,
                }
            ],
            "environment": {"motion_plane": {"normal": (0, 1, 0), "supports": False}},
            "attachments": [{"name": "held", "object": "rope", "end": "start"}],
        }
    )
    times = np.arange(10) / 50.0
    places = np.stack([0.5 - times**2, 0 * times, 1 - 0.5 * scenes.G * times**2], axis=1)[:, None]
    return world, Recording((Run("run", ("rope#0",), times, places, unmeasured(10)),))


SCENES = {f.__name__: f for f in (ball, rolling_ball, puck, pendulum, plain_pendulum, colliding_pucks, rope)}


def offered(scene):
    world, recording = SCENES[scene]()
    found = {name: candidate.variants(world, recording) for name, candidate in catalogue().items()}
    return world, recording, {name: variants for name, variants in found.items() if variants}


def test_holds_every_effect_by_its_standard_name_with_what_readers_need():
    found = catalogue()
    assert sorted(found) == sorted(NAMES)
    for name, candidate in found.items():
        assert name == candidate.name
        assert candidate.law


def test_every_effect_but_the_fluids_is_offered_in_some_scene():
    seen = {name for scene in SCENES for name in offered(scene)[2]}
    never = {"viscosity", "surface_tension", "source_rate", "hidden_wall", "hidden_body", "observer_time_offset"}
    never |= {"observer_keystone", "stiffness_error"}  # need a coordinate that was not measured, and a spring
    assert set(NAMES) - never <= seen


@pytest.mark.parametrize("scene", SCENES)
def test_unknowns_are_parameters_of_the_child_world_and_starts_lie_within_bounds(scene):
    _, _, found = offered(scene)
    for name, variants in found.items():
        labels = [v.label for v in variants]
        assert len(set(labels)) == len(labels), name
        for variant in variants:
            paths = parameter_paths(variant.world)
            names = [u.name for u in variant.unknowns]
            assert len(set(names)) == len(names), name
            assert all(p in paths for u in variant.unknowns for p in u.paths), name
            assert all(u.lower <= u.start <= u.upper and u.typical > 0 for u in variant.unknowns), name
            assert set(variant.idle) < set(names), name
            if name == "dropped_frames":  # every frame may be the one
                continue
            assert 1 <= len(variant.starts) <= 64, name
            for start in variant.starts:
                assert set(start) <= set(names), name
                assert all(u.lower <= start.get(u.name, u.start) <= u.upper for u in variant.unknowns), name


@pytest.mark.parametrize("scene", SCENES)
def test_children_move_as_their_parent_while_the_effect_is_off(scene):
    world, _, found = offered(scene)
    times = np.linspace(0.0, 0.5, 6)
    before = simulator(world, times, threads=1).run()
    for name, variants in found.items():
        if name in NEVER_NEUTRAL or catalogue()[name].group == "observer":
            continue
        for variant in variants:
            # A delay is not nil at all of its starts; other effects are, whatever their place.
            chosen = variant.starts[:1] if name == "actuator_delay" else variant.starts[:: -(-len(variant.starts) // 8)]
            values = {
                path: np.array([s.get(u.name, u.start) for s in chosen]) for u in variant.unknowns for path in u.paths
            }
            after = simulator(variant.world, times, n_worlds=len(chosen), threads=1).run(values)
            assert np.abs(after.positions - before.positions).max() < 1e-9, (name, variant.label)


def test_an_effect_on_bodies_of_different_mass_is_offered_per_mass_and_per_body():
    world, recording = colliding_pucks()
    labels = [v.label for v in catalogue()["linear_drag"].variants(world, recording)]
    assert labels == ["one coefficient for all bodies", "one coefficient per mass", "each body by itself"]
    masses = catalogue()["mass_error"].variants(world, recording)
    assert [v.unknowns[0].paths for v in masses] == [("objects.b.mass",)]


def test_spin_effects_are_not_offered_where_nobody_knows_the_spin():
    rng = np.random.default_rng(0)
    recording = scenes.ball_recording(Bouncing(), scenes.launches(rng, 2), rng, duration=0.5)
    for name in ("magnus_lift", "spin_coupling", "spin_damping"):
        assert catalogue()[name].variants(scenes.ball_world(), recording) == ()


FAN = np.array([0.1, 0.2, 0.6])
ANCHOR = np.array([0.5, -0.3, 1.0])
WIND = np.array([3.0, 1.0, 0.0])
# effect -> what moves the ball, true values of its unknowns
HIDDEN = {
    "gravity_error": (Bouncing(gravity=np.array([0, 0, -9.6])), {"gravity": -9.6}),
    "restitution_error": (Bouncing(after=lambda s, a: (0.76 * s, a)), {"restitution": 0.76}),
    "tilt": (Bouncing(lambda t, x, v, w: np.array([0.3, -0.1, 0])), {"x": 0.3, "y": -0.1}),
    "linear_drag": (Bouncing(lambda t, x, v, w: -0.1 * v), {"coefficient": 0.05}),
    "quadratic_drag": (Bouncing(lambda t, x, v, w: -0.02 * np.linalg.norm(v) * v), {"coefficient": 0.01}),
    "wind": (
        Bouncing(lambda t, x, v, w: -0.02 * np.linalg.norm(v - WIND) * (v - WIND)),
        {"coefficient": 0.01, "velocity_x": 3.0, "velocity_y": 1.0},
    ),
    "coriolis": (
        Bouncing(lambda t, x, v, w: -2 * np.cross([0.02, 0.1, 0.05], v)),
        {"rotation_x": 0.02, "rotation_y": 0.1, "rotation_z": 0.05},
    ),
    "magnus_lift": (Bouncing(lambda t, x, v, w: 0.01 * np.cross(w, v)), {"coefficient": 0.005}),
    "spring": (
        Bouncing(lambda t, x, v, w: -0.3 * (x - ANCHOR)),
        {"stiffness": 0.15, "anchor_x": 0.5, "anchor_y": -0.3, "anchor_z": 1.0},
    ),
    "fan": (
        Bouncing(lambda t, x, v, w: np.array([2.0, 1.0, 1.0]) * np.exp(-((x - FAN) @ (x - FAN)) / (2 * 0.5**2))),
        {"force_x": 1.0, "force_y": 0.5, "force_z": 0.5, "centre_x": 0.1, "centre_y": 0.2, "centre_z": 0.6}
        | {"width": 0.5},
    ),
    "restitution_speed": (Bouncing(after=lambda s, a: (0.8 / (1 + 0.02 * s) * s, a)), {"rate": 0.02}),
    "bounce_friction": (Bouncing(after=lambda s, a: (0.8 * s, 0.9 * a)), {"share": 0.1}),
}


def assert_found(world, recording, name, truth):
    """Fit one candidate from where its starts are: it leaves the noise, and its values are the true ones."""
    ground = ground_of(world, recording, GapSettings())
    null = fit(ground, Hypothesis(ground.world), growing=True, scale=1.0)
    starts = proposals(null, named([name]), 2)
    fits = [fit(ground, s.hypothesis, s.point, s.growing, scale=null.scale) for s in starts]
    found = min(fits, key=lambda f: f.objective + 2.0 * f.hypothesis.cost(ground.settings))
    assert found.scale < 1.2 < null.scale
    ends = dict(zip([u.name for u in found.hypothesis.unknowns], intervals(found), strict=True))
    for unknown, value in truth.items():
        low, high = ends[unknown]
        assert abs(0.5 * (low + high) - value) < high - low + 1e-3 * abs(value), (unknown, low, high)  # 4 errors


@pytest.mark.parametrize("name", HIDDEN)
def test_a_fit_from_the_starts_finds_what_moved_the_ball(name):
    hidden, truth = HIDDEN[name]
    rng = np.random.default_rng(7)
    turning = name == "magnus_lift"
    recording = scenes.ball_recording(hidden, scenes.launches(rng, 5), rng, rate=60.0, orientations=turning)
    assert_found(scenes.ball_world(), recording, name, truth)
