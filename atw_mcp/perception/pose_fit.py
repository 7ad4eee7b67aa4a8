"""Poses, and a size shared by all frames, whose outlines pass through observed outline points.

Robust Gauss-Newton for all frames at once; the shared size is eliminated by a Schur complement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.silhouettes import TURNING, SolidKind, Stage, outline_distance

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# px at which a point's influence is halved (Cauchy). Masks err outwards, into contact shadows and reflections,
# more often than inwards.
ROBUST_INWARD = 1.0
ROBUST_OUTWARD = 0.45
INDEPENDENT = 4.0  # pieces of an outline whose errors are independent: neighbouring points share theirs
LEAST_ERROR = 0.3  # px: outline errors are never taken to be smaller


@dataclass(frozen=True)
class PoseFit:
    """poses (F, 3); size (m,); cost (F,) mean robust cost [px^2]; rms (F,) robust residual [px];
    covariance (F, k, k) of (x, y[, turn]); size_sigma (m,) [m], NaN where the size was given."""

    poses: Floats
    size: Floats
    cost: Floats
    rms: Floats
    covariance: Floats
    size_sigma: Floats


@dataclass(frozen=True)
class OutlineProblem:
    """Outline points (F, P, 2), of which `valid` (F, P) count, of a solid of one kind on a stage.

    lift: height of its centre above the plane [m]; None: as its size says.
    """

    stage: Stage
    kind: SolidKind
    points: Floats
    valid: Bools
    lift: float | None = None

    def residual(self, poses: Floats, size: Floats) -> Floats:
        """Signed distances (F, P) [px] of the points from the outline, 0 where not valid."""
        distance = outline_distance(self.stage, self.kind, poses, size, self.points, self.lift)
        # A pose behind the camera is as bad as can be, not undefined.
        return np.where(self.valid, np.nan_to_num(distance, nan=1e3), 0.0)


def fit_poses(problem: OutlineProblem, poses: Floats, size: Floats, *, fit_size: bool, iterations: int = 14) -> PoseFit:
    """Fit poses (F, 3), and if asked the size, beginning at the given ones."""
    stage, kind, valid = problem.stage, problem.kind, problem.valid
    turns = kind in TURNING
    freedom = 3 if turns else 2
    poses, size = poses.copy(), size.copy()
    reach = float(np.linalg.norm(stage.camera.centre - np.asarray(stage.plane.point)))
    step = np.array([1e-5 * reach, 1e-5 * reach, 1e-4])[:freedom]
    damping = np.full(len(poses), 1e-3)
    residual = problem.residual(poses, size)
    cost = _cost(residual, valid)
    for _ in range(iterations):
        weight = _weight(residual, valid)
        jacobian = _jacobian(problem, poses, size, residual, step)
        weighted = jacobian * weight[..., None]
        normal = np.swapaxes(weighted, 1, 2) @ jacobian
        gradient = np.einsum("fpk,fp->fk", weighted, residual)
        diagonal = np.einsum("fkk->fk", normal)
        damped = (
            normal
            + np.eye(freedom) * ((damping[:, None] + 1e-9) * diagonal + 1e-9 * diagonal.max() + 1e-12)[:, None, :]
        )
        size_step = np.zeros_like(size)
        if fit_size:
            size_step, coupling = _size_step(problem, poses, size, residual, weight, damped, weighted)
            gradient = gradient + np.einsum("fkm,m->fk", coupling, size_step)
        change = -np.linalg.solve(damped, gradient[..., None])[..., 0]
        limit = np.array([0.15 * reach, 0.15 * reach, 0.35])[:freedom]
        change = np.clip(change, -limit, limit)
        trial = poses.copy()
        trial[:, :freedom] += change
        trial_size = np.maximum(size + np.clip(size_step, -0.3 * size, 0.3 * size), 1e-6)
        trial_residual = problem.residual(trial, trial_size)
        trial_cost = _cost(trial_residual, valid)
        if fit_size:
            if trial_cost.sum() <= cost.sum() * 1.0001:
                moved = float(np.abs(change).max())
                poses, size, residual, cost = trial, trial_size, trial_residual, trial_cost
                damping = damping * 0.3
                if moved < 2e-5 * reach:
                    break
            else:
                damping = damping * 10
        else:
            better = trial_cost < cost
            poses[better], residual[better], cost[better] = trial[better], trial_residual[better], trial_cost[better]
            damping = np.where(better, damping * 0.3, damping * 8)
            if not better.any() or np.abs(change[better]).max() < 2e-5 * reach:
                break
    return _finish(problem, poses, size, residual, cost, step, fit_size)


def _weight(residual: Floats, valid: Bools) -> Floats:
    return valid / (1 + (residual / _scale(residual)) ** 2)


def _scale(residual: Floats) -> Floats:
    return np.where(residual > 0, ROBUST_OUTWARD, ROBUST_INWARD)


def _cost(residual: Floats, valid: Bools) -> Floats:
    scale = _scale(residual)
    loss = scale**2 * np.log1p((residual / scale) ** 2)
    total: Floats = (loss * valid).sum(axis=1) / np.maximum(valid.sum(axis=1), 1)
    return total


def _jacobian(
    problem: OutlineProblem,
    poses: Floats,
    size: Floats,
    residual: Floats,
    step: Floats,
) -> Floats:
    columns = []
    for k, h in enumerate(step):
        moved = poses.copy()
        moved[:, k] += h
        columns.append((problem.residual(moved, size) - residual) / h)
    return np.stack(columns, axis=-1)


def _size_jacobian(problem: OutlineProblem, poses: Floats, size: Floats, residual: Floats) -> Floats:
    columns = []
    for m in range(len(size)):
        h = 1e-4 * size[m]
        grown = size.copy()
        grown[m] += h
        columns.append((problem.residual(poses, grown) - residual) / h)
    return np.stack(columns, axis=-1)


def _size_step(
    problem: OutlineProblem,
    poses: Floats,
    size: Floats,
    residual: Floats,
    weight: Floats,
    damped: Floats,
    weighted: Floats,
) -> tuple[Floats, Floats]:
    """Change of the shared size, poses eliminated, and the coupling (F, k, m) between the two."""
    jacobian = _size_jacobian(problem, poses, size, residual)
    coupling = np.swapaxes(weighted, 1, 2) @ jacobian
    own = np.einsum("fpm,fp,fpn->mn", jacobian, weight, jacobian)
    gradient = np.einsum("fpm,fp,fp->m", jacobian, weight, residual)
    pose_gradient = np.einsum("fpk,fp->fk", weighted, residual)
    eliminated = np.linalg.solve(damped, coupling)
    schur = own - np.einsum("fkm,fkn->mn", coupling, eliminated)
    right = gradient - np.einsum("fkm,fk->m", eliminated, pose_gradient)
    schur = schur + np.eye(len(size)) * (1e-4 * np.diag(schur).max() + 1e-12)
    return -np.linalg.solve(schur, right), coupling


def _finish(
    problem: OutlineProblem,
    poses: Floats,
    size: Floats,
    residual: Floats,
    cost: Floats,
    step: Floats,
    fit_size: bool,
) -> PoseFit:
    valid = problem.valid
    weight = _weight(residual, valid)
    jacobian = _jacobian(problem, poses, size, residual, step)
    weighted = jacobian * weight[..., None]
    normal = np.swapaxes(weighted, 1, 2) @ jacobian
    total = np.maximum(weight.sum(axis=1), 1e-9)
    rms = np.sqrt((weight * residual**2).sum(axis=1) / total)
    variance = np.maximum(rms, LEAST_ERROR) ** 2 * np.maximum(valid.sum(axis=1) / INDEPENDENT, 1.0)
    scale = np.sqrt(np.maximum(np.einsum("fkk->fk", normal), 1e-12))
    unit = normal / scale[:, :, None] / scale[:, None, :] + 1e-9 * np.eye(len(step))
    covariance = np.linalg.inv(unit) / scale[:, :, None] / scale[:, None, :] * variance[:, None, None]
    sigma = np.full(len(size), np.nan)
    if fit_size:
        shared = _size_jacobian(problem, poses, size, residual)
        coupling = np.swapaxes(weighted, 1, 2) @ shared
        own = np.einsum("fpm,fp,fpn->mn", shared, weight, shared)
        schur = own - np.einsum("fkm,fkn->mn", coupling, np.linalg.solve(normal + 1e-9 * np.eye(len(step)), coupling))
        spread = np.linalg.pinv(schur) * float(np.median(variance))
        # Errors of the outline (lens, contact shadow) repeat from frame to frame: frames do not average them out.
        sigma = np.sqrt(np.maximum(np.diag(spread), 0) * max(len(poses) / 3.0, 1.0))
    return PoseFit(poses, size, cost, rms, covariance, sigma)
