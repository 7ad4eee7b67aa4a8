"""Film a scene with MuJoCo's renderer: camera, calibration points, looks, noise, compression."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.examination_scenes.world import SAMPLE, Array, Run, Scene, Water, row, xml

POINT_TRIES = 2000  # places drawn for the eight calibration points of a picture
SIZES = ((480, 320), (640, 360), (640, 480), (960, 540), (960, 640))
RGB = {
    "red": (0.75, 0.1, 0.1), "blue": (0.12, 0.25, 0.75), "green": (0.1, 0.5, 0.15), "yellow": (0.85, 0.75, 0.1),
    "purple": (0.5, 0.15, 0.6), "cyan": (0.1, 0.65, 0.7), "orange": (0.9, 0.45, 0.08), "gray": (0.45, 0.45, 0.45),
}  # fmt: skip
WATER, WATER_VEIL = (70.0, 120.0, 160.0), 0.35  # colour, opacity
SURFACES = (
    '<material name="metal" specular="0.9" shininess="0.8"/><material name="rubber" specular="0.05"/>'
    '<material name="wood" specular="0.25" shininess="0.3"/>'
)


@dataclass(frozen=True)
class Camera:
    """Hold a pinhole camera: fovy [degrees], axes (right, up) in the world, picture size [px]."""

    position: Array
    right: Array
    up: Array
    fovy: float
    size: tuple[int, int]

    def pixel(self, world: Array) -> Array:
        """Return pixels (..., 2) of places (..., 3); the centre of the first pixel is (0.5, 0.5)."""
        offset = np.asarray(world) - self.position
        back = np.cross(self.right, self.up)
        focal = self.size[1] / 2 / math.tan(math.radians(self.fovy) / 2)
        depth = -offset @ back
        u = self.size[0] / 2 + focal * (offset @ self.right) / depth
        v = self.size[1] / 2 - focal * (offset @ self.up) / depth
        return np.stack([u, v], axis=-1)

    def sees(self, world: Array, margin: float = 0.05) -> NDArray[np.bool_]:
        """Return which places are in the picture, by a margin in parts of its size."""
        part = self.pixel(world) / self.size
        return np.asarray(((part > margin) & (part < 1 - margin)).all(axis=-1))


def draw_camera(rng: np.random.Generator, places: Array, view: str) -> Camera:
    """Return a camera that sees all places (n, 3), from the side (along y), aslant to it, or above."""
    size, fovy = SIZES[rng.integers(len(SIZES))], float(rng.uniform(30, 50))
    low, high = {"side": (0.0, 0.0), "aslant": (0.3, 0.8), "above": (-math.pi, math.pi)}[view]
    turn = float(rng.uniform(low, high)) * rng.choice([-1, 1]) - math.pi / 2
    rise = math.radians(rng.uniform(*{"side": (0, 3), "aslant": (8, 20), "above": (25, 45)}[view]))
    back = np.array([math.cos(turn) * math.cos(rise), math.sin(turn) * math.cos(rise), math.sin(rise)])
    right = np.array([-math.sin(turn), math.cos(turn), 0.0])
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    for far in np.arange(1.0, 12.0, 0.1):
        camera = Camera(middle + far * back, right, np.cross(back, right), fovy, size)
        if camera.sees(places, 0.12).all():
            return Camera(middle + 1.12 * far * back, right, np.cross(back, right), fovy, size)
    raise ValueError("no camera sees all places within 12 m")


def calibration(rng: np.random.Generator, camera: Camera, places: Array) -> list[dict[str, Any]] | None:
    """Return eight points, four on the floor and four above, with pixels to 0.01; None where they find no room."""
    points: list[dict[str, Any]] = []
    low, high = places.min(axis=0) - 0.5, places.max(axis=0) + 0.5
    for _ in range(POINT_TRIES):
        height = 0.0 if len(points) < 4 else rng.uniform(0.2, max(high[2], 0.5))
        world = np.round([*rng.uniform(low[:2], high[:2]), height], 2)
        pixel = camera.pixel(world)
        clear = all(np.linalg.norm(pixel - p["pixel"]) > 0.12 * camera.size[1] for p in points)
        if clear and camera.sees(world, 0.02):
            points.append({"pixel": np.round(pixel, 2).tolist(), "world": world.tolist()})
        if len(points) == 8:
            return points
    return None


def floor_texture(rng: np.random.Generator, side: int = 512) -> NDArray[np.uint8]:
    """Return a floor of one of four kinds: plain, tiles, planks or cloudy stone."""
    base = rng.uniform(90, 190, 3) * 0.5 + rng.uniform(90, 190) * 0.5
    kind, v, u = rng.integers(4), *np.mgrid[:side, :side]
    shade = np.ones((side, side))
    if kind == 1:
        shade += 0.06 * ((u // 128 + v // 128) % 2) - 0.25 * ((u % 128 < 3) | (v % 128 < 3))
    elif kind == 2:
        grain = cv2.GaussianBlur(rng.normal(size=(side, side)), (0, 0), sigmaX=20, sigmaY=1)
        shade += 0.5 * grain + 0.1 * rng.normal(size=8)[v // 64] - 0.2 * (v % 64 < 2)
    elif kind == 3:
        shade += sum(s * 0.08 * cv2.GaussianBlur(rng.normal(size=(side, side)), (0, 0), s) for s in (2, 6, 18))
    return np.clip(base * shade[..., None], 0, 255).astype(np.uint8)


def looks(rng: np.random.Generator, scene: Scene) -> dict[str, str]:
    """Return geom attributes of everything in a scene."""
    result = {"floor": 'material="ground"'}
    for body in scene.named:
        colour, material, _ = body.name.split("_")
        result[body.name] = f'material="{material}" rgba="{row(np.clip(RGB[colour] + rng.normal(0, 0.03, 3), 0, 1))} 1"'
    for fixed in scene.fixed:
        result[fixed.name] = f'material="wood" rgba="{row([rng.uniform(0.4, 0.8)] * 3)} 1"'
    result["rope"] = 'rgba=".75 .65 .45 1"'
    result["cloth"] = f'rgba="{row(rng.uniform(0.5, 0.95, 3))} 1"'
    return result


def film(
    rng: np.random.Generator, scene: Scene, run: Run, camera: Camera, at: list[float], path: Path
) -> NDArray[np.uint8]:
    """Write the clip, and return what its pixels show, labels (T, H, W): 0, or 1 + the place in `shown`.

    at: times of its frames [s].
    """
    width, height = camera.size
    sun = row([*rng.uniform(-2, 2, 2), 4.0])
    setting = (
        f'<light pos="{sun}" dir="{row(-np.array([float(x) for x in sun.split()]))}" directional="true" '
        f'diffuse="{row([rng.uniform(0.45, 0.7)] * 3)}" castshadow="true"/>'
        f'<light pos="0 -4 5" dir="0 0.6 -1" directional="true" diffuse="{row([rng.uniform(0.1, 0.3)] * 3)}" '
        f'castshadow="false"/><camera name="eye" pos="{row(camera.position)}" fovy="{camera.fovy}" '
        f'xyaxes="{row(camera.right)} {row(camera.up)}"/>'
    )
    assets = (
        f'<visual><global offwidth="{2 * width}" offheight="{2 * height}"/><quality shadowsize="2048" offsamples="0"/>'
        '<headlight ambient=".35 .35 .35" diffuse=".15 .15 .15" specular="0 0 0"/></visual><asset>'
        f'{SURFACES}<texture name="ground" type="2d" builtin="flat" width="512" height="512"/><texture type="skybox" '
        f'builtin="gradient" rgb1="{row(rng.uniform(0.5, 0.9, 3))}" rgb2="{row(rng.uniform(0.2, 0.6, 3))}" width="64" '
        'height="64"/><material name="ground" texture="ground" texrepeat="1 1" texuniform="true" specular="0"/></asset>'
    )
    model = mujoco.MjModel.from_xml_string(xml(scene, scene.step, looks(rng, scene), setting, assets))
    number = model.texture("ground").id
    texture = floor_texture(rng).ravel()
    model.tex_data[model.tex_adr[number] : model.tex_adr[number] + texture.size] = texture
    data = mujoco.MjData(model)
    code, rate = cv2.VideoWriter.fourcc(*"mp4v"), (len(at) - 1) / (at[-1] - at[0])
    at_pane = [model.geom(body.name).id for body in scene.bodies]  # no water is before them
    geoms, cloth, labels = (
        labels_of(scene, model),
        ("", *shown(scene)).index("cloth") if "cloth" in shown(scene) else 0,
        [],
    )
    noise, writer = rng.uniform(1.0, 3.0), cv2.VideoWriter(str(path), code, rate, camera.size)
    with mujoco.Renderer(model, 2 * height, 2 * width) as renderer:
        for time in at:
            low = int(time / SAMPLE)
            data.qpos[:] = run.states[low] + (time / SAMPLE - low) * (run.states[low + 1] - run.states[low])
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera="eye")
            picture = cv2.resize(renderer.render(), camera.size, interpolation=cv2.INTER_AREA).astype(float)
            renderer.enable_segmentation_rendering()
            segments = renderer.render()
            renderer.disable_segmentation_rendering()
            labels.append(labelled(segments[::2, ::2], geoms, cloth))
            if scene.water is not None:
                things = segments[..., 0]
                dry = cv2.resize(np.isin(things, at_pane).astype(float), camera.size, interpolation=cv2.INTER_AREA)
                picture = poured(picture, np.asarray(dry, dtype=float), run.filled[low], scene.water, camera)
            picture += rng.normal(0, noise, picture.shape)
            writer.write(np.ascontiguousarray(np.clip(picture, 0, 255).astype(np.uint8)[..., ::-1]))
    writer.release()
    return np.stack(labels)


def shown(scene: Scene) -> tuple[str, ...]:
    """Return the names of what moves in a scene, but for water."""
    soft = () if scene.soft is None else (scene.soft.name,)
    return (*(b.name for b in scene.named), *soft)


def labels_of(scene: Scene, model: mujoco.MjModel) -> NDArray[np.uint8]:
    """Return the label of each geom; the last is of what is no geom."""
    names, labels = shown(scene), np.zeros(model.ngeom + 1, np.uint8)
    for k in range(model.ngeom):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, k) or ""
        name = "rope" if name.startswith("link") else name
        labels[k] = names.index(name) + 1 if name in names else 0
    return labels


def labelled(segments: NDArray[np.int32], geoms: NDArray[np.uint8], cloth: int) -> NDArray[np.uint8]:
    """Return labels (H, W) of ids and types of objects (H, W, 2), as MuJoCo's renderer gives them."""
    number, kind = segments[..., 0], segments[..., 1]
    found = geoms[np.where(kind == int(mujoco.mjtObj.mjOBJ_GEOM), number, -1)]
    return np.where(kind == int(mujoco.mjtObj.mjOBJ_FLEX), cloth, found).astype(np.uint8)


def poured(picture: Array, dry: Array, filled: Array, water: Water, camera: Camera) -> Array:
    """Return a picture (height, width, 3) with water (nx, nz) behind a tank's front pane, not where it is dry."""
    (long, deep, tall), fine = water.size, 12
    fill = np.pad(filled, 1, mode="edge").T[::-1]  # rows downwards
    wide = cv2.resize(fill, None, fx=fine, fy=fine, interpolation=cv2.INTER_CUBIC)[fine:-fine, fine:-fine]
    inside = np.clip((wide - 0.5) * 6 + 0.5, 0, 1)
    rim = np.clip(1 - np.abs(wide - 0.6) * 5, 0, 1)
    pane = np.array([[x, -deep / 2, z] for x, z in ((0, tall), (long, tall), (long, 0), (0, 0))])
    height, width = inside.shape
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]])
    warp = cv2.getPerspectiveTransform(corners.astype(np.float32), camera.pixel(pane).astype(np.float32))
    size = picture.shape[1], picture.shape[0]
    veil, edge = (cv2.warpPerspective(x, warp, size, flags=cv2.INTER_AREA) for x in (inside, rim))
    veil, edge = (x[..., None] * (1 - dry[..., None]) for x in (veil, edge))
    tinted = picture + WATER_VEIL * veil * (np.array(WATER) - picture)
    return np.asarray(tinted + 0.25 * edge * (235.0 - tinted))
