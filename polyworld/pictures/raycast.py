"""Ray casting: one kernel over the pixels, each ray against triangles, rods and floors.

All places are relative to the camera's centre, in world axes, float32: at a distance of 10 m a hit is good to some
10 um. Triangles are met through Warp's mesh query. Spheres, capsules, cylinders and ropes are rods, met exactly:
a tessellation fine enough for outlines correct to a pixel would need more triangles than all else.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

_FAR = 1.0e30
_AMBIENT = 0.35
_BACK = 0.82  # brightness of the back of a sheet
_TILE_CONTRAST = 0.06


@wp.struct
class Scene:
    """Triangles of one mesh with normals at their vertices, rods in one bounding-volume hierarchy, and floors."""

    mesh: wp.uint64
    indices: wp.array2d[int]
    normals: wp.array[wp.vec3]
    triangle_label: wp.array[int]
    triangle_color: wp.array[wp.vec3]
    rods: wp.uint64
    start: wp.array[wp.vec3]
    end: wp.array[wp.vec3]
    radius: wp.array[float]
    flat: wp.array[int]
    rod_label: wp.array[int]
    rod_color: wp.array[wp.vec3]
    floor_point: wp.array[wp.vec3]
    floor_axes: wp.array[wp.mat33]
    floor_label: wp.array[int]
    floor_color: wp.array[wp.vec3]


@wp.func
def _rod(d: wp.vec3, start: wp.vec3, end: wp.vec3, radius: float, flat: int) -> wp.vec4:
    """Distance along the unit ray and normal where it meets a cylinder with round or flat ends; a negative distance
    is a miss, as of a ray that starts inside."""
    axis = end - start
    length = wp.length(axis)
    axis = axis / wp.max(length, 1.0e-9)
    # From the point of the ray nearest to the start: small numbers keep float32 exact enough.
    reach = wp.dot(start, d)
    o = d * reach - start
    rr = radius * radius
    slope = wp.dot(d, axis)
    best = float(_FAR)
    normal = wp.vec3(0.0, 0.0, 0.0)
    across = d - axis * slope
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
                normal = o + d * s - axis * z
    for tip in range(2):
        shift = o - axis * (length * float(tip))
        if flat > 0:
            outward = axis * (2.0 * float(tip) - 1.0)
            speed = wp.dot(outward, d)
            if speed < -1.0e-9:
                s = -wp.dot(shift, outward) / speed
                place = shift + d * s
                if s < best and wp.dot(place, place) <= rr:
                    best = s
                    normal = outward
        else:
            middle = -wp.dot(shift, d)
            closest = shift + d * middle
            inside = rr - wp.dot(closest, closest)
            if inside >= 0.0:
                s = middle - wp.sqrt(inside)
                if s < best:
                    best = s
                    normal = shift + d * s
    if best >= _FAR:
        return wp.vec4(-1.0, 0.0, 0.0, 0.0)
    normal = wp.normalize(normal)
    return wp.vec4(best + reach, normal[0], normal[1], normal[2])


@wp.func
def _tiled(place: wp.vec3, tile: float) -> float:
    """Brightness of a chequered floor: without it a plane shows neither scale nor motion."""
    cell = wp.floor(place[0] / tile) + wp.floor(place[1] / tile) + wp.floor(place[2] / tile + 0.5)
    return 1.0 - _TILE_CONTRAST * (cell - 2.0 * wp.floor(cell / 2.0))


@wp.kernel
def cast(
    scene: Scene,
    # view
    pixel_to_ray: wp.mat33,
    light: wp.vec3,
    background: wp.vec3,
    tile: float,
    # out
    labels_out: wp.array2d[int],
    depth_out: wp.array2d[float],
    normals_out: wp.array2d[wp.vec3],
    color_out: wp.array2d[wp.vec3],
) -> None:
    """Nearest thing along the ray of each pixel: label, depth along the camera's axis, normal and shaded colour."""
    row, column = wp.tid()
    ray = pixel_to_ray @ wp.vec3(float(column), float(row), 1.0)
    d = wp.normalize(ray)
    nearest = float(_FAR)
    label = wp.int32(-1)
    normal = wp.vec3(0.0, 0.0, 0.0)
    color = background
    for i in range(scene.floor_label.shape[0]):
        up = scene.floor_axes[i][2]
        speed = wp.dot(up, d)
        distance = wp.dot(up, scene.floor_point[i]) / speed
        if speed < -1.0e-9 and distance > 0.0 and distance < nearest:
            nearest = distance
            label = scene.floor_label[i]
            normal = up
            color = scene.floor_color[i] * _tiled(scene.floor_axes[i] @ (d * distance - scene.floor_point[i]), tile)
    if scene.rod_label.shape[0] > 0:
        query = wp.bvh_query_ray(scene.rods, wp.vec3(0.0, 0.0, 0.0), d)
        i = wp.int32(0)
        while wp.bvh_query_next(query, i, nearest):
            met = _rod(d, scene.start[i], scene.end[i], scene.radius[i], scene.flat[i])
            if met[0] > 0.0 and met[0] < nearest:
                nearest = met[0]
                label = scene.rod_label[i]
                normal = wp.vec3(met[1], met[2], met[3])
                color = scene.rod_color[i]
    if scene.triangle_label.shape[0] > 0:
        hit = wp.mesh_query_ray(scene.mesh, wp.vec3(0.0, 0.0, 0.0), d, nearest)
        if hit.result:
            nearest = hit.t
            label = scene.triangle_label[hit.face]
            color = scene.triangle_color[hit.face]
            normal = wp.normalize(
                hit.u * scene.normals[scene.indices[hit.face, 0]]
                + hit.v * scene.normals[scene.indices[hit.face, 1]]
                + (1.0 - hit.u - hit.v) * scene.normals[scene.indices[hit.face, 2]]
            )
            if wp.dot(hit.normal, d) > 0.0:
                normal = -normal
                color = color * _BACK
    labels_out[row, column] = label
    normals_out[row, column] = normal
    if label >= 0:
        depth_out[row, column] = nearest / wp.length(ray)
        color_out[row, column] = color * (_AMBIENT + (1.0 - _AMBIENT) * wp.max(0.0, wp.dot(normal, light)))
    else:
        depth_out[row, column] = wp.inf
        color_out[row, column] = background
