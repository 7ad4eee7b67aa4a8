"""A pinhole camera: world points to pixels and pixels to rays."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, WithJsonSchema, field_validator

Array = NDArray[np.float64]

Matrix3 = Annotated[
    tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]],
    WithJsonSchema(
        {
            "type": "array",
            "minItems": 3,
            "maxItems": 3,
            "items": {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
        }
    ),
]
Vector3 = Annotated[
    tuple[float, float, float],
    WithJsonSchema({"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}),
]


class Camera(BaseModel):
    """Pinhole camera without distortion: pixel ~ K (R X + t); u right, v down, camera z forward."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    width: int = Field(gt=0, le=16384, description="image width [px]")
    height: int = Field(gt=0, le=16384, description="image height [px]")
    intrinsics: Matrix3 = Field(description="K [px]")
    rotation: Matrix3 = Field(description="R, world axes to camera axes")
    translation: Vector3 = Field(description="t, the world origin in camera axes [m]")

    @field_validator("rotation")
    @classmethod
    def _is_rotation(cls, value: Matrix3) -> Matrix3:
        matrix = np.asarray(value)
        if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-5) or np.linalg.det(matrix) < 0:
            raise ValueError("rotation must be orthonormal with determinant +1")
        return value

    @property
    def centre(self) -> Array:
        """Position of the camera in the world, shape (3,) [m]."""
        centre: Array = -np.asarray(self.rotation).T @ np.asarray(self.translation)
        return centre

    def project(self, points: Array) -> Array:
        """Pixels (..., 2) of world points (..., 3); NaN for points not in front of the camera."""
        camera_points = self.to_camera(points)
        depth = camera_points[..., 2:3]
        image = camera_points @ np.asarray(self.intrinsics).T
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels: Array = np.where(depth > 1e-9, image[..., :2] / image[..., 2:3], np.nan)
        return pixels

    def to_camera(self, points: Array) -> Array:
        """World points (..., 3) in camera axes, shape (..., 3) [m]."""
        moved: Array = np.asarray(points, dtype=float) @ np.asarray(self.rotation).T + np.asarray(self.translation)
        return moved

    def rays(self, pixels: Array) -> Array:
        """Unit directions (..., 3), world axes, through pixels (..., 2)."""
        homogeneous = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)
        directions = homogeneous @ np.linalg.inv(np.asarray(self.intrinsics)).T @ np.asarray(self.rotation)
        unit: Array = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        return unit

    def onto_plane(self, pixels: Array, point: Array, normal: Array) -> Array:
        """World points (..., 3) where the rays of pixels (..., 2) meet a plane; NaN where they do not."""
        directions = self.rays(pixels)
        origin = self.centre
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = ((np.asarray(point) - origin) @ np.asarray(normal)) / (directions @ np.asarray(normal))
        distance = np.where(distance > 0, distance, np.nan)
        hit: Array = origin + distance[..., None] * directions
        return hit

    def sees(self, points: Array) -> NDArray[np.bool_]:
        """Whether world points (..., 3) project inside the image, shape (...)."""
        pixels = self.project(points)
        with np.errstate(invalid="ignore"):
            inside: NDArray[np.bool_] = np.all((pixels >= 0) & (pixels < [self.width, self.height]), axis=-1)
        return inside
