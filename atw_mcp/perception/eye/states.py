"""States: where a body is in one frame, searched coarse to fine about the places where it may be."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.pixels import Floats, filled
from atw_mcp.perception.eye.silhouette import Fit, fit_pose


@dataclass(frozen=True)
class State:
    """A fitted pose with what supports it: mean log odds inside and in a ring around it [nats], visible share.

    posterior: probability of its place against others in the same frame that could be the body's.
    """

    fit: Fit
    inside: float
    around: float
    visible: float
    posterior: float = 1.0

    @property
    def contrast(self) -> float:
        """Mean log odds [nats] by which the body's pixels look more like it than those around it."""
        return self.inside - max(self.around, 0.0)


def present(scene: Scene, body: int, state: State) -> bool:
    """Check that pixels show a body at a state about as well as they do where it is known to be."""
    s = scene.settings
    return state.contrast > max(s.present, s.fraction * scene.usual[body]) and state.visible > s.visible


def state_at(scene: Scene, body: int, frame: int, pose: Floats, prior: Floats | None = None, coarse: int = 0) -> State:
    """Refine a pose and evaluate what supports it."""
    fit = fit_pose(scene, body, frame, pose, prior, coarse)
    return State(fit, *scene.looks(body, frame, fit.pose))


def in_view(scene: Scene, body: int, pose: Floats) -> bool:
    """Whether a pose has a silhouette: it is not beyond the horizon of its plane, nor behind the camera."""
    return bool(np.isfinite(pose).all() and np.isfinite(scene.bodies[body].polygon(pose)).all())


def motion_prior(scene: Scene, body: int) -> Floats:
    """Standard deviations (4,) of a pose about its prediction from the frame before."""
    s, shape = scene.settings, scene.bodies[body]
    wide = 3.0 * shape.unit
    wide[2] = s.turn
    if np.isclose(shape.unit[3], 1.0) and np.isclose(shape.unit[2], 1.0):
        wide[3] = s.growth
    return wide


def score(scene: Scene, body: int, state: State, predicted: Floats | None, spread: float | None = None) -> float:
    """Log likelihood [nats] of a state: what supports it, tempered, and the motion from a prediction.

    The motion's error has Cauchy tails in two coordinates, since bodies collide; spread: its scale [radii].
    """
    s, shape = scene.settings, scene.bodies[body]
    area = np.pi * shape.radius(state.fit.pose) ** 2
    total = min(s.support, area / s.correlated**2) * state.contrast * state.visible
    if predicted is not None:
        apart = float(np.linalg.norm(shape.centre(state.fit.pose) - shape.centre(predicted)))
        total -= 1.5 * np.log1p((apart / ((spread or s.motion) * shape.radius(predicted))) ** 2)
    return total


def peaks(
    scene: Scene, body: int, frame: int, pose: Floats, reach: float, least: float, *, besides: bool = False
) -> list[Floats]:
    """Poses of largest summed log odds about a pose, within `reach` [radii]: a correlation with the silhouette.

    least: mean log odds [nats] of what is not hidden from which on they are found. besides: the body is at the pose,
    and what its silhouette and its shade explain is no evidence of another place.
    """
    s, shape = scene.settings, scene.bodies[body]
    radius, middle = shape.radius(pose), shape.centre(pose)
    pitch = max(1.0, radius / s.coarse)
    count = int(np.ceil(reach * radius / pitch))
    u, v = (middle[a] + np.arange(-count, count + 1) * pitch for a in (0, 1))
    u = u[(u > -radius) & (u < scene.film.width + radius)]
    v = v[(v > -radius) & (v < scene.film.height + radius)]
    if len(u) < 2 or len(v) < 2:
        return []
    grid = np.stack(np.meshgrid(u, v), axis=-1)
    odds, free = scene.log_odds(body, frame, pose, grid.reshape(-1, 2), anywhere=True, besides=besides)
    image = np.where(free, odds, 0.0).reshape(grid.shape[:2]).astype(np.float32)
    polygon = (shape.polygon(pose) - middle) / pitch
    half = int(np.ceil(np.abs(polygon).max())) + 1
    kernel = filled(polygon + half, (0, 0), (2 * half + 1, 2 * half + 1)).astype(np.float32)
    kernel /= max(kernel.sum(), 1.0)
    summed = cv2.filter2D(image, -1, kernel, borderType=cv2.BORDER_CONSTANT)
    if not besides:  # what is hidden speaks neither for a place nor against it
        seen = cv2.filter2D(free.reshape(image.shape).astype(np.float32), -1, kernel, borderType=cv2.BORDER_CONSTANT)
        summed[summed < least * np.maximum(seen, s.visible)] = -np.inf
        least = 0.0
    found = []
    for _ in range(s.peaks):
        row, column = divmod(int(np.argmax(summed)), summed.shape[1])
        if summed[row, column] < least:
            break
        place = grid[row, column]
        if in_view(scene, body, shape.placed(place, pose)):
            found.append(shape.placed(place, pose))
        summed[np.hypot(*np.moveaxis(grid - place, -1, 0)) < radius] = -np.inf
    return found


def candidates(
    scene: Scene, body: int, frame: int, predicted: Floats, others: list[Floats], about: Floats, reach: float
) -> list[tuple[float, State]]:
    """Scored states of a body in a frame: at its prediction and other poses; by search `about` a pose, within `reach`
    [radii], where those look weak. None where it is not seen."""
    if not in_view(scene, body, predicted):
        predicted = about
    prior = motion_prior(scene, body)
    found: list[tuple[float, State]] = []

    def attempt(pose: Floats, coarse: int) -> None:
        state = state_at(scene, body, frame, pose, prior, coarse)
        if present(scene, body, state):
            found.append((score(scene, body, state, predicted), state))

    def shown() -> bool:
        return any(state.contrast > scene.settings.weak * scene.usual[body] for _, state in found)

    for pose in [predicted, *others]:
        if not shown():
            attempt(pose, 1)
    if not shown():
        for pose in peaks(scene, body, frame, about, reach, 0.2 * scene.settings.present):
            attempt(pose, 0)
    return found


def competitors(scene: Scene, body: int, frame: int, state: State) -> list[State]:
    """States elsewhere around one, that pixels support which it does not explain."""
    s, shape, pose = scene.settings, scene.bodies[body], state.fit.pose
    least = s.fraction * max(state.contrast, s.present)
    found = []
    for start in peaks(scene, body, frame, pose, s.search, least, besides=True):
        other = state_at(scene, body, frame, start, motion_prior(scene, body))
        apart = np.linalg.norm(shape.centre(other.fit.pose) - shape.centre(pose))
        if apart > s.apart * shape.radius(pose) and present(scene, body, other) and vacant(scene, body, frame, other):
            found.append(other)
    return found


def vacant(scene: Scene, body: int, frame: int, state: State) -> bool:
    """Whether no other body is at a state's place."""
    shape = scene.bodies[body]
    centre, reach = shape.centre(state.fit.pose), scene.settings.apart * shape.radius(state.fit.pose)
    others = [j for j in range(len(scene.bodies)) if j != body and np.isfinite(scene.poses[j, frame, 0])]
    return all(np.linalg.norm(scene.bodies[j].centre(scene.poses[j, frame]) - centre) > reach for j in others)
