"""Observe: bodies over a clip from seeds, by a few rounds of states, then colours."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.eye.assignment import reassign
from atw_mcp.perception.eye.bodies import Body, Solid
from atw_mcp.perception.eye.colours import learn_colours
from atw_mcp.perception.eye.follow import States, follow, refit
from atw_mcp.perception.eye.likelihood import Scene, gauss
from atw_mcp.perception.eye.outlines import learn_shapes, order_outlines
from atw_mcp.perception.eye.pixels import Array, Film, Floats, evenly_lit, features, filled, learn_background
from atw_mcp.perception.eye.seeds import Seed, seed_pose
from atw_mcp.perception.eye.settings import EyeSettings
from atw_mcp.perception.eye.silhouette import centre_error


@dataclass(frozen=True)
class Track:
    """A body over the clip.

    poses (T, 4): NaN where it is not seen; covariances (T, 4, 4) of what the contour shows of them; centres (T, 2)
    [px]; errors (T,): standard deviations of the centres [px], large where the pixels do not decide; confidence (T,):
    probability that the body is there, within half its radius; breaks: frames whose motion does not continue that
    before.
    """

    body: Body
    poses: Floats
    covariances: Floats
    centres: Floats
    errors: Floats
    confidence: Floats
    breaks: tuple[int, ...]


def observe(
    frames: NDArray[np.uint8],
    bodies: Sequence[Body],
    seeds: Sequence[Seed],
    settings: EyeSettings | None = None,
    *,
    hiding: Array | None = None,
    tick: Callable[[], None] | None = None,
) -> tuple[list[Track], Scene]:
    """Tracks of bodies over frames (T, H, W, 3) of BGR bytes, and the scene that was learned. Raises ValueError.

    hiding (H, W): depth of what never moves and may hide bodies; tick: called once a frame, and may raise to stop.
    """
    settings = settings or EyeSettings()
    film = Film(evenly_lit(frames), settings)
    scene = Scene(film, list(bodies), settings, learn_background(film, film.nothing()), hiding)
    scene.tick = tick or scene.tick
    held = _held(scene, seeds)
    for i, own in enumerate(held):
        for k, pose in own.items():
            scene.poses[i, k] = pose
    scene.background = learn_background(film, _at_seeds(scene, held))
    for i, own in enumerate(held):
        if own:
            scene.learn_body(i, sorted(own), rough=True)
    scene.background = learn_background(film, _at_seeds(scene, held) | _alike(scene, held))
    scene.poses[:] = np.nan
    states = follow(scene, held)
    for _ in range(settings.rounds):
        learn_shapes(scene, states, held)
        _learn(scene, held)
        before = scene.poses.copy()
        states = refit(scene, held)
        states = reassign(scene, states, held)
        if _settled(scene, before):
            break
    return [_track(scene, i, found, held[i]) for i, found in enumerate(states)], scene


def _settled(scene: Scene, before: Floats) -> bool:
    """Whether each body is seen in the frames in which it was, and nine of ten poses moved by next to nothing."""
    for body, old, new in zip(scene.bodies, before, scene.poses, strict=True):
        seen = np.isfinite(new[:, 0])
        if (seen != np.isfinite(old[:, 0])).any():
            return False
        moved = [np.linalg.norm(body.centre(p) - body.centre(q)) for p, q in zip(old[seen], new[seen], strict=True)]
        if seen.any() and np.percentile(moved, 90) > scene.settings.edge_error / 3:
            return False
    return True


def _held(scene: Scene, seeds: Sequence[Seed]) -> list[dict[int, Floats]]:
    """Poses (4,) of each body at the frames of its seeds."""
    names = [b.name for b in scene.bodies]
    held: list[dict[int, Floats]] = [{} for _ in names]
    for seed in seeds:
        if seed.object not in names:
            raise ValueError(f"a seed names {seed.object!r}, but the bodies are {', '.join(names)}")
        i = names.index(seed.object)
        if not 0 <= seed.frame < scene.film.count:
            raise ValueError(f"the seed of {seed.object} needs a frame of 0..{scene.film.count - 1}")
        held[i][seed.frame] = seed_pose(scene.bodies[i], seed)
    return held


def _windows(
    scene: Scene, held: list[dict[int, Floats]]
) -> Iterator[tuple[int, int, tuple[slice, slice], NDArray[np.bool_]]]:
    """Body, frame, rows and columns of a window, and the pixels (h, w) of it that the body has there, of each seed."""
    for i, own in enumerate(held):
        for k, pose in own.items():
            corner, size = scene.window(i, pose, 3.0)
            if min(size) > 1:
                part = slice(corner[1], corner[1] + size[1]), slice(corner[0], corner[0] + size[0])
                yield i, k, part, _mask(scene, i, pose, corner, size)


def _at_seeds(scene: Scene, held: list[dict[int, Floats]]) -> NDArray[np.bool_]:
    """Pixels (S, H, W) that look in a frame as they do where a seed shows a body: the body may still stand there.

    A pixel does whose look is likelier with that look's noise than as anything; in an outline, which may hold pixels of
    the background, within three deviations. Where most of a body's pixels do it stands there, and its blurred rim too,
    else the rim is taken for background.
    """
    film, chosen = scene.film, scene.film.chosen()
    covered = scene.covered(2.0)
    for i, k, (rows, columns), mask in _windows(scene, held):
        parts = film.frames[[k, *chosen], rows, columns].astype(np.float32)
        own_look, *looks = (features(cv2.blur(part, (3, 3)), scene.settings) for part in parts)
        spread = np.maximum(scene.settings.least_spread, np.sqrt(2) * scene.background.noise).astype(np.float32)
        apart = np.stack(looks) - own_look
        if isinstance(scene.bodies[i], Solid):
            alike = gauss(apart, spread).sum(axis=-1) > np.log(scene.settings.unknown)
        else:
            alike = (np.abs(apart) < 3.0 * spread).all(axis=-1)
        inside = filled(scene.bodies[i].polygon(held[i][k]), (columns.start, rows.start), alike.shape[:0:-1])
        standing = alike[:, inside].mean(axis=1) > 0.5
        covered[:, rows, columns] |= (alike | standing[:, None, None]) & mask
    return covered


def _alike(scene: Scene, held: list[dict[int, Floats]]) -> NDArray[np.bool_]:
    """Pixels (S, H, W) that change over the clip, or lie where a seed shows a body, and have a body's colours, if these
    are rare in the film.

    A body that stands somewhere for most of the clip would else be the median there. Others that always do are left.
    """
    s, film = scene.settings, scene.film
    frames = film.sample
    covered = np.zeros(frames.shape[:3], bool)
    seeded = np.zeros(frames.shape[1:3], bool)
    for *_, part, mask in _windows(scene, held):
        seeded[part] |= mask
    changes = (frames.max(axis=0) - frames.min(axis=0)).max(axis=-1) > 2 * s.dark_level
    rows, columns = np.nonzero(changes | seeded)
    usual = features(frames[:: max(1, len(frames) // 4)].reshape(-1, 3)[::97].astype(np.float32), s)
    film_colours = learn_colours(usual, np.zeros((len(usual), 2)), s)
    if film_colours is None or not len(rows):
        return covered
    levels = frames[:, rows, columns].astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    table = np.zeros(1 << 24, bool)  # many pixels have the same levels
    table[levels] = True
    shown = np.flatnonzero(table)
    values = features(np.stack([shown >> 16, shown >> 8 & 255, shown & 255], axis=-1).astype(np.float32), s)
    rare = np.zeros(len(shown), bool)
    for colours in scene.colours:
        if colours is not None:
            rare |= colours.log_density(values) - film_colours.log_density(values) > s.rare
    table[shown] = rare
    alike = table[levels]
    alike[:, alike.all(axis=0) & ~seeded[rows, columns]] = False
    covered[:, rows, columns] = alike
    return covered


def _mask(scene: Scene, body: int, pose: Floats, corner: tuple[int, int], size: tuple[int, int]) -> NDArray[np.bool_]:
    polygon, middle = scene.bodies[body].polygon(pose), scene.bodies[body].centre(pose)
    return filled(middle + (polygon - middle) * (1 + 2.0 / max(scene.bodies[body].radius(pose), 1.0)), corner, size)


def _learn(scene: Scene, held: list[dict[int, Floats]]) -> None:
    """Learn background, colours and shade from all poses."""
    scene.background = learn_background(scene.film, scene.covered(3.0) | _at_seeds(scene, held))
    count = scene.film.count
    frames = sorted(set(np.linspace(0, count - 1, min(count, scene.settings.background_frames)).astype(int).tolist()))
    for i in range(len(scene.bodies)):
        own = [k for k in range(count) if np.isfinite(scene.poses[i, k, 0])]
        scene.learn_body(i, own[:: max(1, len(own) // 24)])
    scene.learn_shades(frames)
    order_outlines(scene)


def _streak(scene: Scene, body: int, frame: int, states: States) -> float:
    """Error [px] of the centre along a streak that a fast body leaves while the shutter is open: half of by how much it
    is longer on one side of the silhouette, along its way from the frame before or to that after, whichever is more.

    Its ends, a frame's displacement away at the most, are the last where the mean log odds over a radius say that
    pixels show what the body's middle does rather than the background in its usual shade: a smeared dark side looks
    like another shadow, and between it and the bright one there is what looks like the background.
    """
    s, shape, pose = scene.settings, scene.bodies[body], states[frame].fit.pose
    centre, radius = shape.centre(pose), shape.radius(pose)
    worst = 0.0
    for moved in (shape.centre(states[m].fit.pose) - centre for m in (frame - 1, frame + 1) if m in states):
        length = float(np.linalg.norm(moved))
        if length < radius:
            continue
        along = moved / length
        across = np.array([-along[1], along[0]]) * radius
        reach = radius + np.arange(0.5, length, 1.0)
        middle = np.repeat([centre + share * across for share in (-0.4, 0.0, 0.4)], len(reach), axis=0)
        ends = []
        for sign in (1.0, -1.0):
            points = middle + sign * np.tile(reach, 3)[:, None] * along
            values, free = scene.film.at(frame, points), scene.film.inside(points)
            behind = scene.log_background(frame, points, values, (body, pose), freely=False)
            odds = np.clip(scene.log_body(body, values, middle, pose) - behind, -s.decided, s.decided)
            shown = np.where(free, odds, 0.0).reshape(3, -1).mean(axis=0)
            shown = np.convolve(shown, np.ones(round(radius)) / round(radius), "same")
            ends.append(float(np.flatnonzero(np.append(s.present, shown) >= s.present)[-1]))
        worst = max(worst, abs(ends[0] - ends[1]) / 2)
    return worst


def _track(scene: Scene, body: int, states: States, seeds: dict[int, Floats]) -> Track:
    s, shape, count = scene.settings, scene.bodies[body], scene.film.count
    poses, centres = np.full((count, 4), np.nan), np.full((count, 2), np.nan)
    covariances = np.full((count, 4, 4), np.nan)
    errors, confidence = np.full(count, np.inf), np.zeros(count)
    usual = float(np.median([state.fit.decided for state in states.values()])) if states else 0.0
    for k, state in states.items():
        poses[k], centres[k] = state.fit.pose, shape.centre(state.fit.pose)
        covariances[k] = state.fit.covariance
        streak = 0.0 if k in seeds else _streak(scene, body, k, states)
        errors[k] = np.hypot(centre_error(scene, body, state.fit), streak)
        size = shape.radius(state.fit.pose)
        seen = (1 - np.exp(-max(state.contrast, 0.0) / s.present)) * min(
            1.0, state.fit.decided / max(s.weak * usual, 1e-9)
        )
        confidence[k] = seen * np.exp(-((2 * errors[k] / size) ** 2)) * state.posterior
    breaks, tied = _continuity(scene, shape, centres, poses, seeds)
    confidence[~tied] *= 0.5
    return Track(shape, poses, covariances, centres, errors, confidence, breaks)


def _continuity(
    scene: Scene, shape: Body, centres: Floats, poses: Floats, seeds: dict[int, Floats]
) -> tuple[tuple[int, ...], NDArray[np.bool_]]:
    """Frames at which a body jumps, and whether each frame (T,) is tied to a seed by motion without jumps or gaps.

    A jump is longer by more than `jump` radii than the displacements before and after it, and those of the fastest
    tenth of the clip, let expect, in any direction: bodies rebound.
    """
    s, seen = scene.settings, np.flatnonzero(np.isfinite(centres[:, 0]))
    moved = np.diff(centres[seen], axis=0) / np.maximum(np.diff(seen), 1)[:, None]
    lengths = np.linalg.norm(moved, axis=1)
    usual = float(np.percentile(lengths, 90)) if len(lengths) > s.gap else 0.0
    breaks, piece = [], np.zeros(len(seen), int)
    for m, length in enumerate(lengths):
        around = max((usual, *lengths[max(m - 1, 0) : m], *lengths[m + 1 : m + 2]))
        jumped = length - s.faster * around > s.jump * shape.radius(poses[seen[m + 1]])
        if jumped:
            breaks.append(int(seen[m + 1]))
        piece[m + 1] = piece[m] + (jumped or seen[m + 1] - seen[m] > s.gap)
    tied = np.zeros(len(centres), bool)
    tied[seen] = np.isin(piece, [p for p, k in zip(piece, seen, strict=True) if k in seeds])
    return tuple(breaks), tied
