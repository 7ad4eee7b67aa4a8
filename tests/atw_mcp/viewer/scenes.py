"""A report of a scene of each material, without a video: `python -m tests.atw_mcp.viewer.scenes FOLDER [NAME ...]`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from atw_mcp.viewer import document as view
from atw_mcp.viewer.colors import distinct_colors
from atw_mcp.viewer.comparisons import comparisons_view
from atw_mcp.viewer.edits import branch_label, edit_words
from atw_mcp.viewer.packing import Blocks, packed
from atw_mcp.viewer.page import page
from atw_mcp.viewer.rollouts import rollout_view
from atw_mcp.viewer.sampling import numbers_per_sample, shares
from atw_mcp.viewer.worlds import world_view
from polyworld.edits.interventions import Intervention, branch
from polyworld.solver.rollout import rollout
from polyworld.world import World
from tests.atw_mcp.viewer.blank import document

SIDE = {"motion_plane": {"normal": [0, -1, 0], "supports": False}}
EDITS: TypeAdapter[list[Intervention]] = TypeAdapter(list[Intervention])
FLOOR = {"name": "floor", "shape": {"kind": "plane"}}


@dataclass(frozen=True)
class Scene:
    """A world, how long it runs [s], and the edits of a branch that is shown beside it."""

    world: World
    horizon: float
    edits: tuple[dict[str, Any], ...] = ()


def _world(seconds_per_frame: float = 0.02, **parts: Any) -> World:
    return World.model_validate({"time": {"seconds_per_frame": seconds_per_frame}} | parts)


def _body(name: str, shape: dict[str, Any], position: Sequence[float], **more: Any) -> dict[str, Any]:
    return {"name": name, "shape": shape, "position": list(position), **more}


def _ball(radius: float) -> dict[str, Any]:
    return {"kind": "sphere", "radius": radius}


def _box(x: float, y: float, z: float) -> dict[str, Any]:
    return {"kind": "box", "half_extents": [x, y, z]}


def rope() -> Scene:
    """Two loads on a rope over a wheel; in the branch the heavy one is half as heavy."""
    world = _world(
        objects=[
            _body("heavy", _ball(0.06), (-0.1, 0.0, -0.5), mass=1.5, appearance={"color": "red"}),
            _body("light", _box(0.05, 0.05, 0.05), (0.1, 0.0, -0.5), mass=1.0, appearance={"color": "blue"}),
        ],
        deformables=[
            {
                "name": "rope",
                "representation": "rope",
                "points": [(-0.1, 0, -0.44), (0.1, 0, -0.45)],
                "segments": 30,
                "radius": 0.006,
                "linear_density": 0.02,
                "stretch_stiffness": 2e4,
                "stretch_damping": 0.002,
            }
        ],
        attachments=[
            {"name": "left", "object": "rope", "end": "start", "to": "heavy"},
            {"name": "right", "object": "rope", "end": "end", "to": "light"},
        ],
        pulleys=[
            {
                "name": "wheel",
                "rope": "rope",
                "centre": (0, 0, 0),
                "axis": (0, -1, 0),
                "radius": 0.1,
                "after": 0,
                "turns_positive": False,
                "inertia": 1e-4,
            }
        ],
    )
    return Scene(world, 0.7, ({"action": "set_parameter", "path": "objects.heavy.mass", "value": 0.75},))


def cloth() -> Scene:
    """A ball falls on a sheet held by its corners; in the branch one corner lets go."""
    n = 16
    corners = (0, n, n * (n + 1), (n + 1) ** 2 - 1)
    world = _world(
        objects=[_body("ball", _ball(0.08), (0.05, 0.0, 0.35), mass=0.15, appearance={"color": "orange"})],
        deformables=[
            {
                "name": "sheet",
                "representation": "cloth",
                "geometry": {
                    "kind": "sheet",
                    "corner": (-0.4, -0.4, 0),
                    "edge_u": (0.8, 0, 0),
                    "edge_v": (0, 0.8, 0),
                    "divisions": (n, n),
                },
                "areal_density": 0.2,
                "stretch_stiffness": 200.0,
            }
        ],
        attachments=[{"name": f"corner_{k}", "object": "sheet", "nodes": [node]} for k, node in enumerate(corners)],
    )
    return Scene(world, 1.2, ({"action": "release", "attachment": "corner_3", "time": 0.4},))


def soft() -> Scene:
    """A soft cube and a soft ball fall on the floor."""
    world = _world(
        statics=[FLOOR, {"name": "wall", "shape": {"kind": "wall", "start": [-0.5, 0.35, 0], "end": [0.5, 0.35, 0]}}],
        deformables=[
            {
                "name": "jelly",
                "representation": "soft",
                "shape": _box(0.1, 0.1, 0.1),
                "position": [0, 0, 0.25],
                "orientation": [0.94, 0.2, 0.27, 0.0],
                "youngs_modulus": 4e4,
                "damping": 0.005,
                "resolution": 0.07,
                "appearance": {"color": "green"},
            },
            {
                "name": "ball",
                "representation": "soft",
                "shape": _ball(0.09),
                "position": [0.3, 0, 0.3],
                "velocity": [-0.6, 0, 0],
                "youngs_modulus": 6e4,
                "resolution": 0.07,
                "appearance": {"color": "green"},
            },
        ],
    )
    return Scene(world, 0.8)


def _dam(cell: float, width: float, height: float) -> World:
    return _world(
        0.025,
        objects=[
            _body("cork", _box(0.05, 0.05, 0.04), (0.75, 0.15, 0.06), density=300.0, appearance={"color": "brown"})
        ],
        deformables=[
            {
                "name": "water",
                "representation": "fluid",
                "volumes": [{"shape": _box(width / 2, 0.15, height / 2), "position": [width / 2, 0.15, height / 2]}],
            }
        ],
        fluid_grid={"lower": [0, 0, 0], "upper": [1.0, 0.3, 0.5], "cell": cell},
        containers=[{"name": "right_end", "lower": [0.8, 0, 0], "upper": [1.0, 0.3, 0.5]}],
        statics=[FLOOR],
    )


def fluid() -> Scene:
    """A column of water breaks down and lifts a cork."""
    return Scene(_dam(0.05, 0.3, 0.35), 1.2)


def particles() -> Scene:
    """The same with 20 000 particles."""
    return Scene(_dam(0.0245, 0.43, 0.29), 0.6)


def tap() -> Scene:
    """Water that pours into a basin, in a plane: particles that join."""
    world = _world(
        0.025,
        environment=SIDE,
        deformables=[{"name": "water", "representation": "fluid_planar"}],
        emitters=[{"name": "tap", "fluid": "water", "position": [0.15, 0, 0.35], "radius": 0.04, "rate": 0.05}],
        containers=[{"name": "basin", "lower": [0, -0.2, 0], "upper": [0.4, 0.2, 0.2]}],
        fluid_grid={"lower": [0, -0.1, 0], "upper": [0.4, 0.1, 0.4], "cell": 0.02},
    )
    return Scene(world, 1.5)


def joints() -> Scene:
    """A double pendulum of spatial bodies, a slider on a spring, and a compound with a convex stone, in a wind."""
    dumbbell = {
        "kind": "compound",
        "parts": [
            {"shape": _ball(0.06), "position": [-0.12, 0, 0]},
            {"shape": _ball(0.06), "position": [0.12, 0, 0]},
            {
                "shape": {"kind": "cylinder", "radius": 0.02, "half_height": 0.08},
                "orientation": [0.7071067811865476, 0, 0.7071067811865476, 0],
            },
        ],
    }
    rng = np.random.default_rng(3)
    stone = {"kind": "convex_mesh", "vertices": (rng.normal(size=(24, 3)) * [0.07, 0.06, 0.05]).tolist()}
    rod = {"kind": "capsule", "radius": 0.02, "half_height": 0.13}
    sideways = [0.7071067811865476, 0, 0.7071067811865476, 0]
    world = _world(
        objects=[
            _body("upper_arm", rod, (0.15, 0, 1.0), orientation=sideways, mass=0.3, appearance={"color": "red"}),
            _body("lower_arm", rod, (0.45, 0, 1.0), orientation=sideways, mass=0.3, appearance={"color": "red"}),
            _body("cart", _box(0.08, 0.06, 0.04), (-0.4, 0.3, 0.5), mass=0.5),
            _body("dumbbell", dumbbell, (-0.1, -0.4, 0.6), mass=0.4, angular_velocity=[0, 3.0, 1.0]),
            _body("stone", stone, (0.4, -0.4, 0.5), mass=0.6, appearance={"color": "gray"}),
        ],
        statics=[FLOOR],
        joints=[
            {"kind": "hinge", "name": "shoulder", "object": "upper_arm", "anchor": [0, 0, 1], "axis": [0, 1, 0]},
            {
                "kind": "hinge",
                "name": "elbow",
                "object": "lower_arm",
                "other": "upper_arm",
                "anchor": [0.3, 0, 1],
                "axis": [0, 1, 0],
            },
            {"kind": "slider", "name": "rail", "object": "cart", "anchor": [-0.4, 0.3, 0.5], "axis": [1, 0, 0]},
            {
                "kind": "spring",
                "name": "spring",
                "object": "cart",
                "anchor": [-0.32, 0.3, 0.5],
                "other_anchor": [0.5, 0.3, 0.5],
                "stiffness": 20.0,
                "rest_length": 0.5,
            },
        ],
        effects=[{"name": "breeze", "kind": "fan", "parameters": {"force_x": 1.5, "centre_z": 0.6, "width": 0.4}}],
    )
    return Scene(world, 2.0, ({"action": "toggle_effect", "effect": "breeze", "enabled": False},))


def discs() -> Scene:
    """Planar discs under a central force and on a rough patch; in the branch one of them is not there."""
    world = _world(
        0.02,
        objects=[
            _body(
                name,
                {"kind": "cylinder", "radius": 0.1, "half_height": 0.03},
                (x, y, 0.03),
                velocity=[u, v, 0],
                representation="rigid_planar",
                mass=0.5,
                friction=0.05,
                restitution=0.8,
                appearance={"color": color},
            )
            for name, color, x, y, u, v in (
                ("cue", "white", -1.0, 0.05, 2.2, 0.0),
                ("red", "red", 0.0, 0.0, 0.0, 0.0),
                ("second_red", "red", 0.35, 0.12, 0.0, 0.0),
                ("blue", "blue", 0.5, -0.4, -0.3, 0.4),
            )
        ],
        effects=[
            {
                "name": "magnet",
                "kind": "central_force",
                "parameters": {"centre_x": 0.3, "centre_y": 0.8, "strength": 0.15, "softening": 0.2},
            },
            {
                "name": "rough",
                "kind": "friction_patch",
                "parameters": {"x": 0.8, "y": 0.2, "radius": 0.3, "friction": 0.5},
            },
        ],
    )
    return Scene(world, 2.0, ({"action": "remove", "object": "red"},))


def fifty() -> Scene:
    """Fifty bodies that fall on a heap."""
    rng = np.random.default_rng(1)
    shapes = (
        _ball(0.08),
        _box(0.08, 0.07, 0.06),
        {"kind": "cylinder", "radius": 0.07, "half_height": 0.08},
        {"kind": "capsule", "radius": 0.05, "half_height": 0.06},
    )
    bodies = []
    for k in range(50):
        turn = rng.normal(size=4)
        place = (0.4 * (k % 3 - 1) + rng.uniform(-0.05, 0.05), 0.4 * (k // 3 % 3 - 1) + rng.uniform(-0.05, 0.05))
        turned = (turn / np.linalg.norm(turn)).tolist()
        bodies.append(
            _body(f"body_{k:02d}", shapes[k % 4], (*place, 0.2 + 0.3 * (k // 9)), orientation=turned, mass=0.3)
        )
    return Scene(_world(0.04, objects=bodies, statics=[FLOOR]), 2.0)


SCENES: dict[str, Callable[[], Scene]] = {
    f.__name__: f for f in (rope, cloth, soft, fluid, tap, joints, discs, fifty, particles)
}


def scene_document(title: str, scene: Scene) -> tuple[view.ViewDocument, Blocks]:
    """Return the document of a scene, run with the engine, and of its branch where it has one."""
    worlds, words = [scene.world], [edit_words(edit) for edit in scene.edits]
    if scene.edits:
        worlds.append(branch(scene.world, EDITS.validate_python(scene.edits)))
    results = [rollout(world, scene.horizon) for world in worlds]
    blocks = Blocks()
    looks = {o.name: o.appearance.color for world in worlds for o in (*world.objects, *world.deformables)}
    colors = distinct_colors(looks)
    runs = [result.trajectory for result in results]
    budget = shares([len(run.times) * numbers_per_sample(w, run) for w, run in zip(worlds, runs, strict=True)])
    labels = ["as described", branch_label(words)]
    ids = ["rollout-base", "rollout-branch"][: len(worlds)]
    known, bases = {world.id: world for world in worlds}, {rollout: ids[0] for rollout in ids[1:]}
    made = document(
        title,
        about={"committed_world": scene.world.id},
        worlds=[
            world_view(world, blocks, colors, label=label, origin="intervention" if k else "given",
                       parent=scene.world.id if k else None, committed=not k, runs=[run])
            for k, (world, label, run) in enumerate(zip(worlds, labels, runs, strict=False))
        ],
        rollouts=[
            rollout_view(ids[k], world, result, blocks, label=labels[k], base=ids[0] if k else None,
                         edits=words if k else [], most_numbers=most)
            for k, (world, result, most) in enumerate(zip(worlds, results, budget, strict=True))
        ],
        comparisons=comparisons_view(known, dict(zip(ids, results, strict=False)), bases, [])[0],
        shown=ids,
    )  # fmt: skip
    return made, blocks


def main(folder: Path, names: Sequence[str]) -> None:
    """Write the reports."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names or SCENES:
        made, blocks = scene_document(name, SCENES[name]())
        text = page(packed(made, blocks))
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
        ends = [f"{r.status}{'' if r.why_ended is None else f' ({r.why_ended})'}" for r in made.rollouts]
        print(f"{folder / name}.html: {len(text) / 1e6:.2f} MB; {', '.join(ends)}", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
