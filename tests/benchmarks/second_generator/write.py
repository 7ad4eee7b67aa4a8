"""Writes a case: public scene.json, data.csv, held_out.csv; private truth and the noise-free held-out runs."""

import json
from pathlib import Path as File
from typing import Any

import numpy as np
from numpy.random import Generator

from .cases import Case, Plan
from .observe import Track
from .scene import Array, Launch, Scene

BALL = {
    "restitution": "rebound speed / approach speed (normal) of this object at every surface listed, the floor "
    "included, independent of speed",
    "friction": "Coulomb coefficient of that contact; at a bounce the tangential impulse is the smaller of the "
    "sticking one (2/7 m |slip|) and mu m (1+e) v_n; a solid sphere, I = 2/5 m r^2, gains spin from it",
    "contact": "the position is the centre; contact when the centre is one radius from the surface",
    "released": "'without spin': initial spin zero; 'rolling': initially rolling without slip; 'spinning': "
    "initial spin unknown but visible in the orientations",
    "orientation": "unit quaternion (qw,qx,qy,qz) turning body axes into laboratory axes",
    "blank": "a blank cell was not measured; rows may be missing",
    "time": "t is the clock of the run in s; the release need not be at t = 0; one row per frame",
}
DISC = {
    **BALL,
    "restitution": "of two discs (equal for all discs) and of a disc at a known wall, independent of speed",
    "friction": "Coulomb coefficient of the disc on the table: force mu N against the velocity of the centre, and a "
    "torque (2/3) mu N radius against the spin, taken as independent of each other",
    "rim_friction": "Coulomb coefficient at the rim, disc on disc and disc on wall; I = 1/2 m r^2",
    "contact": "the position is the centre of the disc; z is constant",
}
NOTES = {
    "flight": [
        "We throw a ball in the air and film it until it nears the ground.",
        "Free flights of one ball, filmed; each run is another throw.",
    ],
    "bounce": [
        "A ball is thrown or dropped and bounces on the floor.",
        "One ball bouncing in the hall, each run is a new release.",
    ],
    "roll": ["A ball is pushed along the level floor.", "Ball on the floor, pushed off in several ways."],
    "puck": ["A flat puck is pushed over the level table.", "One puck sliding on our table; it never leaves it."],
    "discs": [
        "Flat discs slide and knock into one another on a level table.",
        "Discs on the table, the first is shot.",
    ],
}


def scene_json(rng: Generator, scene: Scene) -> dict[str, Any]:
    """Return the analyst's base model."""
    objects = []
    for b in scene.bodies:
        shape: dict[str, Any] = {"kind": b.kind, "radius": b.radius}
        if b.kind == "disc":
            shape["height"] = b.height
        entry: dict[str, Any] = {
            "name": b.name,
            "shape": shape,
            "mass": b.mass,
            "restitution": b.restitution,
            "friction": b.friction,
            "spin_known": scene.orient,
            "released": scene.released,
        }
        if b.kind == "disc":
            entry["rim_friction"] = b.rim_friction
            entry["released"] = "spinning" if scene.orient else "without spin"
        objects.append(entry)
    out: dict[str, Any] = {
        "gravity": [0.0, 0.0, -9.81],
        "objects": objects,
        "floor": scene.floor,
        "walls": [
            {
                "name": p.name,
                "point": p.point.tolist(),
                "normal": p.normal.tolist(),
                "restitution": p.restitution,
                "friction": p.friction,
            }
            for p in scene.planes
            if p.normal[2] < 0.5
        ],
        "conventions": DISC if scene.flat else BALL,
        "note": str(rng.choice(NOTES[scene.rig])),
    }
    if scene.planar:
        out["note"] += " Filmed from the side: the motion stays in the plane y = 0 and y is not measured."
    if scene.flat:
        out["table"] = {"friction": scene.bodies[0].friction}
    return out


def rows(scene: Scene, record: list[tuple[Track, Array, Launch]], first: int, early: bool) -> list[str]:
    """CSV lines; early: orientations only in the first 0.1 s of a run."""
    lines = []
    for run, (track, present, launch) in enumerate(record, start=first):
        for i in range(len(track.t)):
            for k, body in enumerate(scene.bodies):
                if not present[k, i]:
                    continue
                x = [f"{value:.6f}" for value in track.x[k, i]]
                if scene.planar:
                    x[1] = ""
                if scene.flat:
                    x[2] = f"{body.height / 2:.6f}"
                cells = [str(run), body.name, f"{track.t[i]:.6f}", *x]
                if scene.orient:
                    blank = early and track.real[i] - launch.t0 > 0.1
                    cells += [""] * 4 if blank else [f"{value:.6f}" for value in track.q[k, i]]
                lines.append(",".join(cells))
    return lines


def write_case(out: File, name: str, case: Case, plan: Plan, rng: Generator) -> None:
    """Write public/<name>/ and private/<name>.json."""
    public, private = out / "public" / name, out / "private"
    public.mkdir(parents=True, exist_ok=True)
    private.mkdir(parents=True, exist_ok=True)
    scene, early = case.scene, bool(plan.options.get("spin_at_start_only"))
    head = "run,object,t,x,y,z" + (",qw,qx,qy,qz" if scene.orient else "")
    (public / "scene.json").write_text(json.dumps(scene_json(rng, scene), indent=1) + "\n")
    (public / "data.csv").write_text("\n".join([head, *rows(scene, case.rows, 0, early)]) + "\n")
    n = len(case.rows)
    (public / "held_out.csv").write_text("\n".join([head, *rows(scene, case.held_out, n, early)]) + "\n")
    clean = [
        (t, np.ones(t.x.shape[:2], dtype=bool), launch)
        for t, (_, _, launch) in zip(case.clean_held_out, case.held_out, strict=True)
    ]
    (private / f"{name}.held_out_clean.csv").write_text("\n".join([head, *rows(scene, clean, n, False)]) + "\n")
    truth = {"case": name, **case.truth}
    truth["detail"]["options"] = plan.options
    (private / f"{name}.json").write_text(json.dumps(truth, indent=1, default=float) + "\n")
