"""Poses, and a size shared by all frames, whose outlines pass through observed outline points.

Robust Gauss-Newton for all frames at once; the shared size is eliminated by a Schur complement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.silhouettes import SolidKind, Stage, outline_distance

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

ROBUST = 0.8  # px at which a point's influence is halved (Cauchy)
CORRELATED = 4.0  # neighbouring outline points share their error: this many count as one
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


def fit_poses(
    stage: Stage,
    kind: SolidKind,
    points: Floats,
    valid: Bools,
    poses: Floats,
    size: Floats,
    *,
    fit_size: bool,
    iterations: int = 14,
) -> PoseFit:
    """Fit poses (F, 3) to points (F, P, 2), of which `valid` (F, P) count, beginning at the given ones."""
    turns = kind in ("cube", "box")
    freedom = 3 if turns else 2
    poses, size = poses.copy(), size.copy()
    reach = float(np.linalg.norm(stage.camera.centre - np.asarray(stage.plane.point)))
    step = np.array([1e-5 * reach, 1e-5 * reach, 1e-4])[:freedom]
    damping = np.full(len(poses), 1e-3)
    residual = _residual(stage, kind, poses, size, points, valid)
    cost = _cost(residual, valid)
    for _ in range(iterations):
        weight = _weight(residual, valid)
        jacobian = _jacobian(stage, kind, poses, size, points, valid, residual, step)
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
            size_step, coupling = _size_step(
                stage, kind, poses, size, points, valid, residual, weight, damped, weighted
            )
            gradient = gradient + np.einsum("fkm,m->fk", coupling, size_step)
        change = -np.linalg.solve(damped, gradient[..., None])[..., 0]
        limit = np.array([0.15 * reach, 0.15 * reach, 0.35])[:freedom]
        change = np.clip(change, -limit, limit)
        trial = poses.copy()
        trial[:, :freedom] += change
        trial_size = np.maximum(size + np.clip(size_step, -0.3 * size, 0.3 * size), 1e-6)
        trial_residual = _residual(stage, kind, trial, trial_size, points, valid)
        trial_cost = _cost(trial_residual, valid)
        if fit_size:
            if trial_cost.sum() <= cost.sum() * 1.0001:
                moved = float(np.abs(change).max())
                poses, size, residual, cost = trial, trial_size, trial_residual, trial_cost
                damping = damping * 0.3
                if moved < 1e-6 * reach:
                    break
            else:
                damping = damping * 10
        else:
            better = trial_cost < cost
            poses[better], residual[better], cost[better] = trial[better], trial_residual[better], trial_cost[better]
            damping = np.where(better, damping * 0.3, damping * 8)
            if not better.any() or np.abs(change[better]).max() < 1e-6 * reach:
                break
    return _finish(stage, kind, points, valid, poses, size, residual, cost, step, fit_size)


def _residual(stage: Stage, kind: SolidKind, poses: Floats, size: Floats, points: Floats, valid: Bools) -> Floats:
    distance = outline_distance(stage, kind, poses, size, points)
    # A pose behind the camera is as bad as can be, not undefined.
    return np.where(valid, np.nan_to_num(distance, nan=1e3), 0.0)


def _weight(residual: Floats, valid: Bools) -> Floats:
    return valid / (1 + (residual / ROBUST) ** 2)


def _cost(residual: Floats, valid: Bools) -> Floats:
    loss = ROBUST**2 * np.log1p((residual / ROBUST) ** 2)
    total: Floats = (loss * valid).sum(axis=1) / np.maximum(valid.sum(axis=1), 1)
    return total


def _jacobian(
    stage: Stage,
    kind: SolidKind,
    poses: Floats,
    size: Floats,
    points: Floats,
    valid: Bools,
    residual: Floats,
    step: Floats,
) -> Floats:
    columns = []
    for k, h in enumerate(step):
        moved = poses.copy()
        moved[:, k] += h
        columns.append((_residual(stage, kind, moved, size, points, valid) - residual) / h)
    return np.stack(columns, axis=-1)


def _size_jacobian(
    stage: Stage, kind: SolidKind, poses: Floats, size: Floats, points: Floats, valid: Bools, residual: Floats
) -> Floats:
    columns = []
    for m in range(len(size)):
        h = 1e-4 * size[m]
        grown = size.copy()
        grown[m] += h
        columns.append((_residual(stage, kind, poses, grown, points, valid) - residual) / h)
    return np.stack(columns, axis=-1)


def _size_step(
    stage: Stage,
    kind: SolidKind,
    poses: Floats,
    size: Floats,
    points: Floats,
    valid: Bools,
    residual: Floats,
    weight: Floats,
    damped: Floats,
    weighted: Floats,
) -> tuple[Floats, Floats]:
    """Change of the shared size, poses eliminated, and the coupling (F, k, m) between the two."""
    jacobian = _size_jacobian(stage, kind, poses, size, points, valid, residual)
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
    stage: Stage,
    kind: SolidKind,
    points: Floats,
    valid: Bools,
    poses: Floats,
    size: Floats,
    residual: Floats,
    cost: Floats,
    step: Floats,
    fit_size: bool,
) -> PoseFit:
    weight = _weight(residual, valid)
    jacobian = _jacobian(stage, kind, poses, size, points, valid, residual, step)
    weighted = jacobian * weight[..., None]
    normal = np.swapaxes(weighted, 1, 2) @ jacobian
    total = np.maximum(weight.sum(axis=1), 1e-9)
    rms = np.sqrt((weight * residual**2).sum(axis=1) / total)
    variance = np.maximum(rms, LEAST_ERROR) ** 2 * CORRELATED
    scale = np.sqrt(np.maximum(np.einsum("fkk->fk", normal), 1e-12))
    unit = normal / scale[:, :, None] / scale[:, None, :] + 1e-9 * np.eye(len(step))
    covariance = np.linalg.inv(unit) / scale[:, :, None] / scale[:, None, :] * variance[:, None, None]
    sigma = np.full(len(size), np.nan)
    if fit_size:
        shared = _size_jacobian(stage, kind, poses, size, points, valid, residual)
        coupling = np.swapaxes(weighted, 1, 2) @ shared
        own = np.einsum("fpm,fp,fpn->mn", shared, weight, shared)
        schur = own - np.einsum("fkm,fkn->mn", coupling, np.linalg.solve(normal + 1e-9 * np.eye(len(step)), coupling))
        spread = np.linalg.pinv(schur) * float(np.median(variance))
        # Errors of the outline (lens, contact shadow) repeat from frame to frame: frames do not average them out.
        sigma = np.sqrt(np.maximum(np.diag(spread), 0) * max(len(poses) / 3.0, 1.0))
    return PoseFit(poses, size, cost, rms, covariance, sigma)
