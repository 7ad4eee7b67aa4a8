"""From a video and the bodies it is known to show to an observation of these bodies, and of nothing else.

The colours that a body's name says are looked for at the size that the camera gives it; what is found in most frames
teaches the body's own colours, with which it is looked for again. One body after the other takes its best path through
the frames, the surest first (after the track-before-detect scheme: Davey, Rutten & Cheung 2008, EURASIP J. Adv. Signal
Process., 428036).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.appearance import BIN_COUNT, colour_bins, histogram, log_likelihood
from atw_mcp.perception.background import Array32, Mask, model_background
from atw_mcp.perception.camera_motion import as_filmed, camera_motion, stabilised
from atw_mcp.perception.known.bodies import KnownBody, sizes_of
from atw_mcp.perception.known.colour_words import colour_word, word_likelihood
from atw_mcp.perception.known.evidence import nothing_there
from atw_mcp.perception.known.finding import Candidate, best_path, candidates
from atw_mcp.perception.known.outlines import assign_by_size, outlines
from atw_mcp.perception.known.still import StillBodies
from atw_mcp.perception.observation import ImageObservation, ObservationError, ObservedObject
from atw_mcp.perception.observe import describe, enlarged, reduced
from atw_mcp.perception.video import Cancelled, Frames, PerceptionCancelled, Progress, load
from polyworld.camera import Camera

Floats = NDArray[np.float64]

ROUNDS = 3  # of looking: by name, then twice by the colours found
SHARED = 0.6  # radii within which two bodies cannot be
STILL = -1.0  # log likelihood that stands for a background that a body may cover
LEARNED = 0.9  # radii within which colours are learned
NAME_WEIGHT = -2.0  # log weight of a name's colours beside the learned ones
LEAST_PIXELS = 30  # to learn colours from
HALF = 1.0  # log likelihood ratio per pixel at which a body's place is half sure


def observe_known(
    path: str | Path,
    bodies: Sequence[KnownBody],
    camera: Camera,
    places: Floats,
    *,
    stride: int = 1,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> ImageObservation:
    """Find and follow known bodies in a video. places (k, 3): known points of the scene [m].

    Objects have the bodies' names; a body that was not found is named in the warnings. Raises ObservationError for a
    body whose colour is not a colour's name, VideoError for a file that cannot be read. Equal inputs give equal
    observations.
    """
    words = [_word(body) for body in bodies]
    tell = progress or (lambda _share, _what: None)

    def stop() -> None:
        if cancelled is not None and cancelled():
            raise PerceptionCancelled("observation cancelled")

    tell(0.0, "reading the video")
    info, full = load(path, stride=stride)
    frames = reduced(full)
    motion = camera_motion(frames, stop)
    if motion is not None:
        frames = stabilised(frames, motion)
    tell(0.1, "modelling the background")
    search = _Search(frames, bodies, words, camera, places)
    for turn in range(ROUNDS):
        tell(0.15 + 0.7 * turn / ROUNDS, f"looking for {len(bodies)} bodies, round {turn + 1} of {ROUNDS}")
        search.look(stop)
        if turn < ROUNDS - 1:
            search.learn()
    tell(0.85, "outlining")
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
    tell(1.0, f"{len(found)} of {len(bodies)} bodies")
    return ImageObservation(info, tuple(range(0, stride * len(full), stride)), tuple(found), tuple(warnings))


def _of(bodies: Sequence[KnownBody], name: str) -> str:
    return next(body.colour for body in bodies if body.name == name)


def _word(body: KnownBody) -> str:
    word = colour_word(body.colour)
    if word is None:
        raise ObservationError(f"{body.name}: {body.colour!r} names no colour; names are such as red, dark grey, pink")
    return word


class _Search:
    """What is found of each body, and what is known of its colours."""

    def __init__(
        self, frames: Frames, bodies: Sequence[KnownBody], words: Sequence[str], camera: Camera, places: Floats
    ) -> None:
        self.bodies, self.words = bodies, words
        self.background = model_background(frames)
        self.bins = [colour_bins(f) for f in frames]
        self.nothing = [nothing_there(f, self.background) for f in frames]
        self.shape = (frames.shape[1], frames.shape[2])
        self.sizes = [sizes_of(body, camera, places, self.shape) for body in bodies]
        still = StillBodies(self.background)
        self.colours = [word_likelihood(word) for word in words]
        self.covered = [still.covered_by(c, s) for c, s in zip(self.colours, self.sizes, strict=True)]
        scale = self.shape[1] / camera.width
        self.said = [
            {row: ((x + 0.5) * scale - 0.5, (y + 0.5) * scale - 0.5) for row, x, y in body.pixels if row < len(frames)}
            for body in bodies
        ]
        self.places: list[list[Candidate | None]] = [[None] * len(frames) for _ in bodies]

    def ratio(self, k: int, t: int) -> Array32:
        """Log likelihood ratio (H, W) of a frame's pixels to be a body's."""
        nothing = np.where(self.covered[k], np.minimum(self.nothing[t], STILL), self.nothing[t])
        ratio: Array32 = (self.colours[k][self.bins[t]] - nothing).astype(np.float32)
        return ratio

    def look(self, stop: Callable[[], None]) -> None:
        """Find every body's best path, the surest first; places of one are not free for the next."""
        free: list[list[list[Candidate]]] = []
        for k in range(len(self.bodies)):
            stop()
            free.append([candidates(self.ratio(k, t), self.sizes[k]) for t in range(len(self.bins))])
        left = sorted(range(len(self.bodies)), key=lambda k: -len(self.said[k]))
        while left:
            paths = {k: best_path(free[k], self.said[k]) for k in left}
            first = max(left, key=lambda k: paths[k][0])
            left.remove(first)
            self.places[first] = paths[first][1]
            for t, taken in enumerate(self.places[first]):
                if taken is not None:
                    for k in left:
                        free[k][t] = [c for c in free[k][t] if not c.near(taken, SHARED)]

    def learn(self) -> None:
        """Learn each body's colours from the better half of the frames in which it was found."""
        y, x = np.mgrid[0 : self.shape[0], 0 : self.shape[1]]
        for k, path in enumerate(self.places):
            seen = [(t, c) for t, c in enumerate(path) if c is not None]
            if not seen:
                continue
            middle = float(np.median([c.score for _, c in seen]))
            counts = np.zeros(BIN_COUNT)
            for t, c in seen:
                if c.score >= middle:
                    inside = np.hypot(x - c.x, y - c.y) < LEARNED * c.radius
                    counts += histogram(self.bins[t][inside & (self.ratio(k, t) > 0.0)])
            if counts.sum() > LEAST_PIXELS:
                named = word_likelihood(self.words[k]) + NAME_WEIGHT
                self.colours[k] = np.logaddexp(log_likelihood(counts), named)

    def outlined(self) -> dict[int, list[Mask]]:
        """Masks of each body in all frames; sizes say which is which of look-alikes that nobody pointed at."""
        count, total = len(self.bins), len(self.bodies)
        by_frame = [
            outlines([self.ratio(k, t) for k in range(total)], [self.places[k][t] for k in range(total)])
            for t in range(count)
        ]
        masks = {k: [by_frame[t][k] for t in range(count)] for k in range(total)}
        for word in sorted(set(self.words)):
            alike = [k for k in range(total) if self.words[k] == word and not self.said[k]]
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
    """The body as an object, with a confidence that follows how clearly its pixels are its own."""
    clarity = [
        0.0 if place is None else float(1.0 / (1.0 + np.exp(-(place.score - HALF)))) for place in search.places[k]
    ]
    alone = [_is_alone(k, t, search) for t in range(len(masks))]
    return describe(masks, frames, clarity, alone, white)


def _is_alone(k: int, t: int, search: _Search) -> bool:
    own = search.places[k][t]
    if own is None:
        return False
    others = [series[t] for n, series in enumerate(search.places) if n != k]
    return all(np.hypot(o.x - own.x, o.y - own.y) > 1.2 * (o.radius + own.radius) for o in others if o is not None)
