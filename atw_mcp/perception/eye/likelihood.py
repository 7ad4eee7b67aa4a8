"""One likelihood: log odds that a pixel shows a body and not what is behind it, all bodies by depth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.eye.bodies import Body
from atw_mcp.perception.eye.colours import Colours, learn_colours
from atw_mcp.perception.eye.pixels import (
    Array,
    Background,
    Bytes,
    Film,
    Floats,
    Mask,
    filled,
    learn_background,
    sampled,
)
from atw_mcp.perception.eye.settings import EyeSettings
from atw_mcp.perception.eye.shade import Shade, learn_shade, shade_places


@dataclass
class Scene:
    """A film, its bodies, their poses (N, T, 4), NaN where a body is not seen, and what has been learned of pixels.

    usual (N,): contrast of each body's pixels where it is seen [nats]; hiding (H, W): depth of what never moves and
    may hide bodies, infinite where nothing does; tick: called once a frame.
    """

    film: Film
    bodies: list[Body]
    settings: EyeSettings
    background: Background
    hiding: Array | None = None
    tick: Callable[[], None] = lambda: None
    poses: Floats = field(init=False)
    colours: list[Colours | None] = field(init=False)
    shades: list[Shade | None] = field(init=False)
    usual: Floats = field(init=False)

    def __post_init__(self) -> None:
        count = len(self.bodies)
        self.poses = np.full((count, self.film.count, 4), np.nan)
        self.usual = np.zeros(count)
        self.colours, self.shades = [None] * count, [None] * count

    # --- likelihoods --------------------------------------------------------------------------------

    def log_background(
        self,
        frame: int,
        points: Floats,
        values: Array,
        own: tuple[int, Floats] | None = None,
        *,
        freely: bool = True,
    ) -> Array:
        """Log density (M,) of features (M, 3) at points (M, 2) as background, shaded as predicted or, lit too, freely.

        own: a body and the pose it is tried at, in place of the one that it has.
        """
        s = self.settings
        expected, spread = self.background.at(points)
        apart = values - expected
        dark = apart[:, 0]
        shade = self._shade(frame, points, own)
        chroma = spread[:, 1:] + s.shade_chroma * np.abs(dark)[:, None]
        log_chroma = gauss(apart[:, 1], chroma[:, 0]) + gauss(apart[:, 2], chroma[:, 1])
        width = np.sqrt(spread[:, 0] ** 2 + (s.shade_slack * shade[:, 0]) ** 2 + shade[:, 1] ** 2 + 0.02**2)
        predicted = gauss(dark - shade[:, 0], width) + np.log(1 - s.free_shade)
        possible = (dark < s.brightest_light) & (dark > -s.deepest_shade)
        free = np.where(possible, np.log(s.free_shade / (s.brightest_light + s.deepest_shade)), np.log(s.unknown))
        light = np.logaddexp(predicted, free) if freely else predicted
        return np.asarray(np.logaddexp(log_chroma + light, np.log(s.unknown)), dtype=np.float32)

    def _shade(self, frame: int, points: Floats, own: tuple[int, Floats] | None) -> Array:
        """Log factor of the bodies' shade and its standard deviation (M, 2) at points: of the one that darkens most."""
        found = np.zeros((len(points), 2), np.float32)
        low, high = points.min(axis=0), points.max(axis=0)
        for i, shade in enumerate(self.shades):
            pose = own[1] if own is not None and own[0] == i else self.poses[i, frame]
            if shade is None or not np.isfinite(pose[0]):
                continue
            centre, radius = self.bodies[i].centre(pose), self.bodies[i].radius(pose)
            if (centre + shade.reach * radius < low).any() or (centre - shade.reach * radius > high).any():
                continue
            value = shade.at((points - centre) / radius)
            stronger = np.abs(value[:, 0]) > np.abs(found[:, 0])
            found[stronger] = value[stronger]
        return found

    def unlike_background(self, frame: int) -> Array:
        """Log odds (H, W) that pixels of a frame are nothing that is known and not background, lit or shaded."""
        u, v = np.meshgrid(np.arange(self.film.width), np.arange(self.film.height))
        points = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
        behind = self.log_background(frame, points, self.film.at(frame, points))
        odds = np.log(self.settings.unknown) + np.log(2.0) - behind
        return np.asarray(odds.reshape(u.shape), dtype=np.float32)

    def log_body(self, body: int, values: Array, points: Floats, pose: Floats | None) -> Array:
        """Log density (M,) of features (M, 3) at points (M, 2) as a body's own, by place on it, or anywhere."""
        colours = self.colours[body]
        if colours is None:
            return np.full(len(values), np.log(self.settings.unknown), np.float32)
        local = None if pose is None else self.bodies[body].local(pose, points)
        logs = colours.log_density(values, local)
        return np.asarray(np.logaddexp(logs, np.log(self.settings.unknown)))

    def log_odds(
        self, body: int, frame: int, pose: Floats, points: Floats, *, anywhere: bool = False, besides: bool = False
    ) -> tuple[Array, Mask]:
        """Log odds (M,) that points (M, 2) show a body at a pose and not what is behind it; whether they can show it.

        A point cannot where it lies outside the picture or behind a nearer body. anywhere: the pose gives the depth
        alone; colours are those of the whole body, and its own shade is not expected anywhere. besides: the body is at
        the pose, with its shade, and points that it covers cannot show it elsewhere.
        """
        values = self.film.at(frame, points)
        at = np.full(4, np.nan) if anywhere and not besides else pose
        behind = self.log_background(frame, points, values, (body, at))
        free = self.film.inside(points)
        if besides:
            free &= ~self._covers(body, pose, points, 1.0)
        depth = self.bodies[body].depth(pose)
        if self.hiding is not None:
            free &= sampled(self.hiding, points.round())[:, 0] > depth
        for other_depth, other in self._others(body, frame, points):
            there = self.poses[other, frame]
            inside = self._covers(other, there, points, 0.0 if other_depth > depth else 1.0)
            if other_depth < depth:
                free &= ~inside
            elif inside.any():
                behind[inside] = self.log_body(other, values[inside], points[inside], there)
        odds = self.log_body(body, values, points, None if anywhere else pose) - behind
        limit = self.settings.decided
        return np.clip(odds, -limit, limit), free

    def _others(self, body: int, frame: int, points: Floats) -> list[tuple[float, int]]:
        """Depths and numbers of other bodies that may cover points, the farthest first."""
        low, high = points.min(axis=0), points.max(axis=0)
        found = []
        for j, other in enumerate(self.bodies):
            pose = self.poses[j, frame]
            if j == body or not np.isfinite(pose[0]):
                continue
            reach = 2.0 * other.radius(pose) + 4.0
            middle = other.centre(pose)
            if (middle + reach > low).all() and (middle - reach < high).all():
                found.append((other.depth(pose), j))
        return sorted(found, reverse=True)

    def _covers(self, body: int, pose: Floats, points: Floats, margin: float) -> Mask:
        """Whether a body's silhouette, grown by a margin [px], covers points (M, 2)."""
        polygon = self.bodies[body].polygon(pose)
        if margin:
            middle = self.bodies[body].centre(pose)
            polygon = middle + (polygon - middle) * (1 + margin / max(self.bodies[body].radius(pose), 1.0))
        low = np.floor(polygon.min(axis=0)).astype(int) - 1
        size = np.ceil(polygon.max(axis=0)).astype(int) + 2 - low
        scale = 2
        mask = filled((polygon - low + 0.25) * scale, (0, 0), (int(size[0]) * scale, int(size[1]) * scale))
        index = np.round((points - low + 0.25) * scale).astype(int)
        inside = (index >= 0).all(axis=1) & (index[:, 0] < mask.shape[1]) & (index[:, 1] < mask.shape[0])
        index[~inside] = 0
        return np.asarray(inside & mask[index[:, 1], index[:, 0]])

    def looks(self, body: int, frame: int, pose: Floats) -> tuple[float, float, float]:
        """Mean log odds of a body's visible pixels and of a ring around them [nats], and the visible share of its area.

        A ring that looks like the body says that the silhouette is not where the colours end.
        """
        polygon, middle = self.bodies[body].polygon(pose), self.bodies[body].centre(pose)
        grow = 1 + 2 / max(self.bodies[body].radius(pose), 1.0)
        ring = middle + (polygon - middle) * (0.3 + grow)
        low, high = ring.min(axis=0), ring.max(axis=0)
        pitch = max(0.5, float((high - low).max()) / 26)
        u, v = (np.arange(a, b + pitch, pitch) for a, b in zip(low, high, strict=True))
        kinds = [
            filled((p - low) / pitch, (0, 0), (len(u), len(v)))
            for p in (polygon, middle + (polygon - middle) * grow, ring)
        ]
        inner, outer = kinds[0], kinds[2] & ~kinds[1]
        grid = np.stack(np.meshgrid(u, v), axis=-1)
        points = np.concatenate([grid[inner], grid[outer]])
        count = int(inner.sum())
        if not count:
            return 0.0, 0.0, 0.0
        odds, free = self.log_odds(body, frame, pose, points)
        means = [float(odds[p][free[p]].mean()) if free[p].any() else 0.0 for p in (slice(count), slice(count, None))]
        return means[0], means[1], float(free[:count].mean())

    # --- learning -----------------------------------------------------------------------------------

    def window(self, body: int, pose: Floats, margin: float) -> tuple[tuple[int, int], tuple[int, int]]:
        """First pixel and size (w, h) of a body's part of the picture; the size may be zero."""
        polygon = self.bodies[body].polygon(pose)
        last = [self.film.width, self.film.height]
        low = np.clip(np.floor(polygon.min(axis=0) - margin).astype(int), 0, last)
        high = np.clip(np.ceil(polygon.max(axis=0) + margin).astype(int) + 1, 0, last)
        size = np.maximum(high - low, 0)
        return (int(low[0]), int(low[1])), (int(size[0]), int(size[1]))

    def own_pixels(self, body: int, frame: int, pose: Floats, rough: bool = False) -> tuple[Array, Floats]:
        """Features (M, 3) and places on the body (M, 2) of pixels well inside its silhouette and not covered.

        rough: the silhouette may hold background; so does that of a body too small to have pixels well inside. Pixels
        that look like it are left out, but where most do and the body is large.
        """
        corner, size = self.window(body, pose, 1.0)
        if min(size) < 2:
            return np.zeros((0, 3), np.float32), np.zeros((0, 2))
        mask = filled(self.bodies[body].polygon(pose), corner, size)
        inner = _shrunk(mask, self.settings.edge_band)
        small = inner.sum() < self.settings.least_pixels
        mask = mask if small else inner
        v, u = np.nonzero(mask)
        points = np.stack([u + corner[0], v + corner[1]], axis=1).astype(float)
        keep = np.ones(len(points), bool)
        depth = self.bodies[body].depth(pose)
        for other_depth, other in self._others(body, frame, points) if len(points) else []:
            if other_depth < depth:
                keep &= ~self._covers(other, self.poses[other, frame], points, self.settings.edge_band)
        points = points[keep]
        if len(points) and self.hiding is not None:
            points = points[sampled(self.hiding, points)[:, 0] > depth]
        if not len(points):
            return np.zeros((0, 3), np.float32), np.zeros((0, 2))
        values = self.film.at(frame, points)
        if rough or small:
            expected, spread = self.background.at(points)
            other = (np.abs(values - expected) > 4 * spread).any(axis=1)
            if small or other.mean() > 0.6:
                points, values = points[other], values[other]
        return values, self.bodies[body].local(pose, points)

    def learn_body(self, body: int, frames: list[int], *, rough: bool = False) -> None:
        """Learn a body's colours from the frames where it is seen.

        rough: poses are hints, whose silhouettes may hold background.
        """
        seen = [
            self.own_pixels(body, k, self.poses[body, k], rough) for k in frames if np.isfinite(self.poses[body, k, 0])
        ]
        if seen:
            values, local = np.concatenate([s[0] for s in seen]), np.concatenate([s[1] for s in seen])
            self.colours[body] = learn_colours(values, local, self.settings) or self.colours[body]

    def learn_shades(self, frames: list[int]) -> None:
        """Learn each body's shade from the background around it."""
        places, cells = shade_places(self.settings), self.settings.shade_cells
        for i, body in enumerate(self.bodies):
            seen = []
            for k in frames:
                pose = self.poses[i, k]
                if not np.isfinite(pose[0]):
                    continue
                points = body.centre(pose) + places * body.radius(pose)
                dark = self.film.at(k, points)[:, 0] - self.background.at(points)[0][:, 0]
                valid = self.film.inside(points)
                for j in range(len(self.bodies)):
                    if np.isfinite(self.poses[j, k, 0]):
                        valid &= ~self._covers(j, self.poses[j, k], points, self.settings.edge_band)
                seen.append((dark.reshape(cells, cells), valid.reshape(cells, cells)))
            self.shades[i] = learn_shade(seen, self.settings)

    def covered(self, margin: float) -> NDArray[np.bool_]:
        """Whether pixels (S, H, W) of the frames of the background are within a margin [px] of a body."""
        chosen = self.film.chosen()
        found = np.zeros((len(chosen), self.film.height, self.film.width), bool)
        for row, k in enumerate(chosen):
            for i, body in enumerate(self.bodies):
                if np.isfinite(self.poses[i, k, 0]):
                    corner, size = self.window(i, self.poses[i, k], margin + 1)
                    if min(size) > 0:
                        mask = filled(body.polygon(self.poses[i, k]), corner, size)
                        grown = cv2.dilate(mask.astype(np.uint8), _disc(margin)) > 0
                        found[row, corner[1] : corner[1] + size[1], corner[0] : corner[0] + size[0]] |= grown
        return found


def background_scene(frames: Bytes, covered: Callable[[int], Mask], settings: EyeSettings) -> Scene:
    """Scene without bodies. covered: returns the pixels (H, W) of a frame that are not the background's."""
    film = Film(frames, settings)
    return Scene(film, [], settings, learn_background(film, np.stack([covered(int(k)) for k in film.chosen()])))


def gauss(apart: Array, spread: Array) -> Array:
    """Log density of a normal distribution at a distance from its mean, of a standard deviation."""
    return np.asarray(-0.5 * (apart / spread) ** 2 - np.log(spread) - np.float32(0.919))


def _disc(radius: float) -> NDArray[np.uint8]:
    size = 2 * int(np.ceil(radius)) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), dtype=np.uint8)


def _shrunk(mask: Mask, band: float) -> Mask:
    """Pixels of a mask farther than a band [px] from its edge."""
    padded = cv2.copyMakeBorder(mask.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    return np.asarray(cv2.distanceTransform(padded, cv2.DIST_L2, 3)[1:-1, 1:-1] > band)
