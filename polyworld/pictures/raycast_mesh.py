"""Ray casting of triangle meshes: a module of its own, compiled only where a world has such a mesh."""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

_AMBIENT = 0.35


@wp.kernel
def cast_mesh(
    # camera
    origin: wp.vec3,
    pixel_to_ray: wp.mat33,
    # mesh
    mesh: wp.uint64,
    position: wp.vec3,
    rotation: wp.mat33,
    color: wp.vec3,
    label: int,
    # light
    light: wp.vec3,
    # in and out
    labels: wp.array2d[int],
    distance: wp.array2d[float],
    color_out: wp.array2d[wp.vec3],
) -> None:
    """Draw one mesh over what `raycast.cast` has drawn, where it is nearer; both sides of a face are seen."""
    row, column = wp.tid()
    d = wp.normalize(pixel_to_ray @ wp.vec3(float(column), float(row), 1.0))
    to_body = wp.transpose(rotation)
    hit = wp.mesh_query_ray(mesh, to_body @ (origin - position), to_body @ d, distance[row, column])
    if hit.result:
        normal = rotation @ hit.normal
        if wp.dot(normal, d) > 0.0:
            normal = -normal
        labels[row, column] = label
        distance[row, column] = hit.t
        color_out[row, column] = color * (_AMBIENT + (1.0 - _AMBIENT) * wp.max(0.0, wp.dot(normal, light)))
