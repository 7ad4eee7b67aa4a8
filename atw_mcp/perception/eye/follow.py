"""Follow: a body over the clip from its seeds, by prediction from the motion so far and the greatest likelihood."""

from __future__ import annotations

import numpy as np

from atw_mcp.perception.eye.bodies import Outline
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.pixels import Floats
from atw_mcp.perception.eye.states import State, locate, motion_prior, present, score, state_at

States = dict[int, State]


def follow(scene: Scene, body: int, seeds: dict[int, Floats]) -> States:
    """States of a body in the frames where it is seen, from its poses (4,) at the seeds' frames, which hold.

    Between two seeds a frame takes the state of the nearer one that has one.
    """
    frames = sorted(seeds)
    found: States = {k: seeded(scene, body, k, seeds[k]) for k in frames}
    scene.usual[body] = np.median([state.contrast for state in found.values()])
    near: dict[int, int] = dict.fromkeys(frames, 0)
    for position, k in enumerate(frames):
        for step, end in ((1, frames[position + 1] if position + 1 < len(frames) else scene.film.count), (-1, frames[position - 1] if position else -1)):
            for frame, state in _walk(scene, body, k, found[k], step, end).items():
                if abs(frame - k) < near.get(frame, scene.film.count):
                    found[frame], near[frame] = state, abs(frame - k)
    return found


def seeded(scene: Scene, body: int, frame: int, pose: Floats) -> State:
    """State at a seed: refined, but held within a share of the body's size."""
    shape = scene.bodies[body]
    prior = max(scene.settings.hold, scene.settings.hold_pixels / shape.radius(pose)) * shape.unit
    starts = shape.angles()
    prior[2] = np.pi / 8 if len(starts) > 1 else scene.settings.turn
    states = [state_at(scene, body, frame, pose + [0.0, 0.0, a, 0.0], prior) for a in starts]
    return max(states, key=lambda s: score(scene, body, s, None))


def _walk(scene: Scene, body: int, frame: int, state: State, step: int, end: int) -> States:
    """States after (step 1) or before (-1) a frame until `end`, which is left out."""
    s, shape = scene.settings, scene.bodies[body]
    found: States = {}
    before, velocity, missed, known = state.fit.pose, np.zeros(4), 0, False
    for k in range(frame + step, end, step):
        predicted = before + velocity * (missed + 1)
        speed = float(np.linalg.norm(shape.centre(before + velocity) - shape.centre(before))) / shape.radius(before)
        reach = min((s.search if known else 1.6 * s.search) * (1 + missed) + s.search_speed * speed, s.search_most)
        now = locate(scene, body, k, predicted, [before] if known and not missed else [], before, reach)
        if not present(scene, body, now):
            missed += 1
            continue
        velocity = (now.fit.pose - before) / (missed + 1)
        velocity[2] = np.clip(velocity[2], -s.turn, s.turn)
        if isinstance(shape, Outline):
            velocity[3] = 0.0
        before, missed, known = now.fit.pose, 0, True
        found[k] = now
    return found


def refit(scene: Scene, seeds: list[dict[int, Floats]]) -> list[States]:
    """Refine every body in every frame with all others where they are, the nearest first; seeds hold.

    Starts are a body's own pose and the course of its neighbouring frames; where it was not seen, their continuation.
    """
    found: list[States] = [{} for _ in scene.bodies]
    for k in range(scene.film.count):
        seen = [i for i in range(len(scene.bodies)) if np.isfinite(scene.poses[i, k, 0])]
        hidden = [i for i in range(len(scene.bodies)) if i not in seen]
        for i in sorted(seen, key=lambda i: scene.bodies[i].depth(scene.poses[i, k])) + hidden:
            if k in seeds[i]:
                state: State | None = seeded(scene, i, k, seeds[i][k])
            else:
                state = _again(scene, i, k)
            if state is None or (k not in seeds[i] and not present(scene, i, state)):
                scene.poses[i, k] = np.nan
                continue
            scene.poses[i, k] = state.fit.pose
            found[i][k] = state
    for i, states in enumerate(found):
        if states:
            scene.usual[i] = np.median([state.contrast for state in states.values()])
    return found


def _again(scene: Scene, body: int, frame: int) -> State | None:
    """Best state among refinements of a body's own pose and of its neighbouring frames' course."""
    poses, count, radius = scene.poses[body], scene.film.count, scene.bodies[body].radius
    known = np.isfinite(poses[:, 0])
    starts = [poses[frame]] if known[frame] else []
    for a, b in ((frame - 1, frame - 2), (frame + 1, frame + 2)):
        if 0 <= a < count and 0 <= b < count and known[a] and known[b]:
            starts.append(2 * poses[a] - poses[b])
    if 0 < frame < count - 1 and known[frame - 1] and known[frame + 1]:
        starts.append((poses[frame - 1] + poses[frame + 1]) / 2)
    if not starts:
        return None
    centre = scene.bodies[body].centre
    first = centre(starts[0])
    far = [p for p in starts[1:] if np.linalg.norm(centre(p) - first) > 0.3 * radius(starts[0])]
    course = starts[-1] if len(starts) > 1 else None
    prior = motion_prior(scene, body)
    states = [state_at(scene, body, frame, p, prior, coarse=2 if p is starts[0] and known[frame] else 1) for p in [starts[0], *far]]
    return max(states, key=lambda s: score(scene, body, s, course))
