"""From a video and the bodies it is known to show to an observation of these bodies, and of nothing else.

The colours that a body's name says are looked for at the size that the camera gives it; what is found in most frames
teaches the body's own colours, with which it is looked for again. One body after the other takes its best path through
the frames, the surest first (after the track-before-detect scheme: Davey, Rutten & Cheung 2008, EURASIP J. Adv. Signal
Process., 428036).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.appearance import BIN_COUNT, colour_bins, histogram, log_likelihood
from atw_mcp.perception.background import Array32, Mask, model_background
from atw_mcp.perception.camera_motion import as_filmed, camera_motion, in_full_pixels, stabilised
from atw_mcp.perception.known.bare_background import uncovered, with_supports
from atw_mcp.perception.known.bodies import KnownBody, Sizes, fixture_depths, sizes_of
from atw_mcp.perception.known.colour_words import colour_word, word_likelihood
from atw_mcp.perception.known.evidence import UNDESCRIBED, nothing_there
from atw_mcp.perception.known.finding import Candidate, Places
from atw_mcp.perception.known.outlines import Window, around, assign_by_size, outlines
from atw_mcp.perception.known.paths import best_path
from atw_mcp.perception.known.settings import SETTINGS
from atw_mcp.perception.known.still import StillBodies
from atw_mcp.perception.known.unchanged import unchanged
from atw_mcp.perception.observation import ImageObservation, ObservationError, ObservedObject
from atw_mcp.perception.observe import describe, enlarged, reduced
from atw_mcp.perception.video import Cancelled, Frames, PerceptionCancelled, Progress, load
from polyworld.world.camera import Camera

Floats = NDArray[np.float64]


def observe_known(
    path: str | Path,
    bodies: Sequence[KnownBody],
    camera: Camera,
    places: Floats,
    *,
    floor: float = 0.0,
    fixtures: Sequence[Floats] = (),
    stride: int = 1,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> ImageObservation:
    """Find and follow known bodies in a video. places (k, 3): known points of the scene [m].

    floor: its z [m]; fixtures: corners (n, 3) [m] of convex solids that may hide bodies. Objects have the bodies'
    names; a body that was not found is named in the warnings. Raises ObservationError for a body whose colour is not a
    colour's name or whose pixel is in a frame that is not looked at, VideoError for a file that cannot be read. Equal
    inputs give equal observations.
    """
    words = [_word(body) for body in bodies]
    report = progress or (lambda _share, _what: None)

    def stop() -> None:
        if cancelled is not None and cancelled():
            raise PerceptionCancelled("observation cancelled")

    report(0.0, "reading the video")
    info, full = load(path, stride=stride)
    frames = reduced(full)
    motion = camera_motion(frames, stop)
    if motion is not None:
        frames = stabilised(frames, motion)
    report(0.1, "modelling the background")
    said = [_said(body, stride, len(frames), frames.shape[2] / camera.width) for body in bodies]
    shape = (frames.shape[1], frames.shape[2])
    sizes = [sizes_of(body, camera, places, shape, floor) for body in bodies]
    search = _Search(frames, words, sizes, fixture_depths(fixtures, camera, shape), said)
    rounds = SETTINGS.rounds
    for turn in range(rounds):
        report(0.15 + 0.7 * turn / rounds, f"looking for {len(bodies)} bodies, round {turn + 1} of {rounds}")
        search.look(stop)
        if turn < rounds - 1:
            search.uncover()
            search.learn()
    report(0.85, "outlining")
    masks = search.outlined()
    if motion is not None:
        masks = {k: [as_filmed(m, own) if m.any() else m for m, own in zip(series, motion, strict=True)]
                 for k, series in masks.items()}  # fmt: skip
    found, missing = [], []
    white = search.background.white
    for k, body in enumerate(bodies):
        seen = _described(k, [enlarged(m, full.shape[1], full.shape[2]) for m in masks[k]], full, search, white)
        if seen is None:
            missing.append(body.name)
        else:
            found.append(replace(seen, name=body.name))
    warnings = list(info.warnings) + [f"{name} ({_of(bodies, name)}) was not found" for name in missing]
    if motion is not None:
        warnings.append("the camera moves a little: frames were aligned to the first before bodies were looked for")
    report(1.0, f"{len(found)} of {len(bodies)} bodies")
    return ImageObservation(
        info,
        tuple(range(0, stride * len(full), stride)),
        tuple(found),
        tuple(warnings),
        camera_motion=in_full_pixels(motion, full.shape[2] / frames.shape[2]),
    )


def _of(bodies: Sequence[KnownBody], name: str) -> str:
    return next(body.colour for body in bodies if body.name == name)


def _word(body: KnownBody) -> str:
    word = colour_word(body.colour)
    if word is None:
        raise ObservationError(f"{body.name}: {body.colour!r} names no colour; names are such as red, dark grey, pink")
    return word


@dataclass(frozen=True)
class _Said:
    """Points on a body that were given (x, y) [px of the reduced frames]: by row, or in the first row that shows it."""

    rows: dict[int, tuple[float, float]]
    first: tuple[float, float] | None

    def __bool__(self) -> bool:
        return bool(self.rows) or self.first is not None


def _said(body: KnownBody, stride: int, count: int, scale: float) -> _Said:
    if body.pixel is None:
        return _Said({}, None)
    place = ((body.pixel[0] + 0.5) * scale - 0.5, (body.pixel[1] + 0.5) * scale - 0.5)
    if body.frame is None:
        return _Said({}, place)
    row, rest = divmod(body.frame, stride)
    if rest or row >= count:
        near = f"{stride * row} or {stride * (row + 1)}" if row < count - 1 else f"{stride * (count - 1)}"
        raise ObservationError(
            f"{body.name}: its pixel is in frame {body.frame}, which is not looked at (stride {stride}, last frame "
            f"{stride * (count - 1)}): give a pixel in a frame that is, such as {near}"
        )
    return _Said({row: place}, None)


class _Search:
    """Findings and known colours of each body. fixtures (H, W): distances [m] of what may hide
    them."""

    def __init__(
        self, frames: Frames, words: Sequence[str], sizes: Sequence[Sizes], fixtures: Array32, said: Sequence[_Said]
    ) -> None:
        self.words, self.sizes, self.said = words, sizes, said
        bare = np.isfinite(fixtures) | ~np.any([s.floor for s in sizes], axis=0)
        self.frames, self.background = frames, with_supports(model_background(frames), frames, bare)
        self.bins = [colour_bins(f) for f in frames]
        self.nothing = [nothing_there(f, self.background) for f in frames]
        self.shape = (frames.shape[1], frames.shape[2])
        still = StillBodies(self.background)
        self.colours = [word_likelihood(word) for word in words]
        self.covered = [still.covered_by(c, s, fixtures) for c, s in zip(self.colours, sizes, strict=True)]
        self.looks = [Places(s, fixtures) for s in sizes]
        self.places: list[list[Candidate | None]] = [[None] * len(frames) for _ in words]

    def ratio(self, k: int, t: int, window: Window = (slice(None), slice(None))) -> Array32:
        """Log likelihood ratio of a frame's pixels (H, W), or those of a part of it, to be a body's."""
        nothing = self.nothing[t][window]
        nothing = np.minimum(nothing, np.maximum(self.covered[k][window], UNDESCRIBED))
        ratio: Array32 = (self.colours[k][self.bins[t][window]] - nothing).astype(np.float32)
        return ratio

    def look(self, stop: Callable[[], None]) -> None:
        """Find every body's best path, the surest first; places of one are not free for the next."""
        free: list[list[list[Candidate]]] = []
        for k, places in enumerate(self.looks):
            stop()
            free.append([places.candidates(self.ratio(k, t)) for t in range(len(self.bins))])
        left = list(range(len(self.words)))
        paths = {}
        for k in left:
            free[k], paths[k] = self._without_marks(k, free[k])
        while left:
            first = max(left, key=lambda k: paths[k][0])
            left.remove(first)
            self.places[first] = paths[first][1]
            for k in left:
                still_free = [
                    frame if taken is None else [c for c in frame if not c.near(taken, SETTINGS.shared)]
                    for frame, taken in zip(free[k], self.places[first], strict=True)
                ]
                if still_free != free[k]:
                    free[k], paths[k] = still_free, self._path(k, still_free)

    def _without_marks(
        self, k: int, free: list[list[Candidate]]
    ) -> tuple[list[list[Candidate]], tuple[float, list[Candidate | None]]]:
        """Return candidates and their best path without places that look the same while the body is elsewhere."""
        path = self._path(k, free)
        for _ in range(SETTINGS.candidates):
            marks = unchanged(path[1], self.frames)
            if not marks:
                break
            free = [[c for c in frame if not any(c.near(mark, 1.0) for mark in marks)] for frame in free]
            path = self._path(k, free)
        return free, path

    def _path(self, k: int, free: list[list[Candidate]]) -> tuple[float, list[Candidate | None]]:
        return best_path(free, self.said[k].rows, self.said[k].first)

    def uncover(self) -> None:
        """Estimate the background where bodies were found at rest from the frames in which they are elsewhere."""
        better = uncovered(self.background, self.frames, self.places)
        if better is not None:
            self.background = better
            self.nothing = [nothing_there(f, better) for f in self.frames]

    def learn(self) -> None:
        """Learn each body's colours from the better half of the frames in which it was found."""
        for k, path in enumerate(self.places):
            seen = [(t, c) for t, c in enumerate(path) if c is not None]
            if not seen:
                continue
            middle = float(np.median([c.score for _, c in seen]))
            counts = np.zeros(BIN_COUNT)
            for t, c in seen:
                if c.score >= middle:
                    window, away = around(c, SETTINGS.learned, self.shape)
                    own = (away < SETTINGS.learned) & (self.ratio(k, t, window) > 0.0)
                    counts += histogram(self.bins[t][window][own])
            if counts.sum() > SETTINGS.least_pixels:
                named = word_likelihood(self.words[k]) - SETTINGS.named
                self.colours[k] = np.logaddexp(log_likelihood(counts), named)

    def _masks(self, t: int) -> list[Mask]:
        places = [series[t] for series in self.places]
        return outlines(lambda k, window: self.ratio(k, t, window), places, self.shape)

    def outlined(self) -> dict[int, list[Mask]]:
        """Masks of each body in all frames; sizes say which is which of look-alikes that nobody pointed at."""
        by_frame = [self._masks(t) for t in range(len(self.bins))]
        masks = {k: [frame[k] for frame in by_frame] for k in range(len(self.words))}
        for word in sorted(set(self.words)):
            alike = [k for k, own in enumerate(self.words) if own == word and not self.said[k]]
            areas = {k: np.array([float(m.sum()) for m in masks[k]]) for k in alike}
            which = assign_by_size(alike, areas, {k: self.places[k] for k in alike}, {k: self.sizes[k] for k in alike})
            masks.update({which[k]: series for k, series in [(k, masks[k]) for k in alike]})
            self.places = _exchanged(self.places, which)
        return masks


def _exchanged(places: list[list[Candidate | None]], which: dict[int, int]) -> list[list[Candidate | None]]:
    moved = list(places)
    for found, body in which.items():
        moved[body] = places[found]
    return moved


def _described(k: int, masks: list[Mask], frames: Frames, search: _Search, white: float) -> ObservedObject | None:
    """Return the body as an object, with a confidence that follows how clearly its pixels are its own."""
    clarity = [
        0.0 if place is None else float(1.0 / (1.0 + np.exp(-(place.score - SETTINGS.half))))
        for place in search.places[k]
    ]
    alone = [_is_alone(k, t, search) for t in range(len(masks))]
    return describe(masks, frames, clarity, alone, white)


def _is_alone(k: int, t: int, search: _Search) -> bool:
    own = search.places[k][t]
    if own is None:
        return False
    others = [series[t] for n, series in enumerate(search.places) if n != k]
    return all(
        np.hypot(o.x - own.x, o.y - own.y) > SETTINGS.alone * (o.radius + own.radius) for o in others if o is not None
    )
