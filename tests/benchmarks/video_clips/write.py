"""Write one clip to the public and private folders."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from .clip import Clip, draw_clip, generator_for
from .finish import finish, write_video
from .known import known
from .render import Film, render


def plain(value: Any) -> Any:
    """Turn numpy values and tuples into JSON values and round numbers to nine significant digits."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return float(f"{value:.9g}")
    return value


def write_clip(out: Path, name: str, seed: list[int], kind: str, style: str) -> dict[str, Any]:
    """Draw, render and write one clip; return a summary."""
    clip = draw_clip(seed, kind, style)
    film = render(generator_for(seed, 1), clip.scene, clip.look, clip.run, clip.cameras, clip.extent)
    return write_film(out, name, seed, clip, film)


def write_film(out: Path, name: str, seed: list[int], clip: Clip, film: Film) -> dict[str, Any]:
    """Write the video, the known facts, the truth and the masks of a rendered clip; return a summary."""
    public, private = out / "public" / name, out / "private"
    public.mkdir(parents=True, exist_ok=True)
    private.mkdir(parents=True, exist_ok=True)
    write_video(public, clip.look, finish(generator_for(seed, 2), clip.look, film.frames))
    facts = known(clip, film, generator_for(seed, 3))
    (public / "known.json").write_text(json.dumps(plain({"clip": name, **facts}), indent=1) + "\n")
    hidden = {"clip": name, "kind": clip.scene.kind, "style": clip.look.style, "look": asdict(clip.look)}
    (private / f"{name}.json").write_text(json.dumps(plain(hidden)) + "\n")
    np.savez_compressed(private / f"{name}_masks.npz", labels=film.labels, names=np.array(film.names))
    return {"frames": clip.look.frames, "size": clip.look.size}
