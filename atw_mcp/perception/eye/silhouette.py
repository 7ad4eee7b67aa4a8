"""Silhouette: the pose of greatest likelihood along the normals of a contour, and its error from the curvature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from atw_mcp.perception.eye.bodies import Contour, Outline
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.pixels import Array, Floats, Mask, features, sampled

GAMMA = 2.2  # exponent from levels to light, which is what mixes in a pixel: sRGB and video


@dataclass(frozen=True)
class Fit:
    """A pose (4,) with its covariance (4, 4).

    decided: share of the contour's normals whose edge the pixels show. misfit: robust distance [px] of the edges from
    the contour, of those that should be seen and are not the longest that is searched for.
    """

    pose: Floats
    covariance: Floats
    decided: float
    misfit: float


def pure_edges(
    scene: Scene, body: int, frame: int, pose: Floats, contour: Contour, reach: float
) -> tuple[Floats, Floats, Mask]:
    """Signed distance (N,) [px] of the edge from each normal of a contour, its precision (N,) [1/px^2], and whether
    nothing hides it.

    The log likelihood of an edge at d is the sum of log odds up to d; its mean and variance are taken over a normal
    prior of `reach` and that prior is then removed, so that a normal on which nothing is decided weighs nothing.
    """
    s = scene.settings
    pitch = max(s.step, reach / 8)
    offsets = np.arange(-reach, reach + 0.5 * pitch, pitch)
    points = contour.points[:, None] + contour.normals[:, None] * offsets[:, None]
    odds, free = scene.log_odds(body, frame, pose, points.reshape(-1, 2))
    shape = points.shape[:2]
    odds, free = np.where(free, odds, 0.0).reshape(shape), free.reshape(shape)
    middle = len(offsets) // 2
    shown = np.asarray(free[:, max(middle - 2, 0) : middle + 3].all(axis=1))
    logs = np.concatenate([np.zeros((shape[0], 1)), np.cumsum(odds * pitch, axis=1)], axis=1)
    places = np.append(offsets - 0.5 * pitch, offsets[-1] + 0.5 * pitch)
    width = 0.7 * reach
    logs -= 0.5 * (places / width) ** 2
    weight = np.exp(logs - logs.max(axis=1, keepdims=True))
    weight /= weight.sum(axis=1, keepdims=True)
    mean = weight @ places
    variance = weight @ places**2 - mean**2 + s.edge_error**2
    flat = np.exp(-0.5 * (places / width) ** 2)
    prior = float((flat * places**2).sum() / flat.sum()) + s.edge_error**2
    precision = np.maximum(1 / variance - 1 / prior, 0.0)
    distance = np.where(precision > 0, mean / variance / np.maximum(precision, 1e-9), 0.0)
    near_end = np.abs(places) > reach - 0.5 * min(2.0, reach)
    precision = np.where(shown, precision * np.maximum(1 - 2 * weight[:, near_end].sum(axis=1), 0.0), 0.0)
    return np.clip(distance, -reach, reach), precision, shown


def _mixed_edges(scene: Scene, frame: int, contour: Contour, gamma: float) -> tuple[Floats, Floats]:
    """Signed distance (N,) [px] of the edge from each normal, and its precision (N,) [1/px^2], from mixed pixels.

    Within a pixel or two of an edge levels are mixtures of those inside and outside, which the log odds of pure colours
    take for the side whose colours vary more. The share of the inside, summed along the normal, gives the edge.
    """
    s = scene.settings
    offsets = np.arange(-2 * s.mixed_near, 2 * s.mixed_near + 0.5 * s.step, s.step)
    points = (contour.points[:, None] + contour.normals[:, None] * offsets[:, None]).reshape(-1, 2)
    shape = (len(contour.points), len(offsets))
    seen = sampled(scene.film.frames[frame], points)
    levels = ((seen / 255) ** np.float32(gamma)).reshape(*shape, 3)  # light, which mixes
    lit = features(seen, s)[:, 0] - scene.background.at(points)[0][:, 0]
    pure = np.abs(offsets) > s.mixed_near
    core = ~pure
    inside, outside = levels[:, pure & (offsets < 0)], levels[:, pure & (offsets > 0)]
    low, high = outside.mean(axis=1, keepdims=True), inside.mean(axis=1, keepdims=True)
    beyond = offsets[pure & (offsets > 0)]
    slope = _slope(beyond, outside)
    low = low + slope[:, None] * (np.maximum(offsets, 0.0) - beyond.mean())[None, :, None]
    contrast = ((high - low) ** 2).sum(axis=-1)
    share = np.clip(((levels - low) * (high - low)).sum(axis=-1) / np.maximum(contrast, 1e-6), 0.0, 1.0)
    distance = (share[:, core] - 0.5).sum(axis=1) * s.step
    spread = (
        inside.var(axis=1).sum(axis=-1)
        + (outside - low[:, pure & (offsets > 0)]).var(axis=1).sum(axis=-1)
        + 3 * s.light_noise**2
    )
    variance = s.edge_error**2 + s.mixed_near**2 * spread / np.maximum(contrast[:, core].mean(axis=1), 1e-6)
    shaded = np.abs(lit.reshape(shape)[:, pure & (offsets > 0)].mean(axis=1))
    variance += (s.shaded_edge * np.minimum(shaded, 1.0)) ** 2
    return distance, 1 / variance


def _slope(places: Floats, values: Array | Floats) -> Array:
    """Slopes (N, 3) of values (N, P, 3) over places (P,), shrunk by their own noise: how shade deepens to an edge."""
    apart = places - places.mean()
    total = float((apart**2).sum())
    slope = (values * apart[:, None]).sum(axis=1) / total
    left = values - values.mean(axis=1, keepdims=True) - slope[:, None] * apart[:, None]
    noise = (left**2).sum(axis=1) / max(len(places) - 2, 1) / total
    return np.asarray(slope * np.maximum(1 - 4 * noise / np.maximum(slope**2, 1e-12), 0.0))


def fit_pose(scene: Scene, body: int, frame: int, pose: Floats, prior: Floats | None = None, coarse: int = 0) -> Fit:
    """Refine a pose by Gauss-Newton steps over ever shorter normals.

    prior (4,): standard deviations about the initial pose; by default those of an unknown place. coarse: the first of
    the settings' reaches.
    """
    s, shape = scene.settings, scene.bodies[body]
    initial, pose = pose, pose.copy()
    free = shape.free
    drawn = isinstance(shape, Outline)  # it may be off to either side, and is learned from mixed levels: edges_beyond
    mixing, outward = (1.0, 1.0) if drawn else (GAMMA, s.outward)
    sigma = 3.0 * shape.unit if prior is None else prior
    hold = np.diag(1 / np.maximum(np.append(sigma[free], shape.nuisance(s.border, s.rims)), 1e-9) ** 2)
    for reach in s.reaches[coarse:]:
        reach_now = min(reach or 2 * s.mixed_near, s.reach_radii * shape.radius(pose) + 1.5)
        contour = shape.contour(pose, s.normals)
        distance, precision, open_ = pure_edges(scene, body, frame, pose, contour, reach_now)
        if not reach:
            finer, weight = _mixed_edges(scene, frame, contour, mixing)
            near = (np.abs(distance) < s.mixed_near) & (precision > 0)
            rough = np.where(precision > 0, 1 / (1 / np.maximum(precision, 1e-9) + s.pure_error**2), 0.0)
            weight = np.where(near, weight, 0.0)
            precision = rough + weight
            distance = (rough * distance + weight * finer) / np.maximum(precision, 1e-9)
        rates = np.c_[contour.rates[:, free], contour.nuisances]
        away = hold @ np.append((initial - pose)[free], [0.0, 0.0])
        scale, weight = 1.0, precision
        for _ in range(3):
            normal = rates.T @ (rates * weight[:, None]) + hold
            step = np.linalg.solve(normal, rates.T @ (weight * distance) + away)
            left = distance - rates @ step
            shown = precision > 0
            scale = max(1.48 * float(np.median(np.abs(left[shown]))) if shown.any() else 0.0, s.edge_error)
            limit = s.robust * scale * np.where(left > 0, outward, 1.0)
            weight = precision / (1 + (left / limit) ** 2) ** 2
        limit = 0.8 * shape.unit[free]
        moved = pose.copy()
        moved[free] += np.clip(step[:-2], -limit, limit)
        if not np.isfinite(shape.polygon(moved)).all():  # beyond the horizon of its plane, or behind the camera
            break
        pose = moved
    strong = precision > 0.25 / s.edge_error**2
    inflation = max(s.correlated / contour.spacing, 1.0) * max(scale / (2 * s.edge_error), 1.0) ** 2
    covariance = np.zeros((4, 4))
    index = np.flatnonzero(free)
    information = rates.T @ (rates * weight[:, None]) / inflation + hold
    covariance[np.ix_(index, index)] = np.linalg.inv(information)[:-2, :-2]
    apart = np.where(precision > 0, left, reach_now)[open_]
    misfit = float(np.sqrt(np.log1p(apart**2).mean())) if open_.any() else np.inf
    return Fit(pose, covariance, float(strong.mean()), misfit)


def edges_beyond(scene: Scene, body: int, frame: int, pose: Floats) -> Floats:
    """Signed distance (N,) [px] of each normal's edge from the contour of a pose, NaN where it is not shown.

    Levels are mixed here, not light: what blurs an edge most is scaling and coding, and they do.
    """
    s = scene.settings
    contour = scene.bodies[body].contour(pose, s.normals)
    rough, precision, _ = pure_edges(scene, body, frame, pose, contour, 2 * s.mixed_near)
    finer, _ = _mixed_edges(scene, frame, contour, 1.0)
    return np.where((np.abs(rough) < s.mixed_near) & (precision > 0.25 / s.edge_error**2), finer, np.nan)


def centre_error(scene: Scene, body: int, fit: Fit) -> float:
    """Standard deviation [px] of a fitted centre in the image, with what no curvature shows."""
    shape = scene.bodies[body]
    rate = np.stack([(shape.centre(fit.pose + 1e-4 * e) - shape.centre(fit.pose)) / 1e-4 for e in np.eye(4)], axis=1)
    spread = float(np.sqrt(max(np.trace(rate @ fit.covariance @ rate.T) / 2, 0.0)))
    return float(np.hypot(spread, scene.settings.systematic * shape.radius(fit.pose)))
