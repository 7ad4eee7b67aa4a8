"""Exact ray casting: one kernel over the pixels, each ray against every shape whose rectangle holds the pixel.

Rays are given in world axes from the camera centre; shapes in their own axes. A hit is a vec4
(distance along the unit ray [m], surface normal); a negative distance is a miss. A ray that starts
inside a solid misses it. float32: at a camera distance of 10 m a distance is good to some 10 um.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

SPHERE = 0
BOX = 1
CYLINDER = 2
CAPSULE = 3
CONVEX = 4
PLANE = 5

_FAR = 1.0e30
_AMBIENT = 0.35
_TILE_CONTRAST = 0.06


@wp.func
def _miss() -> wp.vec4:
    return wp.vec4(-1.0, 0.0, 0.0, 0.0)


@wp.func
def _sphere(o: wp.vec3, d: wp.vec3, radius: float) -> wp.vec4:
    # Distance of the centre from the ray first: stable in float32 where b^2 - c cancels.
    along = -wp.dot(o, d)
    nearest = o + d * along
    inside = radius * radius - wp.dot(nearest, nearest)
    if inside < 0.0 or along <= 0.0:
        return _miss()
    distance = along - wp.sqrt(inside)
    if distance <= 0.0:
        return _miss()
    normal = (o + d * distance) / radius
    return wp.vec4(distance, normal[0], normal[1], normal[2])


@wp.func
def _box(o: wp.vec3, d: wp.vec3, half: wp.vec3) -> wp.vec4:
    enter = float(-_FAR)
    leave = float(_FAR)
    face = wp.int32(0)
    for axis in range(3):
        if wp.abs(d[axis]) < 1.0e-9:
            if wp.abs(o[axis]) > half[axis]:
                return _miss()
        else:
            near = (-wp.sign(d[axis]) * half[axis] - o[axis]) / d[axis]
            far = (wp.sign(d[axis]) * half[axis] - o[axis]) / d[axis]
            if near > enter:
                enter = near
                face = axis
            leave = wp.min(leave, far)
    if enter > leave or enter <= 0.0:
        return _miss()
    hit = wp.vec4(enter, 0.0, 0.0, 0.0)
    hit[face + 1] = -wp.sign(d[face])
    return hit


@wp.func
def _tube(o: wp.vec3, d: wp.vec3, radius: float, half_height: float) -> wp.vec4:
    """The side of a cylinder about z, without its ends."""
    across = d[0] * d[0] + d[1] * d[1]
    if across < 1.0e-12:
        return _miss()
    along = -(o[0] * d[0] + o[1] * d[1]) / across
    x = o[0] + d[0] * along
    y = o[1] + d[1] * along
    inside = radius * radius - x * x - y * y
    if inside < 0.0:
        return _miss()
    distance = along - wp.sqrt(inside / across)
    z = o[2] + d[2] * distance
    if distance <= 0.0 or wp.abs(z) > half_height:
        return _miss()
    return wp.vec4(distance, (o[0] + d[0] * distance) / radius, (o[1] + d[1] * distance) / radius, 0.0)


@wp.func
def _cylinder(o: wp.vec3, d: wp.vec3, radius: float, half_height: float) -> wp.vec4:
    if wp.abs(d[2]) > 1.0e-9:
        end = -wp.sign(d[2])
        distance = (end * half_height - o[2]) / d[2]
        x = o[0] + d[0] * distance
        y = o[1] + d[1] * distance
        if distance > 0.0 and x * x + y * y <= radius * radius:
            return wp.vec4(distance, 0.0, 0.0, end)
    return _tube(o, d, radius, half_height)


@wp.func
def _capsule(o: wp.vec3, d: wp.vec3, radius: float, half_height: float) -> wp.vec4:
    best = _tube(o, d, radius, half_height)
    for end in range(2):
        centre = wp.vec3(0.0, 0.0, half_height * (2.0 * float(end) - 1.0))
        hit = _sphere(o - centre, d, radius)
        if hit[0] > 0.0 and (best[0] < 0.0 or hit[0] < best[0]):
            best = hit
    return best


@wp.func
def _convex(o: wp.vec3, d: wp.vec3, faces: wp.array[wp.vec4], first: int, count: int) -> wp.vec4:
    """Intersection of half spaces normal . p <= offset, stored as (normal, offset)."""
    enter = float(-_FAR)
    leave = float(_FAR)
    nearest = wp.int32(0)
    for i in range(first, first + count):
        face = faces[i]
        normal = wp.vec3(face[0], face[1], face[2])
        speed = wp.dot(normal, d)
        gap = face[3] - wp.dot(normal, o)
        if wp.abs(speed) < 1.0e-9:
            if gap < 0.0:
                return _miss()
        elif speed < 0.0:
            if gap / speed > enter:
                enter = gap / speed
                nearest = i
        else:
            leave = wp.min(leave, gap / speed)
    if enter > leave or enter <= 0.0:
        return _miss()
    face = faces[nearest]
    return wp.vec4(enter, face[0], face[1], face[2])


@wp.func
def _plane(o: wp.vec3, d: wp.vec3, normal: wp.vec3, offset: float) -> wp.vec4:
    speed = wp.dot(normal, d)
    if speed > -1.0e-9:
        return _miss()
    distance = (offset - wp.dot(normal, o)) / speed
    if distance <= 0.0:
        return _miss()
    return wp.vec4(distance, normal[0], normal[1], normal[2])


@wp.func
def _shaded(color: wp.vec3, normal: wp.vec3, light: wp.vec3) -> wp.vec3:
    return color * (_AMBIENT + (1.0 - _AMBIENT) * wp.max(0.0, wp.dot(normal, light)))


@wp.func
def _tiled(point: wp.vec3, tile: float) -> float:
    """Brightness of a chequered surface: without it a plane shows neither scale nor motion."""
    cell = wp.floor(point[0] / tile) + wp.floor(point[1] / tile) + wp.floor(point[2] / tile + 0.5)
    return 1.0 - _TILE_CONTRAST * (cell - 2.0 * wp.floor(cell / 2.0))


@wp.kernel
def cast(
    # camera
    origin: wp.vec3,
    pixel_to_ray: wp.mat33,
    # shapes
    label_of: wp.array[int],
    kind: wp.array[int],
    position: wp.array[wp.vec3],
    rotation: wp.array[wp.mat33],
    size: wp.array[wp.vec3],
    face_first: wp.array[int],
    face_count: wp.array[int],
    faces: wp.array[wp.vec4],
    color: wp.array[wp.vec3],
    rectangle: wp.array[wp.vec4i],
    # light
    light: wp.vec3,
    tile: float,
    # out
    labels_out: wp.array2d[int],
    distance_out: wp.array2d[float],
    color_out: wp.array2d[wp.vec3],
) -> None:
    """Nearest shape along the ray of each pixel: label, distance and shaded colour."""
    row, column = wp.tid()
    d = wp.normalize(pixel_to_ray @ wp.vec3(float(column), float(row), 1.0))
    nearest = distance_out[row, column]
    found = wp.int32(-1)
    normal = wp.vec3(0.0, 0.0, 0.0)
    for i in range(kind.shape[0]):
        r = rectangle[i]
        if column >= r[0] and column <= r[1] and row >= r[2] and row <= r[3]:
            to_body = wp.transpose(rotation[i])
            o = to_body @ (origin - position[i])
            ray = to_body @ d
            s = size[i]
            hit = _miss()
            if kind[i] == SPHERE:
                hit = _sphere(o, ray, s[0])
            elif kind[i] == BOX:
                hit = _box(o, ray, s)
            elif kind[i] == CYLINDER:
                hit = _cylinder(o, ray, s[0], s[1])
            elif kind[i] == CAPSULE:
                hit = _capsule(o, ray, s[0], s[1])
            elif kind[i] == CONVEX:
                hit = _convex(o, ray, faces, face_first[i], face_count[i])
            elif kind[i] == PLANE:
                hit = _plane(o, ray, wp.vec3(0.0, 0.0, 1.0), 0.0)
            if hit[0] > 0.0 and hit[0] < nearest:
                nearest = hit[0]
                found = i
                normal = rotation[i] @ wp.vec3(hit[1], hit[2], hit[3])
    if found >= 0:
        surface = color[found]
        if kind[found] == PLANE:
            surface = surface * _tiled(wp.transpose(rotation[found]) @ (origin + d * nearest - position[found]), tile)
        labels_out[row, column] = label_of[found]
        distance_out[row, column] = nearest
        color_out[row, column] = _shaded(surface, normal, light)
