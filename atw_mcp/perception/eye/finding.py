"""Find known solids in a film: which regions that move, stand out or have its colour are each of them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment

from atw_mcp.perception.eye.bodies import FAR, Solid
from atw_mcp.perception.eye.colour_names import log_look, log_name
from atw_mcp.perception.eye.discover import discover, outline_in_full
from atw_mcp.perception.eye.follow import seeded
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.pixels import Array, Bytes, Film, Floats, filled, learn_background
from atw_mcp.perception.eye.regions import reduced
from atw_mcp.perception.eye.search import Silhouettes
from atw_mcp.perception.eye.seeds import Seed
from atw_mcp.perception.eye.settings import EyeSettings

Pointed = tuple[int, tuple[float, float]]  # frame and pixel


@dataclass(frozen=True)
class Found:
    """A solid's outline at the frame that shows it best. on_plane: its silhouette on its plane of motion is that.

    outlines: by frame, of the region that shows it longest. others (N, 2) [px]: places in the seed's frame where it may
    as well be.
    """

    seed: Seed
    on_plane: bool
    outlines: Mapping[int, Floats]
    others: Floats


@dataclass(frozen=True)
class _Candidate:
    """What may be a body: outlines (V, 2) [px] by frame, the frame that shows it best, and log odds that it is one.

    sought: name of the body by whose silhouette it was found.
    """

    outlines: Mapping[int, Floats]
    best: int
    prior: float
    sought: str | None = None

    def sampled(self, most: int) -> list[int]:
        frames = sorted(self.outlines)
        return [frames[k] for k in np.unique(np.linspace(0, len(frames) - 1, min(most, len(frames))).astype(int))]


def find_solids(
    frames: Bytes,
    bodies: Sequence[Solid],
    words: Mapping[str, str],
    pointed: Mapping[str, Pointed],
    settings: EyeSettings,
    hiding: Array | None = None,
    tick: Callable[[], None] = lambda: None,
) -> dict[str, Found]:
    """Find solids by name: those that some region of frames (T, H, W, 3) of BGR bytes is likely to be.

    Each pair's log likelihood is that of the colour's name, of size and shape on the plane of motion or anywhere in
    view, and of being a body at all; together they are largest, and a region is one body's. Where no region shows a
    body on its plane, all are also searched for by their silhouettes there. pointed: a frame and a pixel on a body.
    hiding (H, W): depth of known things that never move.
    """
    named = {*np.linspace(0, len(frames) - 1, settings.named_frames).astype(int).tolist()}
    candidates = _candidates(
        frames, set(words.values()), named | {k for k, _ in pointed.values()}, hiding, settings, tick
    )
    judged = _judged(frames, bodies, words, pointed, candidates, settings)
    found = _assigned(bodies, candidates, judged, settings)
    missing = [b for b in bodies if b.name not in pointed and not (b.name in found and found[b.name].on_plane)]
    if missing:
        taken = [one.outlines for one in found.values() if one.on_plane]
        sought = _sought(frames, missing, words, taken, sorted(named), hiding, settings, tick)
        own = _judged(frames, bodies, words, pointed, sought, settings)
        judged = [np.concatenate(pair, axis=1) for pair in zip(judged, own, strict=True)]
        found = _exchanged(
            frames, bodies, words, _assigned(bodies, candidates + sought, judged, settings), hiding, settings
        )
    return found


def _judged(
    frames: Bytes,
    bodies: Sequence[Solid],
    words: Mapping[str, str],
    pointed: Mapping[str, Pointed],
    candidates: Sequence[_Candidate],
    settings: EyeSettings,
) -> list[Floats]:
    """Log likelihoods (B, C) that bodies are candidates, and for the frame that shows each pair most clearly its own
    and its number."""
    gains, clearest, frame = np.full((3, len(bodies), len(candidates)), -np.inf)
    for j, candidate in enumerate(candidates):
        looks = {k: _looks(frames[k], candidate.outlines[k], set(words.values())) for k in candidate.sampled(8)}
        for i, body in enumerate(bodies):
            if body.name in pointed and not _shows(candidate, *pointed[body.name]):
                continue
            if candidate.sought not in (None, body.name):
                continue
            look = {k: own[words[body.name]] if body.name in words else 0.0 for k, own in looks.items()}
            usual = float(np.median(list(look.values())))
            # A silhouette says that something is there, and its colour alone what it is.
            if usual > -(2 * settings.likely if candidate.sought else settings.unlikely):
                fits = {k: _log_fit(body, candidate.outlines[k], settings) for k in look}
                gains[i, j] = usual + max(fits.values()) + candidate.prior
                clearest[i, j], frame[i, j] = max((look[k] + fits[k], k) for k in look)
    return [gains, clearest, frame]


def _assigned(
    bodies: Sequence[Solid], candidates: Sequence[_Candidate], judged: Sequence[Floats], settings: EyeSettings
) -> dict[str, Found]:
    gains, clearest, frames = judged
    groups: list[list[int]] = []  # of one body
    for j, one in enumerate(candidates):
        same = [g for g in groups if any(_same(one, candidates[k]) for k in g)]
        groups = [g for g in groups if g not in same] + [[j, *(k for g in same for k in g)]]
    if not groups or not bodies:
        return {}
    best = np.array([[max(g, key=lambda j: own[j]) for g in groups] for own in gains])
    price = -np.take_along_axis(gains, best, axis=1)
    price = np.c_[np.where(np.isfinite(price), price, 1e6), np.full((len(bodies), len(bodies)), 1e3)]
    rows, columns = linear_sum_assignment(price)
    found: dict[str, Found] = {}
    for i, g in zip(rows, columns, strict=True):
        if g < len(groups) and price[i, g] < settings.unlikely:
            regions = [j for j in groups[g] if candidates[j].sought is None and np.isfinite(gains[i, j])]
            likely = [candidates[j] for j in regions if gains[i, j] > gains[i, regions].max() - settings.likely]
            longest = max(likely, key=lambda c: len(c.outlines), default=None)
            on_plane = None if longest is None else _on_plane(bodies[i], longest, settings)
            allowed = regions if on_plane is False else groups[g]
            near = [j for j in allowed if gains[i, j] > gains[i, allowed].max() - settings.likely]
            _, j = max((clearest[i, j], j) for j in near)
            shown = int(frames[i, j])
            seed = Seed.outlined(bodies[i].name, shown, candidates[j].outlines[shown])
            competitors = [candidates[m] for h in {*range(len(groups))} - {*columns} for m in groups[h]
                      if candidates[j].sought and gains[i, m] > gains[i, j] - settings.likely]  # fmt: skip
            others = [c.outlines[c.best].mean(axis=0) for c in competitors if c.sought and c.best == seed.frame]
            sure = candidates[j].sought is not None if on_plane is None else on_plane
            outlines = (longest or candidates[j]).outlines
            found[seed.object] = Found(seed, sure, outlines, np.array(others).reshape(-1, 2))
    return found


def _exchanged(
    frames: Bytes,
    bodies: Sequence[Solid],
    words: Mapping[str, str],
    found: dict[str, Found],
    hiding: Array | None,
    settings: EyeSettings,
) -> dict[str, Found]:
    """Give solids of one colour's name, found in one frame, the places where silhouettes of their shapes fit best.

    Steps across an edge say little of which shape it is; colours learned from a place, and where they end, do.
    """
    alike: dict[tuple[str | None, int], list[int]] = {}
    for i, body in enumerate(bodies):
        if body.name in found:
            alike.setdefault((words.get(body.name), found[body.name].seed.frame), []).append(i)
    exchangeable = [(frame, own) for (word, frame), own in alike.items() if word is not None and len(own) > 1]
    if not exchangeable:
        return found
    film = Film(frames, settings)
    scene = Scene(film, list(bodies), settings, learn_background(film, film.nothing()), hiding)
    for frame, own in exchangeable:
        orders = itertools.permutations([found[bodies[i].name] for i in own])
        best = max(orders, key=lambda order: sum(map(partial(_fitting, scene, frame=frame), own, order)))
        for i, place in zip(own, best, strict=True):
            found[bodies[i].name] = replace(place, seed=replace(place.seed, object=bodies[i].name))
    return found


def _fitting(scene: Scene, body: int, place: Found, frame: int) -> float:
    """Log odds [nats] summed over a body's pixels at a place, by colours that are learned there."""
    pose = scene.bodies[body].placed(place.seed.points().mean(axis=0), np.zeros(4))
    for _ in range(3):
        scene.poses[body, frame] = pose
        scene.learn_body(body, [frame], rough=True)
        state = seeded(scene, body, frame, pose)
        pose = state.fit.pose
    scene.poses[body, frame], scene.colours[body] = np.nan, None
    return state.inside * state.visible * abs(cv2.contourArea(scene.bodies[body].polygon(pose).astype(np.float32)))


def _sought(
    frames: Bytes,
    bodies: Sequence[Solid],
    words: Mapping[str, str],
    taken: Sequence[Mapping[int, Floats]],
    numbers: Sequence[int],
    hiding: Array | None,
    settings: EyeSettings,
    tick: Callable[[], None],
) -> list[_Candidate]:
    """Places of bodies on their planes by their silhouettes, in that of some frames which shows all most clearly.

    taken: outlines of other bodies by frame; one alone is of a body at rest.
    """
    small, factor = reduced(frames[numbers], settings.discovery_pixels)
    layouts = [Silhouettes(b, factor, settings, hiding) for b in bodies]
    choices = []
    for k, frame in zip(numbers, small, strict=True):
        total, found = 0.0, []
        for body, layout in zip(bodies, layouts, strict=True):
            tick()
            odds = [0.0]
            for pose, odd in layout.best(frame, settings.sought):
                outline = body.polygon(pose)
                there = (own.get(k, next(iter(own.values())) if len(own) == 1 else None) for own in taken)
                if any(o is not None and _holds(o, outline.mean(axis=0), 0.0) for o in there):
                    continue
                found.append(_Candidate({k: outline}, k, float(np.log(settings.at_rest) + odd), sought=body.name))
                word = words.get(body.name)
                odds.append(odd + (_looks(frames[k], outline, {word})[word] if word else 0.0))
            total += max(odds)
        choices.append((total, k, found))
    return max(choices, key=lambda c: c[:2])[2]


def _candidates(
    frames: Bytes,
    words: set[str],
    numbers: set[int],
    hiding: Array | None,
    settings: EyeSettings,
    tick: Callable[[], None],
) -> list[_Candidate]:
    """Regions that move and that stand out, and in some frames those of the words' colours.

    What follows another region as its shadow does is unlikely to be a body, but two on one string do as well.
    """
    found = []
    for p in discover(frames, settings, tick=tick):
        frame = p.seeds[0].frame
        outlines = {r.frame: outline_in_full(r, r.picture[1] / frames.shape[2]) for r in p.regions}
        outlines[frame] = p.seeds[0].points()
        moves = p.moves if p.regions else settings.at_rest * p.moves
        found.append(_Candidate(outlines, frame, float(np.log(max(moves, 0.02)))))
    small, factor = reduced(frames, settings.discovery_pixels)
    free = np.ones(small.shape[1:3], np.uint8)
    if hiding is not None:
        depth = cv2.resize(hiding, small.shape[2:0:-1], interpolation=cv2.INTER_NEAREST)
        free = (depth >= FAR).astype(np.uint8)
    for k in sorted(numbers):
        for word in sorted(words):
            for outline in _named(small[k], word, free, factor, settings):
                found.append(_Candidate({k: outline}, k, float(np.log(settings.at_rest))))
    return found


def _named(frame: Bytes, word: str, free: Bytes, factor: float, settings: EyeSettings) -> list[Floats]:
    """Outlines [px of the whole frame] of the regions of a frame's free pixels that are called by a word."""
    share = cv2.GaussianBlur(np.exp(log_name(frame, word.split()[-1])), (0, 0), 0.7)
    mask = cv2.morphologyEx((share > settings.named).astype(np.uint8) & free, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    found = []
    for contour in contours:
        area = cv2.contourArea(contour)
        solid = area / max(cv2.contourArea(cv2.convexHull(contour)), 1.0)
        if settings.least_region < area < settings.largest_standing * mask.size and solid > settings.hollow:
            found.append((contour[:, 0].astype(float) + 0.5) / factor - 0.5)
    return found


def _looks(frame: Bytes, outline: Floats, names: set[str]) -> dict[str, float]:
    """Log probability of each colour's name by the pixels inside an outline, but for its rim."""
    low = np.clip(np.floor(outline.min(axis=0)).astype(int), 0, [frame.shape[1], frame.shape[0]])
    high = np.clip(np.ceil(outline.max(axis=0)).astype(int) + 1, 0, [frame.shape[1], frame.shape[0]])
    (u, v), (width, height) = (int(c) for c in low), (int(c) for c in high - low)
    if min(width, height) < 1:
        return dict.fromkeys(names, -np.inf)
    mask = filled(outline, (u, v), (width, height))
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0
    levels = frame[v : v + height, u : u + width][inner if inner.any() else mask]
    return {name: log_look(levels, name) for name in names}


def _log_fit(body: Solid, outline: Floats, settings: EyeSettings) -> float:
    """Log likelihood of an outline's size and shape on the plane of motion, or of its size at any distance in view."""
    area = max(cv2.contourArea(outline.astype(np.float32)), 1.0)
    depth = float(body.camera.intrinsics[0][0]) * float(np.mean(body.half)) / np.sqrt(area / np.pi)
    width, height = body.camera.width, body.camera.height
    views = [body.placed(np.array([0.5 * width, s * height]), np.zeros(4)) for s in (0.5, 0.75, 1.0)]
    depths = [body.depth(p) for p in views if np.isfinite(p).all() and body.depth(p) > 0]
    free = -np.log(settings.free_depth) - 0.5 * (np.log(depth / depths[0]) / settings.free_depth) ** 2 if depths else 0
    on_plane, (overlap, there, shape) = -np.inf, _overlap(body, outline)
    if there:
        edge = settings.misfit + 1.4 / np.sqrt(area / np.pi)  # 0.7 px of the edge over the radius
        ratio = np.log(area / there) / settings.plane_size
        on_plane = -np.log(settings.plane_size) - 0.5 * (ratio**2 + ((1 - overlap) / edge) ** 2)
        free -= 0.5 * ((1 - shape) / edge) ** 2
    return float(np.logaddexp(on_plane, free + np.log(0.3)))


def _on_plane(body: Solid, candidate: _Candidate, settings: EyeSettings) -> bool | None:
    """Whether silhouettes of a solid on its plane, standing or lying, have the places and sizes of a candidate's
    outlines in the frames that show it whole; None where these have not its shape. Elsewhere the ratio of sizes changes
    along the way."""
    size = (body.camera.width, body.camera.height)
    whole = [k for k in candidate.sampled(16) if not _cut(candidate.outlines[k], *size)]
    fits = []  # overlap, log ratio of areas, overlap at equal areas
    for k in whole or [candidate.best]:
        outline = candidate.outlines[k]
        own = max(cv2.contourArea(outline.astype(np.float32)), 1.0)
        overlap, area, shape = _overlap(body, outline)
        fits.append((overlap, np.log(own / area) if area else np.inf, shape))
    overlaps, ratios, shapes = np.array(fits).T
    clear = shapes > settings.overlap + 0.1 if np.isfinite(ratios).all() else np.ones(len(shapes), bool)
    if clear.sum() < 0.3 * len(clear):
        return None
    low, middle, high = np.percentile(ratios[clear], [15, 50, 85], method="nearest")
    area = max(cv2.contourArea(candidate.outlines[candidate.best].astype(np.float32)), 1.0)
    edge = 0.5 / float(np.sqrt(area / np.pi))  # a quarter of a pixel along all of it
    alike = abs(middle) < settings.plane_size + 2 * edge and high - low < 0.5 * settings.plane_size + 2 * edge
    if alike and np.median(overlaps[clear]) > settings.overlap:
        return True
    return None if np.isfinite(ratios).all() and np.median(shapes) < 1 - 1.5 * settings.misfit else False


def _cut(outline: Floats, width: int, height: int) -> bool:
    return bool((outline < 2).any() or (outline > [width - 3, height - 3]).any())


def _overlap(body: Solid, outline: Floats) -> tuple[float, float, float]:
    """Greatest intersection over union of a solid's silhouette on its plane, standing or lying, with an outline of the
    same centre, its area [px^2], and their overlap were the areas equal; zero of one that has no place there."""
    own = max(cv2.contourArea(outline.astype(np.float32)), 1.0)
    best, scale = (0.0, 0.0, 0.0), max(1.0, 20.0 / np.sqrt(cv2.contourArea(outline.astype(np.float32)) / np.pi + 1.0))
    middle = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
    laid = [replace(body, lies=True)] if body.kind == "cylinder" and not body.upright else []
    for solid, angle in ((b, a) for b in (body, *laid) for a in b.angles()):
        pose = solid.about(middle, angle)
        polygon = None if pose is None else solid.polygon(pose)
        if polygon is None or np.ptp(np.concatenate([polygon, outline])) > 10 * np.ptp(outline):
            continue
        area = max(float(cv2.contourArea(polygon.astype(np.float32))), 1.0)
        centre = 0.5 * (polygon.min(axis=0) + polygon.max(axis=0))
        shares = []
        for own_size in (polygon, centre + (polygon - centre) * np.sqrt(own / area)):
            both = np.concatenate([own_size, outline])
            low = np.floor(both.min(axis=0)) - 1
            size = tuple(int(n) for n in np.ceil((both.max(axis=0) - low) * scale) + 2)
            one, other = (filled((p - low) * scale, (0, 0), (size[0], size[1])) for p in (own_size, outline))
            shares.append(float((one & other).sum() / max((one | other).sum(), 1)))
        best = max(best, (shares[0], area, shares[1]))
    return best


def _shows(candidate: _Candidate, frame: int, pixel: tuple[float, float]) -> bool:
    outline = candidate.outlines.get(frame)
    return outline is not None and _holds(outline, np.array(pixel), 2.0)


def _holds(outline: Floats, point: Floats, margin: float) -> bool:
    """Whether a point (2,) lies in an outline or within a margin [px] of it."""
    u, v = (float(x) for x in point)
    return cv2.pointPolygonTest(outline.astype(np.float32)[:, None], (u, v), True) >= -margin


def _same(one: _Candidate, other: _Candidate) -> bool:
    """Whether two candidates show one body: in a frame of both, the centre of each lies in the other."""
    for k in set(one.outlines) & set(other.outlines):
        a, b = one.outlines[k], other.outlines[k]
        if _holds(a, b.mean(axis=0), 0.0) and _holds(b, a.mean(axis=0), 0.0):
            return True
    return False
