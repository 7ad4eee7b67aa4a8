"""Build a clip in Blender: room, light, furniture, bodies and what hangs."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.random import Generator

from tests.benchmarks.video_clips.bodies import Array, Fixture, Vec, vec
from tests.benchmarks.video_clips.clip import Clip

from .engine import Stage, Thing
from .furniture import INDOORS, OUTDOORS, Furniture
from .hand import hand_solid, sleeve_solid, withdrawal
from .motion import Motion
from .place import Room, covers_path, covers_point, far_from_path
from .setting import Setting
from .shaders import paint
from .solids import Solid, box, capsule, cylinder, sheet, smooth_path, sphere, tube
from .surfaces import SKINS, Surface, any_surface, body_surface, floor_surface, shifted, wall_surface, wood

HAND_LABEL = 255
Update = Callable[[int], None]  # reshape what bends for a frame


@dataclass
class Built:
    """Objects built. updates: to call before each frame; shown: pieces of furniture that found room."""

    updates: list[Update] = field(default_factory=list)
    shown: list[str] = field(default_factory=list)
    hand: bool = False


def solid_of(shape: str, size: Vec, bevel: float) -> Solid:
    """Return the solid of a shape of full extents."""
    if shape == "sphere":
        ball = sphere(1.0)
        return Solid(ball.vertices * np.asarray(size), ball.faces)
    if shape == "cylinder":
        return cylinder(size[0], size[2], bevel)
    if shape == "capsule":
        return capsule(size[0], size[2])
    return box(size, bevel)


def _turn(yaw: float) -> Array:
    return np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])


def _put(stage: Stage, name: str, solid: Solid, surface: Surface, pos: Array, quat: Array, label: int = 0) -> Thing:
    thing = stage.add_solid(name, solid, paint(surface, name), label)
    thing.place(np.concatenate([pos, quat]))
    return thing


def build_room(stage: Stage, rng: Generator, clip: Clip, setting: Setting, room: Room) -> None:
    """Build floor (or table), back wall, skirting, rug, cable and marks."""
    look, scene = clip.look, clip.scene
    flat = _turn(room.yaw + float(rng.choice([0.0, 0.0, np.pi / 2, 0.3])))
    surface = floor_surface(
        rng, "concrete" if setting.floor == "felt" else setting.floor, look.floor_rgb, setting.mirror
    )
    if scene.kind == "billiard":
        wide, deep = scene.contents["room_x"] + 0.12, scene.contents["room_y"] + 0.12
        felt = floor_surface(rng, setting.floor, look.floor_rgb, setting.mirror)
        _put(stage, "cover", box((wide, deep, 0.03)), felt, np.array([0, 0, -0.015]), _turn(0.0))
        body = replace(wood(rng), pattern="plain") if look.grey else wood(rng)
        _put(stage, "table", box((wide + 0.04, deep + 0.04, 0.12), 0.01), body, np.array([0, 0, -0.0905]), _turn(0.0))
        for sx, sy in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            at = np.array([sx * (wide / 2 - 0.06), sy * (deep / 2 - 0.06), -0.45])
            _put(stage, "leg", box((0.07, 0.07, 0.66), 0.005), body, at, _turn(0.0))
        _put(stage, "floor", box((24, 24, 0.1)), surface, np.array([0, 0, -0.83]), flat)
    else:
        _put(stage, "floor", box((24, 24, 0.1)), surface, room.centre + np.array([0, 0, -0.05]), flat)
    ground = -0.78 if scene.kind == "billiard" else 0.0
    wall = wall_surface(rng, setting.wall_rgb, look.grey)
    if all(f.name != "board" for f in scene.fixtures):
        _put(stage, "wall", box((14, 0.1, 4.6)), wall, room.at(0, room.back + 0.05, 1.5), _turn(room.yaw))
    if rng.random() < 0.75:
        white = Surface("plain", (0.88, 0.87, 0.85), (0.9, 0.9, 0.9), 0.4)
        base = white if look.grey or rng.random() < 0.6 else wood(rng)
        _put(
            stage,
            "skirting",
            box((13.9, 0.012, 0.042), 0.003),
            base,
            room.at(0, room.back - 0.006, ground + 0.021),
            _turn(room.yaw),
        )
    if setting.rug:
        extents = rng.uniform(0.8, 1.8, 2)
        cloth = replace(floor_surface(rng, "carpet", any_surface(rng, look.grey).rgb, False), bump=1e-3)
        at = room.at(float(rng.normal(0, 0.3)), float(rng.normal(0, 0.2)), -0.0046)
        _put(
            stage,
            "rug",
            box((float(extents[0]), float(extents[1]), 0.01)),
            cloth,
            at,
            _turn(room.yaw + float(rng.normal(0, 0.2))),
        )
    if setting.cable:
        x, y = room.half * float(rng.uniform(-0.8, 0.8)), room.back * float(rng.uniform(0.75, 0.95))
        path = [room.at(x + 0.16 * k, y + float(rng.normal(0, 0.04)), ground + 0.006) for k in range(-9, 10)]
        if not covers_point(clip, np.array(path)) and all(far_from_path(clip, p, 0.02) for p in path):
            dark = Surface("plain", (0.06, 0.06, 0.06), (0.1, 0.1, 0.1), 0.4)
            _put(stage, "cable", tube(smooth_path(np.array(path), 120), 0.009), dark, np.zeros(3), _turn(0.0))
    if look.marks:
        pale = sum(look.floor_rgb) < 1.3 and setting.floor != "wood"
        rgb: Vec = (0.92, 0.92, 0.9) if pale else (0.07, 0.07, 0.08)
        radius = scene.contents.get("mark_radius", 0.012)
        dot = cylinder(2 * radius, 0.0016)
        graph = paint(Surface("plain", rgb, rgb, 0.6), "mark")
        for p, z in zip(scene.marks, scene.mark_facing, strict=True):
            half = np.sqrt(0.5)
            quat = _turn(0.0) if z[2] > 0.5 else np.array([half, half, 0.0, 0.0])
            stage.add_solid("mark", dot, graph).place(np.concatenate([p, quat]))


def build_fixtures(stage: Stage, rng: Generator, clip: Clip, setting: Setting) -> None:
    """Build ramps, tracks, cushions, posts and the board as a wall."""
    for f in clip.scene.fixtures:
        stage_surface = _fixture_surface(rng, f, clip.look.grey)
        if f.name == "board":
            stage_surface = wall_surface(rng, setting.wall_rgb if not clip.look.grey else f.rgb, clip.look.grey)
        bevel = 0.0 if f.name == "board" else min(0.003, 0.15 * min(f.size))
        _put(stage, f.name, solid_of(f.shape, f.size, bevel), stage_surface, np.array(f.pos), np.array(f.quat))


def _fixture_surface(rng: Generator, f: Fixture, grey: bool) -> Surface:
    if f.color == "brown" and not grey:
        return Surface("grain", f.rgb, shifted(f.rgb, -0.35), float(rng.uniform(0.3, 0.6)), scale=6.0)
    metal = f.name in ("stand", "bar", "track") and rng.random() < 0.5
    return Surface("plain", f.rgb, f.rgb, float(rng.uniform(0.25, 0.6)), metallic=float(metal))


def build_furniture(stage: Stage, rng: Generator, clip: Clip, setting: Setting, room: Room) -> list[str]:
    """Put furniture along the wall where it hides no measured point and stands in no path."""
    drawers = OUTDOORS if setting.light == "outdoors" else INDOORS
    shown: list[str] = []
    taken: list[tuple[float, float]] = []
    ground = -0.78 if clip.scene.kind == "billiard" else 0.0
    for _ in range(40 * setting.pieces):
        if len(shown) == setting.pieces:
            break
        item: Furniture = drawers[int(rng.integers(len(drawers)))](rng, clip.look.grey)
        if item.name == "socket" and item.name in shown:
            continue
        x = float(rng.uniform(-1.05, 1.05)) * room.half
        y = room.back if item.hung else room.back - item.size[1] / 2 - float(rng.uniform(0.01, 0.08))
        if any(abs(x - other) < (item.size[0] + wide) / 2 + 0.03 for other, wide in taken):
            continue
        offsets = np.vstack([np.array(p.pos) + s * np.array(p.size) / 2 for p in item.pieces for s in (-1, 1)])
        low, high = offsets.min(axis=0), offsets.max(axis=0)
        corners = np.array(
            [
                room.at(x + a, y + b, ground + c)
                for a in (low[0], high[0])
                for b in (low[1], high[1])
                for c in (low[2], high[2])
            ]
        )
        place = room.at(x, y, ground)
        clear = item.hung or clip.scene.kind == "billiard" or far_from_path(clip, place, 0.5 * max(item.size[:2]))
        if not clear or covers_point(clip, corners) or covers_path(clip, corners):
            continue
        for p in item.pieces:
            at = room.at(x + p.pos[0], y + p.pos[1], ground + p.pos[2])
            _put(stage, item.name, solid_of(p.shape, p.size, p.bevel), p.surface, at, _turn(room.yaw))
        taken.append((x, item.size[0]))
        shown.append(item.name)
    return shown


def build_light(stage: Stage, clip: Clip, setting: Setting, room: Room) -> None:
    """Set sky, lamps, sun and the window through which it shines."""
    camera = clip.cameras[0]
    toward = np.asarray(camera.pos) - room.centre
    azimuth = float(np.arctan2(toward[1], toward[0]))
    stage.set_sky(setting.sky[0], setting.sky[1])
    spread = float(np.linalg.norm(toward[:2]))
    for lamp in setting.lamps:
        a = azimuth + np.radians(lamp.side)
        away = lamp.away * max(1.0, 0.5 * spread) if setting.light == "window" else lamp.away
        pos = room.centre + np.array([away * np.cos(a), away * np.sin(a), lamp.height])
        power = 40.0 * lamp.power * (away**2 + lamp.height**2)
        aim = room.centre if setting.light != "ceiling" else pos * np.array([1, 1, 0]) + 1e-3
        stage.add_area(vec(pos), vec(aim), lamp.size, power, lamp.rgb)
    side, elevation, angle, strength = setting.sun
    if strength == 0:
        return
    a, e = azimuth + np.radians(side), np.radians(elevation)
    flat = np.array([np.cos(a), np.sin(a), 0.0])
    to_sun = np.cos(e) * flat + np.array([0.0, 0.0, np.sin(e)])
    warm: Vec = (1.0, 0.93, 0.82)
    stage.add_sun(vec(to_sun), float(np.radians(angle)), strength, warm)
    if setting.light == "patches":
        _window(stage, room, flat, float(np.tan(e)), vec((0.6, 0.6, 0.6)))


def _window(stage: Stage, room: Room, flat: Array, rise: float, rgb: Vec) -> None:
    """Stand a wall with a barred window, hidden from the camera, between the sun and the scene."""
    away, wide, high = 2.6, 1.5, 1.1
    middle = away * rise
    yaw = float(np.arctan2(flat[1], flat[0])) + np.pi / 2
    along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    graph = paint(Surface("plain", rgb, rgb, 0.9), "window")
    blocks = [
        ((-wide / 2 - 3.0), 0.0, 6.0, 20.0),
        ((wide / 2 + 3.0), 0.0, 6.0, 20.0),
        (0.0, high / 2 + 5.0, wide, 10.0),
        (0.0, -high / 2 - 5.0, wide, 10.0),
        (0.0, 0.0, 0.05, high),
        (0.0, 0.12, wide, 0.04),
    ]
    for x, z, w, h in blocks:
        thing = stage.add_solid("window", box((w, 0.04, h)), graph)
        at = room.centre + away * flat + x * along + np.array([0.0, 0.0, middle + z])
        thing.place(np.concatenate([at, _turn(yaw)]))
        thing.hide_from_camera()


def build_bodies(stage: Stage, rng: Generator, clip: Clip, setting: Setting, motion: Motion) -> None:
    """Build what moves rigidly and give it its motion."""
    steel = Surface("plain", (0.4, 0.4, 0.42), (0.4, 0.4, 0.4), 0.3, metallic=1.0)
    rubber = Surface("plain", (0.08, 0.08, 0.08), (0.1, 0.1, 0.1), 0.7)
    for part in motion.parts:
        body = next((b for b in clip.scene.bodies if b.name == part.name), None)
        surface = steel if part.shape == "capsule" else rubber
        if body is not None:
            metal = setting.metal and rng.random() < 0.7
            surface = body_surface(rng, body.rgb, min(body.size), clip.look.grey, metal)
            if clip.scene.kind == "billiard":
                striped = rng.random() < 0.3
                surface = replace(
                    surface, pattern="stripes" if striped else "plain", metallic=0.0, roughness=0.08, coat=1.0
                )
        bevel = 0.0 if part.shape in ("sphere", "capsule") else float(rng.uniform(0.015, 0.06)) * min(part.size)
        solid = solid_of(part.shape, part.size, bevel)
        thing = stage.add_solid(part.name or "part", solid, paint(surface, part.name or "part"), part.label)
        thing.animate(motion.times, part.poses)


def build_hung(stage: Stage, rng: Generator, clip: Clip, motion: Motion) -> list[Update]:
    """Build rope and cloth; return what reshapes them for a frame."""
    points, scene = clip.run.frame_points, clip.scene
    updates: list[Update] = []
    if points is None:
        return updates
    if scene.rope is not None:
        rope = scene.rope
        twist = Surface("stripes", rope.rgb, shifted(rope.rgb, -0.4), 0.9, scale=float(rng.uniform(25, 50)), uv=True)
        first = tube(smooth_path(points[0]), rope.diameter)
        thing = stage.add_solid("rope", first, paint(twist, "rope"), motion.names.index("rope") + 1)
        updates.append(lambda n: thing.reshape(tube(smooth_path(points[n]), rope.diameter).vertices))
    if scene.cloth is not None:
        cloth = scene.cloth
        pattern = str(rng.choice(["stripes", "checker", "weave", "plain", "noise"]))
        fabric = Surface(pattern, cloth.rgb, shifted(cloth.rgb, float(rng.choice([-0.5, 0.5]))), 0.9, uv=True,
                         scale=float(rng.uniform(8, 25)))  # fmt: skip
        solid = sheet(points[0], cloth.cells, (cloth.width, cloth.height))
        hung = stage.add_solid("cloth", solid, paint(fabric, "cloth"), motion.names.index("cloth") + 1)
        hung.subdivide(2)
        updates.append(lambda n: hung.reshape(points[n]))
    return updates


def build_hand(stage: Stage, rng: Generator, clip: Clip) -> bool:
    """Build the withdrawing hand; return whether there is one."""
    path = withdrawal(rng, clip)
    if path is None:
        return False
    rgb = SKINS[int(rng.integers(len(SKINS)))]
    skin = Surface("noise", rgb, shifted(rgb, -0.08), 0.55, scale=35.0, skin=True)
    hand = stage.add_solid("hand", hand_solid(), paint(skin, "hand"), HAND_LABEL)
    hand.merge(0.006)
    sleeve = any_surface(rng, clip.look.grey)
    fabric = replace(sleeve, pattern="weave", scale=350.0, roughness=0.9)
    arm = stage.add_solid("sleeve", sleeve_solid(), paint(fabric, "sleeve"), HAND_LABEL)
    arm.merge(0.012)
    for thing in (hand, arm):
        thing.animate(path.times, path.poses)
    return True


def build(stage: Stage, rng: Generator, clip: Clip, setting: Setting, motion: Motion, room: Room) -> Built:
    """Build everything."""
    build_room(stage, rng, clip, setting, room)
    build_fixtures(stage, rng, clip, setting)
    built = Built(shown=build_furniture(stage, rng, clip, setting, room))
    build_light(stage, clip, setting, room)
    build_bodies(stage, rng, clip, setting, motion)
    built.updates = build_hung(stage, rng, clip, motion)
    built.hand = setting.hand and build_hand(stage, rng, clip)
    return built
