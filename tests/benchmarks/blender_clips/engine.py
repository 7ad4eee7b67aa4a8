"""Typed wrappers around Blender's Python module, the only file that imports it."""

import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np

from tests.benchmarks.video_clips.bodies import Array, Vec

from .optics import SENSOR_WIDTH, BlenderCamera, quaternion
from .solids import Solid


@contextmanager
def muted() -> Iterator[None]:
    """Silence what Blender prints from C: progress, and that its audio module awaits an older NumPy."""
    sys.stdout.flush()
    kept = os.dup(1), os.dup(2)
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 1)
        os.dup2(nothing.fileno(), 2)
    try:
        yield
    finally:
        for target, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, target)
            os.close(copy)


with muted():
    import bpy


@dataclass(frozen=True)
class Socket:
    """An output of a shader node."""

    socket: Any


Value = float | Sequence[float] | Socket
Place = TypeVar("Place", str, int)  # of an input: its name or number


class Node:
    """A shader node whose outputs are found by name."""

    def __init__(self, node: Any) -> None:
        self.node = node

    def out(self, name: str | int = 0) -> Socket:
        """Return an output by name or place."""
        return Socket(self.node.outputs[name])


class Graph:
    """The shader nodes of one material."""

    def __init__(self, name: str) -> None:
        self.material: Any = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.tree: Any = self.material.node_tree
        self.tree.nodes.clear()

    def add(self, kind: str, inputs: Mapping[Place, Value] | None = None, **settings: str | float | bool) -> Node:
        """Add a node with settings; inputs (by name or place) are constants or outputs of other nodes."""
        node = self.tree.nodes.new(kind)
        for name, value in settings.items():
            setattr(node, name, value)
        if inputs is not None:
            for place, given in inputs.items():
                self._give(node.inputs[place], given)
        return Node(node)

    def _give(self, target: Any, value: Value) -> None:
        if isinstance(value, Socket):
            self.tree.links.new(value.socket, target)
        elif isinstance(value, int | float):
            target.default_value = value
        else:  # a colour needs its opacity
            target.default_value = (*value, 1.0) if len(target.default_value) == 4 and len(value) == 3 else value

    def ramp(self, factor: Socket, low: Vec, high: Vec, start: float = 0.0, end: float = 1.0) -> Socket:
        """Map a factor to colours between two ends."""
        node = self.add("ShaderNodeValToRGB", {"Fac": factor})
        elements = node.node.color_ramp.elements
        for element, place, rgb in zip(elements, (start, end), (low, high), strict=True):
            element.position, element.color = place, (*rgb, 1.0)
        return node.out("Color")

    def finish(self, surface: Socket) -> None:
        """Connect the surface to the material's output."""
        self.add("ShaderNodeOutputMaterial", {"Surface": surface})


class Stage:
    """A Blender scene rendered by Cycles on the processor."""

    def __init__(self, size: tuple[int, int], threads: int) -> None:
        with muted():
            bpy.ops.wm.read_factory_settings(use_empty=True)
        self.scene: Any = bpy.context.scene
        bpy.context.preferences.edit.keyframe_new_interpolation_type = "LINEAR"
        self.scene.render.engine = "CYCLES"
        self.scene.cycles.device = "CPU"
        self.set_size(size)
        render = self.scene.render
        render.threads_mode, render.threads = "FIXED", threads
        render.use_persistent_data = True
        render.use_compositing = render.use_sequencer = False
        render.image_settings.file_format = "PNG"
        render.image_settings.color_mode, render.image_settings.color_depth = "RGB", "8"
        render.image_settings.compression = 0
        cycles = self.scene.cycles
        cycles.use_adaptive_sampling = cycles.use_light_tree = False
        cycles.denoiser, cycles.denoising_quality, cycles.denoising_prefilter = "OPENIMAGEDENOISE", "FAST", "FAST"
        cycles.sampling_pattern, cycles.sample_clamp_indirect = "BLUE_NOISE", 4.0
        cycles.use_fast_gi, cycles.ao_bounces_render = True, 2
        cycles.caustics_reflective = cycles.caustics_refractive = False
        self.file = Path(tempfile.mkdtemp(prefix="blender_clips_")) / "frame.png"
        world = bpy.data.worlds.new("world")
        world.use_nodes = True
        world.cycles.sampling_method = "NONE"
        self.scene.world = world
        camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
        self.scene.collection.objects.link(camera)
        self.scene.camera = camera
        self.camera: Any = camera

    def set_size(self, size: tuple[int, int]) -> None:
        """Set the size of the picture in pixels."""
        self.scene.render.resolution_x, self.scene.render.resolution_y = size
        self.scene.render.resolution_percentage = 100

    def set_sky(self, rgb: Vec, strength: float) -> None:
        """Set the uniform light from everywhere."""
        node = self.scene.world.node_tree.nodes["Background"]
        node.inputs["Color"].default_value = (*rgb, 1.0)
        node.inputs["Strength"].default_value = strength

    def set_film(self, transform: str, contrast: str, exposure: float) -> None:
        """Set the view transform, its look (contrast) and the exposure in stops."""
        view = self.scene.view_settings
        view.view_transform, view.look, view.exposure = transform, contrast, exposure

    def set_quality(self, samples: int, bounces: int, denoise: bool) -> None:
        """Set samples per pixel, the number of reflections and the denoiser."""
        cycles = self.scene.cycles
        cycles.samples, cycles.max_bounces, cycles.use_denoising = samples, bounces, denoise
        cycles.diffuse_bounces = cycles.glossy_bounces = bounces

    def set_shutter(self, share: float) -> None:
        """Open the shutter for a share of the frame time around the frame's time, 0 for no motion blur."""
        self.scene.render.use_motion_blur = share > 0
        self.scene.render.motion_blur_position = "CENTER"
        self.scene.render.motion_blur_shutter = max(share, 0.01)

    def set_camera(self, optics: BlenderCamera, focus: float, fstop: float) -> None:
        """Place the camera; focus: distance in m of what is sharp; fstop: 0 for a pinhole."""
        lens = self.camera.data
        lens.sensor_fit, lens.sensor_width, lens.lens = "HORIZONTAL", SENSOR_WIDTH, optics.lens
        lens.clip_start, lens.clip_end = 0.01, 200.0
        lens.dof.use_dof = fstop > 0
        lens.dof.focus_distance, lens.dof.aperture_fstop = focus, max(fstop, 0.1)
        self.camera.rotation_mode = "QUATERNION"
        self.camera.location = optics.matrix[:3, 3].tolist()
        self.camera.rotation_quaternion = quaternion(optics.matrix[:3, :3]).tolist()

    def add_solid(self, name: str, solid: Solid, graph: Graph, label: int = 0) -> "Thing":
        """Add a mesh with a material. label: number that its pixels bear in the masks."""
        mesh: Any = bpy.data.meshes.new(name)
        mesh.from_pydata(solid.vertices.tolist(), [], solid.faces)
        mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), dtype=bool))
        if solid.uv is not None:
            corners = np.empty(len(mesh.loops), dtype=np.int32)
            mesh.loops.foreach_get("vertex_index", corners)
            layer = mesh.uv_layers.new(name="uv")
            layer.data.foreach_set("uv", solid.uv[corners].astype(np.float32).ravel())
        mesh.materials.append(graph.material)
        mesh.update()
        thing: Any = bpy.data.objects.new(name, mesh)
        thing.pass_index = label
        thing.rotation_mode = "QUATERNION"
        self.scene.collection.objects.link(thing)
        if solid.bevel > 0:
            edge = thing.modifiers.new("edge", "BEVEL")
            edge.width, edge.segments, edge.harden_normals = solid.bevel, 3, True
            edge.limit_method, edge.angle_limit = "ANGLE", np.radians(50)
        return Thing(thing)

    def add_area(self, pos: Vec, toward: Vec, size: tuple[float, float], power: float, rgb: Vec) -> None:
        """Add a rectangular light in W that the camera does not see."""
        light: Any = bpy.data.lights.new("area", "AREA")
        light.shape, light.size, light.size_y = "RECTANGLE", *size
        light.energy, light.color = power, rgb
        self._aim(light, pos, toward)

    def add_sun(self, toward_sun: Vec, angle: float, strength: float, rgb: Vec) -> None:
        """Add a sun of an angular diameter in rad and a strength in W/m^2."""
        light: Any = bpy.data.lights.new("sun", "SUN")
        light.angle, light.energy, light.color = angle, strength, rgb
        self._aim(light, toward_sun, (0.0, 0.0, 0.0))

    def _aim(self, light: Any, pos: Vec, toward: Vec) -> None:
        thing: Any = bpy.data.objects.new(light.name, light)
        back = np.asarray(pos) - np.asarray(toward)
        back /= np.linalg.norm(back)
        right = np.cross([0.0, 0.0, 1.0] if abs(back[2]) < 0.99 else [0.0, 1.0, 0.0], back)
        right /= np.linalg.norm(right)
        thing.rotation_mode = "QUATERNION"
        thing.location = pos
        turn = np.column_stack([right, np.cross(back, right), back])
        thing.rotation_quaternion = quaternion(turn).tolist()
        thing.visible_camera = False
        self.scene.collection.objects.link(thing)

    def label_layer(self) -> None:
        """Switch to flat pictures of labels: one ray through each pixel's centre, colour label / 255."""
        graph = Graph("labels")
        index = graph.add("ShaderNodeObjectInfo").out("Object Index")
        share = graph.add("ShaderNodeMath", {0: index, 1: 255.0}, operation="DIVIDE").out()
        graph.finish(graph.add("ShaderNodeEmission", {"Color": share, "Strength": 1.0}).out())
        self.scene.view_layers[0].material_override = graph.material
        self.set_sky((0.0, 0.0, 0.0), 0.0)
        self.set_quality(1, 0, False)
        self.set_shutter(0.0)
        self.set_film("Raw", "None", 0.0)
        self.scene.render.dither_intensity = 0.0
        self.scene.cycles.pixel_filter_type, self.scene.cycles.filter_width = "BOX", 0.01
        for thing in self.scene.objects:
            if thing.type == "LIGHT":
                thing.hide_render = True

    def picture(self, frame: int, seed: int = 0) -> np.ndarray:
        """Render a frame and return it as (height, width, 3), RGB, 8 bit."""
        self.scene.cycles.seed = seed
        self.scene.frame_set(frame)
        self.scene.render.filepath = str(self.file)
        with muted():
            bpy.ops.render.render(write_still=True)
        seen = cv2.imread(str(self.file), cv2.IMREAD_COLOR)
        if seen is None:
            raise OSError(f"Blender wrote no picture to {self.file}")
        return np.ascontiguousarray(seen[..., ::-1])

    def close(self) -> None:
        """Remove the temporary picture."""
        self.file.unlink(missing_ok=True)
        self.file.parent.rmdir()


class Thing:
    """An object in the scene."""

    def __init__(self, thing: Any) -> None:
        self.thing = thing

    def place(self, pose: Array) -> None:
        """Put the object at a position in m and quaternion w x y z (7)."""
        self.thing.location, self.thing.rotation_quaternion = pose[:3].tolist(), pose[3:].tolist()

    def animate(self, times: Array, poses: Array) -> None:
        """Move the object through poses (n, 7) at times in frames, linearly between them."""
        for time, pose in zip(times, poses, strict=True):
            self.place(pose)
            self.thing.keyframe_insert("location", frame=float(time))
            self.thing.keyframe_insert("rotation_quaternion", frame=float(time))

    def reshape(self, vertices: Array) -> None:
        """Move the vertices (n, 3)."""
        mesh = self.thing.data
        mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
        mesh.update()
        mesh.update_tag()

    def hide_from_camera(self) -> None:
        """Let the object cast shadows without being seen."""
        self.thing.visible_camera = False

    def subdivide(self, levels: int) -> None:
        """Smooth the surface by subdivision, corners kept."""
        smooth = self.thing.modifiers.new("smooth", "SUBSURF")
        smooth.levels = smooth.render_levels = levels
        smooth.boundary_smooth = "PRESERVE_CORNERS"

    def merge(self, voxel: float) -> None:
        """Merge overlapping solids of the mesh into one rounded skin of a voxel size in m."""
        skin = self.thing.modifiers.new("skin", "REMESH")
        skin.mode, skin.voxel_size, skin.use_smooth_shade = "VOXEL", voxel, True
        soft = self.thing.modifiers.new("soft", "SMOOTH")
        soft.factor, soft.iterations = 0.5, 6
