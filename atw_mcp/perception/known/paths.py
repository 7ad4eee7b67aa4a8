"""The path through the frames' candidates that agrees best with how bodies move, out of sight too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.known.finding import Candidate
from atw_mcp.perception.known.settings import SETTINGS

Floats = NDArray[np.float64]
IMPOSSIBLE = -1e6


def best_path(
    frames: Sequence[Sequence[Candidate]],
    said: Mapping[int, tuple[float, float]],
    first: tuple[float, float] | None = None,
) -> tuple[float, list[Candidate | None]]:
    """Return the score of the best path through candidates of T frames, and its places; None where unseen.

    said: places x, y [px] that were pointed at, by row; first: one of the first row in which the body is seen.
    Candidates count by their score. Velocities change by random steps (a nearly constant velocity: Bar-Shalom, Li &
    Kirubarajan 2001, section 6.2), of which n frames out of sight add n (n + 1) (2 n + 1) / 6 to the variance of the
    place. Dynamic programming over pairs of successive places; a body that comes back continues the best path to
    where it went out of sight.
    """
    most = max((len(f) for f in frames), default=0)
    if most == 0:
        return 0.0, [None] * len(frames)
    return _Paths(frames, said, first, most).best()


class _Paths:
    """Scores (T, M + 1, M) of the best paths to a candidate at t (last) from one at t - 1, or from none (place M)."""

    def __init__(
        self,
        frames: Sequence[Sequence[Candidate]],
        said: Mapping[int, tuple[float, float]],
        first: tuple[float, float] | None,
        most: int,
    ) -> None:
        count = len(frames)
        self.frames, self.most = frames, most
        self.places, self.radius = np.zeros((count, most, 2)), np.ones((count, most))
        self.score, self.start = np.full((count, most), IMPOSSIBLE), np.zeros((count, most))
        self.start[1:] -= SETTINGS.appears
        unseen = np.zeros(count)
        for t, frame in enumerate(frames):
            for i, c in enumerate(frame):
                self.places[t, i], self.radius[t, i] = (c.x, c.y), c.radius
                self.score[t, i] = min(c.score, SETTINGS.clearest) - SETTINGS.unseen
            if t in said:
                self.score[t] += self._pointed(t, said[t])
                unseen[t] -= SETTINGS.pointed / 3.0
            if first is not None:
                self.start[t] += self._pointed(t, first)
        self.unseen = np.concatenate([[0.0], np.cumsum(unseen)])  # of all frames before t
        self.total = np.full((count, most + 1, most), IMPOSSIBLE)
        self.best_of = np.full((count, most), IMPOSSIBLE)  # over where the body was before
        self.velocity = np.zeros((count, most, 2))
        self.known = np.zeros((count, most), dtype=bool)  # whether velocity is
        self.back_pair = np.full((count, most, most), most)
        self.back_gap: dict[tuple[int, int], tuple[int, int]] = {}
        for t in range(count):
            self._reach(t)

    def _pointed(self, t: int, place: tuple[float, float]) -> Floats:
        off = np.hypot(*(self.places[t] - place).T)
        near: Floats = np.where(off < SETTINGS.pointed_reach * self.radius[t], SETTINGS.pointed, -SETTINGS.pointed)
        return near

    def _reach(self, t: int) -> None:
        """Find the best paths to each candidate of frame t."""
        most = self.most
        fresh = self.unseen[t] + self.start[t]
        self._return(t, fresh)
        self.total[t, most] = fresh + self.score[t]
        if t > 0:
            step = self.places[t][None] - self.places[t - 1][:, None]
            squared = (step**2).sum(axis=-1) / self.radius[t] ** 2
            turns = np.full((most + 1, most, most), 0.0)
            turns[most] = SETTINGS.jump * squared
            if t > 1:
                change = step[None] - (self.places[t - 1][None] - self.places[t - 2][:, None])[:, :, None]
                turns[:most] = SETTINGS.turn * (change**2).sum(axis=-1) / self.radius[t] ** 2
            arrive = self.total[t - 1][:, :, None] - np.minimum(turns, SETTINGS.struck)
            self.back_pair[t] = arrive.argmax(axis=0)
            self.total[t, :most] = arrive.max(axis=0) + self.score[t]
        chosen = self.total[t].argmax(axis=0)
        self.best_of[t] = self.total[t].max(axis=0)
        self.known[t] = chosen < most
        if t > 0:
            before = self.places[t - 1][np.minimum(chosen, most - 1)]
            self.velocity[t] = np.where(self.known[t][:, None], self.places[t] - before, 0.0)

    def _return(self, t: int, fresh: Floats) -> None:
        """Raise `fresh` (M,), the scores before frame t, to those of bodies that come back into sight there."""
        begin = max(t - 1 - SETTINGS.longest, 0)
        if t < 2:
            return
        rows = np.arange(begin, t - 1)
        frames = (t - rows)[:, None, None].astype(float)
        expected = self.places[rows] + self.velocity[rows] * frames
        squared = ((self.places[t] - expected[:, :, None]) ** 2).sum(axis=-1) / self.radius[t] ** 2
        moving = SETTINGS.drift * squared * 6.0 / (frames * (frames + 1.0) * (2.0 * frames + 1.0))
        unknown = SETTINGS.jump * squared / frames**2
        cost = np.minimum(np.where(self.known[rows][:, :, None], moving, unknown), SETTINGS.struck)
        away = (self.unseen[t] - self.unseen[rows + 1])[:, None, None] - 2.0 * SETTINGS.appears
        value = (self.best_of[rows][:, :, None] + away - cost).reshape(-1, self.most)
        for k, where in enumerate(value.argmax(axis=0)):
            row, place = divmod(int(where), self.most)
            self._continue(t, k, (begin + row, place), float(value[where, k]), fresh)
        if begin > 0:
            forgotten = self.best_of[:begin] - self.unseen[1 : begin + 1, None]
            row, place = divmod(int(forgotten.argmax()), self.most)
            for k in range(self.most):
                gain = float(forgotten.max()) + self.unseen[t] - 2.0 * SETTINGS.appears
                self._continue(t, k, (row, place), gain, fresh)

    def _continue(self, t: int, k: int, before: tuple[int, int], gain: float, fresh: Floats) -> None:
        if gain > fresh[k]:
            fresh[k] = gain
            self.back_gap[t, k] = before

    def best(self) -> tuple[float, list[Candidate | None]]:
        """Return the best path that ends in any frame, or no path at all."""
        count = len(self.frames)
        leaves = np.where(np.arange(count) < count - 1, SETTINGS.appears, 0.0)
        ends = self.total + (self.unseen[-1] - self.unseen[1:] - leaves)[:, None, None]
        if ends.max() <= self.unseen[-1]:
            return float(self.unseen[-1]), [None] * count
        t, rest = divmod(int(ends.argmax()), (self.most + 1) * self.most)
        i, j = divmod(rest, self.most)
        path: list[Candidate | None] = [None] * count
        while True:
            path[t] = self.frames[t][j]
            if i < self.most:
                t, i, j = t - 1, int(self.back_pair[t, i, j]), i
            elif (t, j) in self.back_gap:
                t, j = self.back_gap[t, j]
                i = int(self.total[t, :, j].argmax())
            else:
                return float(ends.max()), path
