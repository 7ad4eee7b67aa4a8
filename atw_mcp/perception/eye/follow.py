"""Follow: a body over the clip from its seeds, by prediction from the motion so far and the greatest likelihood."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from atw_mcp.perception.eye.bodies import Outline
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.pixels import Floats
from atw_mcp.perception.eye.states import (
    State,
    candidates,
    competitors,
    in_view,
    motion_prior,
    peaks,
    present,
    score,
    state_at,
    vacant,
)

States = dict[int, State]


@dataclass
class _Walker:
    """A body on its way from a seed, forward (step 1) or backward (-1), until frame `end`, which is left out."""

    body: int
    seed: int
    step: int
    end: int
    before: Floats
    velocity: Floats = field(default_factory=lambda: np.zeros(4))
    missed: int = 0
    known: bool = False

    def predicted(self) -> Floats:
        return self.before + self.velocity * (self.missed + 1)

    def advance(self, scene: Scene, state: State | None) -> None:
        """Take the state of a frame, or none."""
        if state is None:
            self.missed += 1
            return
        velocity = (state.fit.pose - self.before) / (self.missed + 1)
        velocity[2] = np.clip(velocity[2], -scene.settings.turn, scene.settings.turn)
        if isinstance(scene.bodies[self.body], Outline):
            velocity[3] = 0.0
        self.velocity, self.before, self.missed, self.known = velocity, state.fit.pose, 0, True


def follow(scene: Scene, seeds: list[dict[int, Floats]]) -> list[States]:
    """States of all bodies in the frames where they are seen, from their poses (4,) at the seeds' frames, which hold.

    In each frame all bodies are assigned together: a place is one body's. Between two seeds a frame takes the state of
    the nearer one that has one. The scene's poses are set.
    """
    found: list[States] = []
    walkers: list[_Walker] = []
    for i, own in enumerate(seeds):
        frames = sorted(own)
        found.append({k: seeded(scene, i, k, own[k]) for k in frames})
        if frames:
            scene.usual[i] = np.median([state.contrast for state in found[i].values()])
        for position, k in enumerate(frames):
            pose = found[i][k].fit.pose
            scene.poses[i, k] = pose
            after = frames[position + 1] if position + 1 < len(frames) else scene.film.count
            walkers.append(_Walker(i, k, 1, after, pose))
            walkers.append(_Walker(i, k, -1, frames[position - 1] if position else -1, pose))
    near: list[dict[int, int]] = [dict.fromkeys(own, 0) for own in seeds]
    for step in (1, -1):
        for k in range(scene.film.count)[::step]:
            scene.tick()
            active = [w for w in walkers if w.step == step and (k - w.seed) * step > 0 and (w.end - k) * step > 0]
            for walker, state in zip(active, _assigned(scene, active, k), strict=True):
                walker.advance(scene, state)
                if state is not None and abs(k - walker.seed) < near[walker.body].get(k, 10**9):
                    found[walker.body][k], near[walker.body][k] = state, abs(k - walker.seed)
                    scene.poses[walker.body, k] = state.fit.pose
    return found


def _assigned(scene: Scene, walkers: list[_Walker], frame: int) -> list[State | None]:
    """State of each walker in a frame, or none, so that the sum of scores is largest and no place is taken twice."""
    s = scene.settings
    options = []
    for w in walkers:
        shape = scene.bodies[w.body]
        moved = np.linalg.norm(shape.centre(w.before + w.velocity) - shape.centre(w.before)) / shape.radius(w.before)
        reach = (s.search if w.known else 1.6 * s.search) * (1 + w.missed) + s.faster * float(np.nan_to_num(moved))
        others = [w.before] if w.known and not w.missed else []
        options.append(candidates(scene, w.body, frame, w.predicted(), others, w.before, min(reach, 5 * s.search)))
    places: list[Floats] = []
    columns: list[list[int]] = []
    for w, states in zip(walkers, options, strict=True):
        shape, own = scene.bodies[w.body], []
        for _, state in states:
            centre, radius = shape.centre(state.fit.pose), shape.radius(state.fit.pose)
            at = [m for m, place in enumerate(places) if np.linalg.norm(place - centre) < s.apart * radius]
            if not at:
                places.append(centre)
            own.append(at[0] if at else len(places) - 1)
        columns.append(own)
    gain = np.zeros((len(walkers), len(places) + len(walkers)))
    gain[:, : len(places)] = -np.inf
    for row, (states, own) in enumerate(zip(options, columns, strict=True)):
        for (value, _), column in zip(states, own, strict=True):
            gain[row, column] = max(gain[row, column], value)
    chosen = linear_sum_assignment(np.where(np.isfinite(gain), gain, -1e6), maximize=True)[1] if len(walkers) else []
    result: list[State | None] = []
    for column, states, own in zip(chosen, options, columns, strict=True):
        fitting = [option for option, at in zip(states, own, strict=True) if at == column]
        result.append(max(fitting, key=lambda option: option[0])[1] if fitting else None)
    return result


def seeded(scene: Scene, body: int, frame: int, pose: Floats) -> State:
    """State at a seed: refined, but held within a share of the body's size."""
    shape = scene.bodies[body]
    prior = max(scene.settings.hold, scene.settings.hold_pixels / shape.radius(pose)) * shape.unit
    starts = shape.angles()
    prior[2] = np.pi / 8 if len(starts) > 1 else scene.settings.turn
    states = [state_at(scene, body, frame, pose + np.array([0.0, 0.0, a, 0.0]), prior) for a in starts]
    return max(states, key=lambda s: score(scene, body, s, None))


def refit(scene: Scene, seeds: list[dict[int, Floats]]) -> list[States]:
    """Refine every body in every frame with all others where they are, the nearest first; seeds hold.

    Frames are taken outward from a body's own seeds. Starts are a body's own pose, the continuation of the frames
    between it and the nearest seed, else that beyond, and the middle of both its neighbours: what went wrong far from a
    seed does not spread towards it.
    """
    found: list[States] = [{} for _ in scene.bodies]
    behind = np.array([[b.depth(p) for p in own] for b, own in zip(scene.bodies, scene.poses, strict=True)])
    behind = np.where(np.isfinite(scene.poses[..., 0]), behind, np.inf)
    far = [[min((abs(k - m) for m in own), default=0) for k in range(scene.film.count)] for own in seeds]
    pairs = itertools.product(range(len(scene.bodies)), range(scene.film.count))
    for i, k in sorted(pairs, key=lambda pair: (far[pair[0]][pair[1]], behind[pair])):
        if i == 0:
            scene.tick()
        state = seeded(scene, i, k, seeds[i][k]) if k in seeds[i] else _again(scene, i, k, seeds[i])
        if state is None or (k not in seeds[i] and not present(scene, i, state)):
            scene.poses[i, k] = np.nan
            continue
        scene.poses[i, k] = state.fit.pose
        found[i][k] = state
    for i, states in enumerate(found):
        if states:
            scene.usual[i] = np.median([state.contrast for state in states.values()])
    return found


def _again(scene: Scene, body: int, frame: int, seeds: dict[int, Floats]) -> State | None:
    """Best state among refinements of a body's own pose and of its neighbouring frames' course."""
    poses, count, radius = scene.poses[body], scene.film.count, scene.bodies[body].radius
    known = np.isfinite(poses[:, 0])
    starts = [poses[frame]] if known[frame] else []
    nearest = min(seeds, key=lambda k: abs(k - frame), default=None)
    towards = 1 if nearest is None or nearest > frame else -1
    courses: list[Floats] = []
    for side in (towards, -towards):
        a, b = frame + side, frame + 2 * side
        if (nearest is None or not courses) and 0 <= a < count and 0 <= b < count and known[a] and known[b]:
            courses.append(2 * poses[a] - poses[b])
    starts += courses
    if 0 < frame < count - 1 and known[frame - 1] and known[frame + 1]:
        starts.append((poses[frame - 1] + poses[frame + 1]) / 2)
    starts = [pose for pose in starts if in_view(scene, body, pose)]
    if not starts:
        return _searched(scene, body, frame)
    centre = scene.bodies[body].centre
    first = centre(starts[0])
    far = [p for p in starts[1:] if np.linalg.norm(centre(p) - first) > 0.3 * radius(starts[0])]
    course = starts[-1] if len(starts) > 1 else None
    prior = motion_prior(scene, body)
    states = [
        state_at(scene, body, frame, p, prior, coarse=4 if p is starts[0] and known[frame] else 1)
        for p in [starts[0], *far]
    ]
    spread = _bends(scene, body) if len(starts) > 1 else None
    best = max(states, key=lambda s: score(scene, body, s, course, spread))
    if not present(scene, body, best):
        return _searched(scene, body, frame)
    options = [best, *competitors(scene, body, frame, best)]
    scores = np.array([score(scene, body, s, course, spread) for s in options])
    most = int(np.argmax(scores))
    return replace(options[most], posterior=float(1 / np.exp(scores - scores[most]).sum()))


def _searched(scene: Scene, body: int, frame: int) -> State | None:
    """Best state near the line between the nearest frames where a body is seen, or near the only one, if any."""
    s, shape = scene.settings, scene.bodies[body]
    known = np.flatnonzero(np.isfinite(scene.poses[body, :, 0]))
    near = [*known[known < frame][-1:], *known[known > frame][:1]]
    near = [int(k) for k in near if abs(k - frame) <= s.gap]
    if not near:
        return None
    poses = scene.poses[body, near]
    share = (frame - near[0]) / (near[-1] - near[0]) if len(near) > 1 else 0.0
    about = poses[0] + share * (poses[-1] - poses[0])
    apart = np.linalg.norm(shape.centre(poses[-1]) - shape.centre(poses[0])) / shape.radius(about)
    reach = min(s.search + s.faster * float(apart), 5 * s.search)
    starts = peaks(scene, body, frame, about, reach, s.fraction * scene.usual[body])
    states = [state_at(scene, body, frame, pose, motion_prior(scene, body)) for pose in starts]
    free = [state for state in states if vacant(scene, body, frame, state)]
    return max(free, key=lambda state: score(scene, body, state, None), default=None)


def _bends(scene: Scene, body: int) -> float:
    """Usual distance [radii] of a body from the middle of the frames before and after, within the settings' limits."""
    poses = scene.poses[body]
    seen = poses[np.isfinite(poses[:, 0])]
    if len(seen) < 5:
        return scene.settings.motion
    shape = scene.bodies[body]
    centres = np.array([shape.centre(p) if np.isfinite(p[0]) else np.full(2, np.nan) for p in poses])
    apart = np.linalg.norm(centres[1:-1] - 0.5 * (centres[2:] + centres[:-2]), axis=1)
    usual = float(np.nanmedian(apart)) if np.isfinite(apart).any() else np.inf
    radius = shape.radius(seen[len(seen) // 2])
    return float(np.clip(2.0 * usual / radius, scene.settings.motion / 5, scene.settings.motion))
