"""Write scenes: `python -m tests.benchmarks.fresh_scenes.write --out DIR --seeds 0-9 [--families ...]`."""

import argparse
import itertools
import json
import zlib
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from .draw import FAMILIES, Scene, scenes


def write(scene: Scene, folder: Path) -> None:
    world, bodies, n, shared = scene.world, scene.world.bodies, scene.frames, {"seconds_per_frame": 1 / scene.rate}
    task = shared | {"frames": n, "gravity": [0, 0, -world.gravity], "objects": [], "statics": []}
    task["floor"] = {"point": [0, 0, 0], "normal": [0, 0, 1], "material": "floor"}
    law = {"engine": scene.family.split("_")[1], "friction_and_restitution": world.surfaces, "rules": world.rules}
    law |= {k: getattr(world, k) for k in ("linear", "medium", "rolling")}
    key = shared | {"family": scene.family, "seed": scene.seed, "frames": n, "law": law, "bodies": {}}
    key["contacts"] = [{"time": t, "bodies": who} for t, *who in scene.contacts if t * scene.rate < len(scene.poses)]
    for i, b in enumerate(bodies):
        named = [("half_extents", b.size)] if b.kind == "box" else zip(("radius", "half_height"), b.size, strict=False)
        known = {"name": b.name, "material": b.material, "mass": b.mass, "shape": {"kind": b.kind, **dict(named)}}
        task["objects"].append(known)
        path = scene.poses[:, i, :3].round(6).tolist()
        key["bodies"][b.name] = {"sensitive": b.name in scene.sensitive, "positions": path}
    if r := world.ramp:
        static = {"name": r.name, "material": r.material, "kind": "box", "half_extents": r.size}
        task["statics"] = [static | {"position": r.position.tolist(), "orientation": r.orientation.tolist()}]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "task.json").write_text(json.dumps(task, indent=1) + "\n")
    (folder / "key.json").write_text(json.dumps(key) + "\n")
    flat, half = scene.poses[:n].reshape(-1, 7), np.tile([b.size[0] for b in bodies], n)[:, None]
    for mm in (5, 20):
        rng = np.random.default_rng([zlib.crc32(scene.family.encode()), scene.seed, mm])
        noise, lines = rng.normal(0, mm / 1000, (2, len(flat), 3)), ["frame,object,x,y,z,qw,qx,qy,qz,sigma"]
        turned = Rotation.from_rotvec(noise[1] / half) * Rotation.from_quat(flat[:, 3:], scalar_first=True)
        seen = np.hstack([flat[:, :3] + noise[0], turned.as_quat(canonical=True, scalar_first=True)])
        for i, row in enumerate(seen):
            values = ",".join(f"{value:.6f}" for value in row)
            lines.append(f"{i // len(bodies)},{bodies[i % len(bodies)].name},{values},{mm / 1000}")
        (folder / f"tracks_{mm}mm.csv").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", default="0-9", help="first-last")
    parser.add_argument("--families", nargs="*", default=FAMILIES, choices=FAMILIES)
    given = parser.parse_args()
    first, last = map(int, given.seeds.split("-"))
    for family, seed in itertools.product(given.families, range(first, last + 1)):
        write(scenes(family, seed), given.out / f"{family}_{seed:03d}")
