"""Drawing what has many small pieces: triangles of cloth and soft bodies, tubes of ropes, balls of fluids.

Each kernel runs over the pieces, and each piece over the pixels of its own rectangle: Warp's CPU launches are
serial, so that no two pieces write to a pixel at once. Rays as in `raycast`. float32.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

_AMBIENT = 0.35
_EDGE = 1.0e-4  # slack of barycentric coordinates, so that no ray slips between two triangles
_BACK = 0.82  # brightness of the back of a sheet


@wp.func
def _ray(pixel_to_ray: wp.mat33, column: int, row: int) -> wp.vec3:
    return wp.normalize(pixel_to_ray @ wp.vec3(float(column), float(row), 1.0))


@wp.kernel
def draw_triangles(
    # camera
    pixel_to_ray: wp.mat33,
    # mesh, vertices relative to the camera
    vertices: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    triangles: wp.array2d[int],
    rectangle: wp.array[wp.vec4i],
    tint: wp.array[float],
    color: wp.vec3,
    label: int,
    # light
    light: wp.vec3,
    # in and out
    labels: wp.array2d[int],
    distance: wp.array2d[float],
    color_out: wp.array2d[wp.vec3],
) -> None:
    """Triangles with smooth normals, seen from both sides, over what is farther away."""
    t = wp.tid()
    a = vertices[triangles[t, 0]]
    ab = vertices[triangles[t, 1]] - a
    ac = vertices[triangles[t, 2]] - a
    r = rectangle[t]
    for row in range(r[2], r[3] + 1):
        for column in range(r[0], r[1] + 1):
            d = _ray(pixel_to_ray, column, row)
            # Moeller and Trumbore: the ray from the camera, d s = a + u ab + v ac
            p = wp.cross(d, ac)
            det = wp.dot(ab, p)
            if wp.abs(det) > 1.0e-20:
                u = -wp.dot(a, p) / det
                q = wp.cross(-a, ab)
                v = wp.dot(d, q) / det
                s = wp.dot(ac, q) / det
                if u >= -_EDGE and v >= -_EDGE and u + v <= 1.0 + _EDGE and s > 0.0 and s < distance[row, column]:
                    n = wp.normalize(
                        (1.0 - u - v) * normals[triangles[t, 0]]
                        + u * normals[triangles[t, 1]]
                        + v * normals[triangles[t, 2]]
                    )
                    face = wp.cross(ab, ac)
                    brightness = tint[t]
                    if wp.dot(face, d) > 0.0:
                        n = -n
                        brightness = brightness * _BACK
                    labels[row, column] = label
                    distance[row, column] = s
                    color_out[row, column] = (
                        color * brightness * (_AMBIENT + (1.0 - _AMBIENT) * wp.max(0.0, wp.dot(n, light)))
                    )


@wp.kernel
def draw_tubes(
    # camera
    pixel_to_ray: wp.mat33,
    # segments, ends relative to the camera
    start: wp.array[wp.vec3],
    end: wp.array[wp.vec3],
    radius: wp.array[float],
    rectangle: wp.array[wp.vec4i],
    tint: wp.array[float],
    color: wp.vec3,
    label: int,
    # light
    light: wp.vec3,
    # in and out
    labels: wp.array2d[int],
    distance: wp.array2d[float],
    color_out: wp.array2d[wp.vec3],
) -> None:
    """Cylinders with round ends, over what is farther away."""
    i = wp.tid()
    a = start[i]
    axis = end[i] - a
    length = wp.length(axis)
    axis = axis / wp.max(length, 1.0e-9)
    rr = radius[i] * radius[i]
    r = rectangle[i]
    for row in range(r[2], r[3] + 1):
        for column in range(r[0], r[1] + 1):
            d = _ray(pixel_to_ray, column, row)
            # From the point of the ray nearest to the segment's start: small numbers keep float32 exact enough.
            reach = wp.dot(a, d)
            o = d * reach - a
            best = 1.0e30
            along = 0.0
            across = d - axis * wp.dot(d, axis)
            away = o - axis * wp.dot(o, axis)
            aa = wp.dot(across, across)
            if aa > 1.0e-12:
                middle = -wp.dot(away, across) / aa
                closest = away + across * middle
                inside = rr - wp.dot(closest, closest)
                if inside >= 0.0:
                    s = middle - wp.sqrt(inside / aa)
                    z = wp.dot(o + d * s, axis)
                    if z >= 0.0 and z <= length:
                        best = s
                        along = z
            for tip in range(2):
                shift = o - axis * (length * float(tip))
                middle = -wp.dot(shift, d)
                closest = shift + d * middle
                inside = rr - wp.dot(closest, closest)
                if inside >= 0.0:
                    s = middle - wp.sqrt(inside)
                    if s < best:
                        best = s
                        along = length * float(tip)
            s = best + reach
            if best < 1.0e29 and s > 0.0 and s < distance[row, column]:
                n = wp.normalize(o + d * best - axis * along)
                labels[row, column] = label
                distance[row, column] = s
                color_out[row, column] = color * tint[i] * (_AMBIENT + (1.0 - _AMBIENT) * wp.max(0.0, wp.dot(n, light)))


@wp.kernel
def splat_balls(
    # camera
    pixel_to_ray: wp.mat33,
    # balls, centres relative to the camera
    centre: wp.array[wp.vec3],
    radius: float,
    rectangle: wp.array[wp.vec4i],
    index: int,
    # in and out
    distance: wp.array2d[float],
    thickness: wp.array2d[float],
    nearest: wp.array2d[int],
) -> None:
    """The nearest ball of a fluid in each pixel, and how much of the ray lies in balls [m]."""
    i = wp.tid()
    c = centre[i]
    r = rectangle[i]
    for row in range(r[2], r[3] + 1):
        for column in range(r[0], r[1] + 1):
            d = _ray(pixel_to_ray, column, row)
            along = wp.dot(c, d)
            closest = c - d * along
            inside = radius * radius - wp.dot(closest, closest)
            if inside > 0.0 and along > 0.0:
                half = wp.sqrt(inside)
                thickness[row, column] = thickness[row, column] + 2.0 * half
                if along - half < distance[row, column]:
                    distance[row, column] = along - half
                    nearest[row, column] = index
