"""Six real films through the tools, each body from one outline: `python -m tests.benchmarks.films [--only NAME]`.

OpenCase, ObserveObjects with corrections that add the outlines (drawn by eye on one enlarged frame; drop what was found
unaided), InspectObservedMotion. Data: ../shared/data/films (README there). [--pictures DIR] writes InspectFrames'
views.
A body's frames: those in which it can be seen in the film, by eye. Its references: colour centroids (pucks), hand
tracking along the incline (cart), a bright spot in the cup's column (cups), places taken by eye (tennis ball), free
flight (balls: fourth-order curves, since lenses bend parabolas). wrong: frames farther than half a radius from the
reference, or seen where nothing is, with a confidence above 0.8. Verdict by the median body: good: nine of ten frames
seen surely and nothing wrong; usable: six; partial: two; else nothing; wrong where a frame is.
"""

from __future__ import annotations

import argparse
import base64
import csv
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import anyio
import cv2
import numpy as np
from mcp import Client
from numpy.typing import NDArray

from atw_mcp.perception.video import read_frames
from atw_mcp.server import build_server
from tests.benchmarks.clevrer_tools import Caller

FILMS = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "films"
CONFIDENT = 0.8
CUP = np.array([(-4.0, -2.2), (4.0, -2.2), (2.2, 2.2), (-2.2, 2.2)])
COLUMNS = (179.3, 189.7, 204.5, 214.6, 228.6, 240.3, 252.1, 263.9)  # u of each cup [px] in frame 10
ROWS = (53.1, 57.6, 63.7, 69.3, 71.1, 73.0, 75.2, 74.0)  # v in frame 10
LAST = (51, 46, 39, 34, 31, 30, 27, 27)  # frames in which cups reach the caption or the border
CART = "209 263 219 262 338 244 343 240 350 246 357 258 358 274 343 276 224 297 210 298 206 275"

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Body:
    """A body of a film: its outline as a correction in a frame, the first and last frame that show it, radius [px]."""

    name: str
    frame: int
    shape: dict[str, object]
    first: int
    last: int
    radius: float


def _circle(name: str, frame: int, u: float, v: float, radius: float, first: int, last: int) -> Body:
    return Body(name, frame, {"circle": [u, v, radius]}, first, last, radius)


def _cups() -> list[Body]:
    places = np.c_[COLUMNS, ROWS]
    return [Body(f"cup{i + 1}", 10, {"outline": (CUP + p).tolist()}, 4, LAST[i], 3.2) for i, p in enumerate(places)]


BODIES = {
    "BallDrop.mp4": [_circle("ball", 10, 198.0, 149.0, 5.5, 0, 17)],
    "BallTossOut.mp4": [_circle("ball", 10, 128.0, 206.5, 5.2, 9, 31)],
    "PucksCollide.mp4": [_circle("blue", 8, 107.5, 117.5, 17.3, 0, 32), _circle("red", 8, 189.0, 188.5, 17.0, 0, 32)],
    "CupsClips.mp4": _cups(),
    "cart_on_incline.mp4": [
        Body("cart", 110, {"outline": np.array(CART.split(), float).reshape(-1, 2).tolist()}, 0, 327, 47.0)
    ],
    "tennis_ball_bounce.gif": [_circle("ball", 10, 38.2, 135.0, 6.0, 0, 43)],
}


async def follow(name: str, pictures: Path | None) -> tuple[dict[str, Floats], list[str], float]:
    """Places and confidence (T, 3) of each body by the tools, their warnings, and seconds of both observations."""
    file, bodies = FILMS / name, BODIES[name]
    with tempfile.TemporaryDirectory() as store:
        async with Client(build_server(Path(store) / "atw.db", allow=[FILMS])) as client:
            call = Caller(client)
            opened = await call("OpenCase", video=str(file))
            case, began = opened["case"], time.perf_counter()
            found = await call("ObserveObjects", case=case, max_objects=1)  # corrections need an observation
            given = [{"kind": "add", "object": f"my_{b.name}", "frame": b.frame, **b.shape} for b in bodies]
            drops = [{"kind": "drop", "object": o["name"]} for o in found["data"]["objects"]]
            seen = await call("ObserveObjects", case=case, corrections=[*drops, *given])
            seconds = time.perf_counter() - began
            tracks = {}
            for b in bodies:
                read = await call("InspectObservedMotion", case=case, object=f"my_{b.name}", limit=500)
                table, columns = read["data"]["rows"], read["data"]["columns"]
                wanted = [columns.index(c) for c in ("u", "v", "confidence")]
                tracks[b.name] = np.array([[np.nan if row[c] is None else row[c] for c in wanted] for row in table])
            if pictures:
                await _draw(client, case, pictures / Path(name).stem, len(tracks[bodies[0].name]))
    return tracks, seen["data"]["warnings"], seconds


async def _draw(client: Client, case: str, stem: Path, count: int) -> None:
    """Write twelve of InspectFrames' views."""
    chosen = np.unique(np.linspace(0, count - 1, 12).astype(int)).tolist()
    looked = await client.call_tool("InspectFrames", {"case": case, "frames": chosen, "pictures": len(chosen)})
    stem.parent.mkdir(parents=True, exist_ok=True)
    for number, content in enumerate(c for c in looked.content if c.type == "image"):
        Path(f"{stem}_{number}.png").write_bytes(base64.b64decode(content.data))


def reference(name: str, body: Body, track: Floats) -> Floats:
    """Distances (T,) [px] of a track from what is known of a body, NaN where nothing is."""
    error = np.full(len(track), np.nan)
    if name == "PucksCollide.mp4":
        for r in _read("PucksCollide_threshold.csv"):
            k = int(r["frame"])
            if k < len(track) and r[f"{body.name}_u"]:
                place = float(r[f"{body.name}_u"]), float(r[f"{body.name}_v"])
                error[k] = np.hypot(*(track[k, :2] - place))
    elif name == "cart_on_incline.mp4":
        error = _along_incline(track)
    elif name == "CupsClips.mp4":
        error = _from_spots(int(body.name[3:]) - 1, track)
    elif name.startswith("Ball"):
        seen = np.arange(body.frame, min(body.last + 1, len(track)))
        seen = seen[np.isfinite(track[seen, 0])]
        if len(seen) > 6:
            fits = [np.polyfit(seen - 20.0, track[seen, axis], 4) for axis in (0, 1)]
            error[seen] = np.hypot(*[np.polyval(f, seen - 20.0) - track[seen, a] for a, f in enumerate(fits)])
    else:
        for k, u, v in TENNIS:
            error[k] = np.hypot(track[k, 0] - u, track[k, 1] - v)
    return error


TENNIS = (  # frame, u, v by eye; streaks by their middles
    (1, 37.5, 36.7),
    (2, 37, 43),
    (4, 35, 128.5),
    (6, 35, 275),
    (7, 35, 221.8),
    (9, 37.5, 144),
    (11, 39.2, 144),
    (12, 39.5, 169.5),
    (13, 40.8, 230.5),
    (14, 42, 279.7),
    (15, 44.5, 224),
    (16, 47, 201),
    (18, 52.5, 199),
    (21, 59.5, 254),
    (24, 65, 232),
    (25, 68, 274),
    (27, 69, 248),
    (35, 63, 274.5),
    (39, 59, 279),
    (42, 58.5, 284),
)


def _along_incline(track: Floats) -> Floats:
    """Distances from hand tracking along the incline [cm], by the best line to pixels and shift of frames."""
    rows = [
        (round(float(r["t"]) * 30), float(r["x"]), float(r["y"]))
        for r in _read("cart_on_incline_tracker.csv")
        if r["x"] and r["y"]
    ]
    index, along = np.array([r[0] for r in rows]), _principal(np.array([r[1:] for r in rows]))
    best = np.full(len(track), np.nan)
    for shift in range(-3, 4):
        at = index + shift
        keep = (at >= 0) & (at < len(track))
        keep[keep] &= np.isfinite(track[at[keep], 0])
        if keep.sum() < 20:
            continue
        pixels = _principal(track[at[keep], :2])
        own, near = along[keep], np.ones(int(keep.sum()), bool)
        left = np.zeros(len(own))
        for _ in range(8):  # least squares without the farthest, from where either may be wrong
            left = np.abs(np.polyval(np.polyfit(own[near], pixels[near], 1), own) - pixels)
            near = left <= 3 * np.median(left) + 0.1
        if not np.isfinite(best).any() or np.median(left) < np.nanmedian(best):
            best = np.full(len(track), np.nan)
            best[at[keep]] = left
    return best


def _principal(places: Floats) -> Floats:
    """Places (T, 2) along their principal axis."""
    apart = places - np.median(places, axis=0)
    axis = np.linalg.svd(apart, full_matrices=False)[2][0]
    return np.asarray(apart @ axis * np.sign(axis[0]))


def _from_spots(cup: int, track: Floats) -> Floats:
    """Distances from the brightest wide spot in a cup's column."""
    error = np.full(len(track), np.nan)
    frames = read_frames(FILMS / "CupsClips.mp4")
    for k in range(6, min(LAST[cup], len(track))):
        bright = (frames[k, 38:228, 165:290].min(axis=-1) > 120).astype(np.uint8)
        _, _, stats, centres = cv2.connectedComponentsWithStats(bright, connectivity=8)
        spots = centres[1:][(stats[1:, 2] >= 4) & (stats[1:, 2] < 14)] + [165, 38]
        order = spots[np.argsort(spots[:, 0])]
        here = order[np.abs(order[:, 0] - COLUMNS[cup]) < 5]
        if len(here) == 1:
            error[k] = np.hypot(*(track[k, :2] - here[0]))
    return error


def _read(name: str) -> list[dict[str, str]]:
    return list(csv.DictReader((FILMS / name).read_text().splitlines()))


def judge(name: str, tracks: dict[str, Floats]) -> str:
    """Print a row for each body of a film; return the verdict."""
    shares, wrongs = [], 0
    for body in BODIES[name]:
        track = tracks[body.name]
        error, sure = reference(name, body, track), track[:, 2] > CONFIDENT
        last = min(body.last, len(track) - 1)
        shown = np.zeros(len(track), bool)
        shown[body.first : last + 1] = True
        wrong = sure & ((error > 0.5 * body.radius) | ~shown)
        known = error[np.isfinite(error)]
        text = f"{np.median(known):.2f} / {np.percentile(known, 90):.2f} px of {len(known)}" if len(known) else "-"
        shares.append(float((sure & shown & ~wrong).sum() / shown.sum()))
        wrongs += int(wrong.sum())
        print(
            f"  {body.name:<6} seen {int(np.isfinite(track[shown, 0]).sum())} of {int(shown.sum())}, surely "
            f"{int((sure & shown).sum())}  reference {text}  wrong {np.flatnonzero(wrong).tolist()}"
        )
    middle = float(np.median(shares))
    verdict = "good" if middle >= 0.9 else "usable" if middle >= 0.6 else "partial" if middle >= 0.2 else "nothing"
    return f"{verdict}, {wrongs} wrong" if wrongs else verdict


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="part of a name")
    parser.add_argument("--pictures", type=Path, metavar="DIR")
    asked = parser.parse_args()
    if not FILMS.exists():
        print(f"skipped: {FILMS} is absent")
        return
    for name in (n for n in BODIES if asked.only in n):
        tracks, warnings, seconds = anyio.run(follow, name, asked.pictures)
        print(f"{name}  {seconds:.1f} s", *warnings, sep="\n  ! ")
        print(f"  {judge(name, tracks)}", flush=True)


if __name__ == "__main__":
    main()
