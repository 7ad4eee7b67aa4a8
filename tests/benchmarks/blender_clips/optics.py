"""Convert the clips' pinhole camera into the parameters of Blender's camera."""

from dataclasses import dataclass

import numpy as np

from tests.benchmarks.video_clips.bodies import Array
from tests.benchmarks.video_clips.camera import Camera

SENSOR_WIDTH = 36.0  # mm


@dataclass(frozen=True)
class BlenderCamera:
    """A perspective camera with horizontal sensor fit and no shift; it looks along -z of its axes.

    matrix: (4, 4) from camera to world. lens: focal length in mm. width, height: of the frame in pixels.
    """

    matrix: Array
    lens: float
    width: int
    height: int

    def project(self, points: Array) -> Array:
        """Project world points (n, 3) to pixels u, v (n, 2); the centre of the top-left pixel is (0, 0).

        The frame seen at unit depth is sensor width / lens wide and in proportion high (Blender manual, "Cameras";
        `bpy_extras.object_utils.world_to_camera_view`).
        """
        homogeneous = np.column_stack([points, np.ones(len(points))])
        seen = homogeneous @ np.linalg.inv(self.matrix).T
        wide = SENSOR_WIDTH / self.lens
        x = seen[:, 0] / -seen[:, 2] / wide + 0.5
        y = seen[:, 1] / -seen[:, 2] / (wide * self.height / self.width) + 0.5
        return np.column_stack([x * self.width - 0.5, (1.0 - y) * self.height - 0.5])


def blender_camera(camera: Camera) -> BlenderCamera:
    """Return the Blender camera that draws what the pinhole camera projects."""
    matrix = np.eye(4)
    matrix[:3, :3] = camera.axes()
    matrix[:3, 3] = camera.pos
    return BlenderCamera(matrix, camera.focal * SENSOR_WIDTH / camera.width, camera.width, camera.height)


def quaternion(matrix: Array) -> Array:
    """Return the unit quaternion w x y z of a rotation matrix (3, 3) (Shepperd 1978)."""
    m = np.asarray(matrix, dtype=float)
    k = np.array(
        [
            1 + m[0, 0] + m[1, 1] + m[2, 2],
            1 + m[0, 0] - m[1, 1] - m[2, 2],
            1 - m[0, 0] + m[1, 1] - m[2, 2],
            1 - m[0, 0] - m[1, 1] + m[2, 2],
        ]
    )
    skew = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    i = int(np.argmax(k))
    q = np.empty(4)
    if i == 0:
        q = np.array([k[0], *skew])
    else:
        a = i - 1
        q[0], q[i] = skew[a], k[i]
        for b in range(3):
            if b != a:
                q[b + 1] = m[a, b] + m[b, a]
    return np.asarray(q / np.linalg.norm(q))
