"""Liquids shaded as water is: lit, reflecting the sky, and tinting what is seen through them by the ray's length."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from polyworld.core import buffers
from polyworld.pictures.liquid_surface import BALL
from polyworld.pictures.scene import Hits, light, pixel_to_ray
from polyworld.world.camera import Camera

wp.set_module_options({"enable_backward": False})

SLICE = 8.0  # spacings that a planar fluid seems to be thick
SEEN_THROUGH = 0.55  # weight of a hollow or static thing's own colour where a fluid is behind it
WATER = (64, 140, 210)
_OPAQUE = 12.0  # spacings of fluid after which hardly anything behind is seen
_SKY = wp.constant(wp.vec3(0.93, 0.96, 1.0))
_MOST_CROSSINGS = 64  # of one ray with surfaces of liquids


def with_liquid(
    liquid: Hits,
    camera: Camera,
    color: NDArray[np.float32],
    in_front: NDArray[np.bool_],
    behind: NDArray[np.bool_],
    own_colors: Mapping[int, tuple[int, int, int]],
    spacing: float,
    *,
    planar: bool,
) -> NDArray[np.float32]:
    """Lay liquids over the colours (H, W, 3), 0..1, of what was drawn before, or show them through it.

    in_front (H, W): pixels whose nearest thing is a liquid. behind (H, W): pixels whose nearest thing lets a liquid
    behind it be guessed: walls of tanks, hollow bodies. own_colors: of each liquid, by label. spacing: of particles
    [m]. planar: the liquid is a slice, shown as if it went on across the plane.
    """
    drawn = liquid.labels >= 0
    # The rim of the water fades over a pixel or two.
    rim = np.clip(gaussian_filter(drawn.astype(np.float32), 0.6) * 2.0 - 1.0, 0.35, 1.0)
    share = np.where(in_front, rim, np.where(behind, 1.0 - SEEN_THROUGH, 0.0))
    own = np.zeros((max(own_colors) + 1, 3))
    for label, value in own_colors.items():
        own[label] = np.asarray(value) / 255.0
    radius = BALL * spacing * camera.intrinsics[0][0] / float(np.median(liquid.depth[drawn]))  # [px]
    thickness = (SLICE / (2.0 * BALL) if planar else 1.0) / spacing
    result: Any = buffers.array(color, wp.vec3)
    arrays = [(liquid.labels, int), (liquid.normals, wp.vec3), (share, float), (own, wp.vec3), (color, wp.vec3)]
    buffers.launch(
        lay_over,
        share.shape,
        [
            liquid.mesh.id,
            pixel_to_ray(camera),
            *(wp.vec3(*camera.rotation[axis]) for axis in range(2)),
            wp.vec3(*light(camera)),
            thickness,
            0.35 * radius,
            *(buffers.array(rows, kind) for rows, kind in arrays),
            result,
        ],
    )
    shaded: NDArray[np.float32] = buffers.read(result)
    return shaded


@wp.func
def _path_inside(mesh: wp.uint64, d: wp.vec3) -> float:
    """Length of the ray inside closed surfaces, which may overlap [m]."""
    inside, start, entered = wp.float32(0.0), wp.float32(0.0), wp.float32(0.0)
    around = wp.int32(0)  # surfaces that the ray is inside of
    for _ in range(_MOST_CROSSINGS):
        hit = wp.mesh_query_ray(mesh, d * start, d, 1.0e30)
        if not hit.result:
            break
        start = (start + hit.t) * 1.00001  # past this surface
        if wp.dot(hit.normal, d) < 0.0:
            if around == 0:
                entered = start
            around = around + 1
        elif around > 0:
            around = around - 1
            if around == 0:
                inside = inside + start - entered
    if around > 0:  # a way out slipped through an edge
        inside = inside + start - entered
    return inside


@wp.kernel
def lay_over(
    mesh: wp.uint64,
    # camera and light
    pixel_to_ray: wp.mat33,
    right: wp.vec3,
    down: wp.vec3,
    light: wp.vec3,
    thickness: float,
    bend: float,
    # pixels
    labels: wp.array2d[int],
    normals: wp.array2d[wp.vec3],
    share: wp.array2d[float],
    own_colors: wp.array[wp.vec3],
    behind: wp.array2d[wp.vec3],
    # out
    color: wp.array2d[wp.vec3],
) -> None:
    """Mix a share of water into the colour of each pixel; thickness: spacings per metre, bend [px per spacing]."""
    row, column = wp.tid()
    if share[row, column] <= 0.0:
        return
    d = wp.normalize(pixel_to_ray @ wp.vec3(float(column), float(row), 1.0))
    n = normals[row, column]
    thick = _path_inside(mesh, d) * thickness
    # What is behind is seen shifted, as a surface oblique to the view refracts it.
    shift = wp.min(thick, 8.0) * bend
    u = wp.clamp(int(wp.rint(float(column) - wp.dot(n, right) * shift)), 0, color.shape[1] - 1)
    v = wp.clamp(int(wp.rint(float(row) - wp.dot(n, down) * shift)), 0, color.shape[0] - 1)
    own = own_colors[labels[row, column]]
    lit = 0.45 + 0.55 * wp.clamp(wp.dot(n, light), 0.0, 1.0)
    murky = 1.0 - wp.exp(-(1.4 / _OPAQUE) * thick)
    reflected = 0.04 + 0.6 * wp.pow(1.0 - wp.clamp(-wp.dot(n, d), 0.0, 1.0), 5.0)
    glint = 0.55 * wp.pow(wp.clamp(wp.dot(n, wp.normalize(light - d)), 0.0, 1.0), 80.0)
    old = color[row, column]
    for c in range(3):
        # Beer and Lambert: what the fluid's colour lacks is absorbed on the way.
        passed = wp.exp(-(3.0 / _OPAQUE) * thick * (1.15 - own[c]))
        water = behind[v, u][c] * passed * (1.0 - 0.75 * murky) + own[c] * lit * (0.12 + 0.63 * murky)
        water = water * (1.0 - reflected) + _SKY[c] * reflected + glint
        old[c] = wp.clamp(share[row, column] * water + (1.0 - share[row, column]) * old[c], 0.0, 1.0)
    color[row, column] = old
