"""Write rope and pulley scenes as folders laid out like ContPhy's `pulley_group`, with its engine's questions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from .ask_pulleys import ask, way_of
from .film import write_video
from .pulleys import BELOW, COLORS, HALF, RATE, Group, Run, clip_length, compiled, draw, simulate

SIZE = (640, 480)
DISTANCE, HEIGHT = 4.6, 1.45  # m, of the camera from the plane of the ropes, and above the ground
FOCAL = 900.0  # pixels


def make_pulleys(seed: int, folder: Path) -> None:
    """Draw the scene of a seed and write its video, outputs.json and questions, unless they are there."""
    asked = folder / "questions" / f"{seed}.json"
    if asked.exists():
        return
    rng = np.random.default_rng([seed, 31])
    while True:
        groups = draw(rng)
        frames = clip_length(groups)
        run = simulate(groups, frames)
        if any(way_of(run, name, "motion") != "stationary" for name in run.heights):
            break
    own = folder / "pulley_group" / str(seed)
    write_video(own / "output_Full.mp4", _pictures(groups, frames), RATE)
    (own / "outputs.json").write_text(json.dumps(_outputs(groups, run)))
    asked.parent.mkdir(parents=True, exist_ok=True)
    asked.write_text(json.dumps({"video_id": str(seed), "question_dict": ask(rng, groups, frames)}, indent=1))


def _outputs(groups: list[Group], run: Run) -> dict[str, Any]:
    """Annotation: ContPhy's fields as far as they apply, and under `made` what its files hold in other ways."""
    signs = {"up": 1, "clockwise": 1, "down": -1, "anti-clockwise": -1, "stationary": 0}
    things = [p for g in groups for p in (*g.parts, *g.hung)]
    return {
        "validity": True,
        "relatedGroups": [_woven(g) for g in groups],
        "ResultRotation": {n: signs[way_of(run, n, "rotation")] for n in run.turns},
        "ResultMotion": {p.name: signs[way_of(run, p.name, "motion")] for p in things},
        "metaSamplingData": {"name2position": {p.name: list(p.place) for p in things}},
        "outputMass": {p.name: p.mass for p in things if p.mass},
        "made": {
            "kinds": {p.name: p.kind for p in things},
            "radius": {p.name: p.radius for p in things if p.radius},
            "hung": {p.name: p.load for p in things if p.load},
            "half_size": HALF,
            "below": BELOW,
            "seconds_per_frame": 1 / RATE,
            "heights": {n: h.round(4).tolist() for n, h in run.heights.items()},
            "camera": {"pixel": [SIZE[0] / 2, SIZE[1] / 2], "at": [0.0, HEIGHT], "pixels_per_m": FOCAL / DISTANCE},
        },
    }


def _woven(group: Group) -> list[str]:
    """Names along the rope, the rope between each two, as ContPhy lists a group."""
    found = [group.parts[0].name]
    for part in group.parts[1:]:
        found += [f"{group.rope} rope", part.name]
    return found


def _pictures(groups: list[Group], frames: int) -> list[Any]:
    fovy = 2 * np.degrees(np.arctan(SIZE[1] / 2 / FOCAL))
    looks = (
        f'<visual><global offwidth="{SIZE[0]}" offheight="{SIZE[1]}"/><quality shadowsize="1024" offsamples="4"/>'
        '<headlight ambient=".5 .5 .5" diffuse=".4 .4 .4" specular="0 0 0"/></visual><asset>'
        + "".join(f'<material name="{c}" rgba="{r} {g} {b} 1" specular=".1"/>' for c, (r, g, b) in COLORS.items())
        + "</asset>"
    )
    view = (
        f'<camera name="view" pos="0 {-DISTANCE} {HEIGHT}" xyaxes="1 0 0 0 0 1" fovy="{fovy}"/>'
        '<geom type="plane" size="10 10 .1" pos="0 2 0" zaxis="0 -1 0" rgba=".86 .86 .84 1" contype="0" '
        'conaffinity="0"/>'
    )
    model = compiled(groups, looks, view)
    data = mujoco.MjData(model)
    pictures = []
    with mujoco.Renderer(model, SIZE[1], SIZE[0]) as renderer:
        for frame in range(frames):
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, "view")
            pictures.append(np.ascontiguousarray(renderer.render()[:, :, ::-1]))
            if frame + 1 < frames:
                for _ in range(round(1 / (RATE * model.opt.timestep))):
                    mujoco.mj_step(model, data)
    return pictures
