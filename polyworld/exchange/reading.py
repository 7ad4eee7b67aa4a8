"""Which reader a file takes, and how it gets at the files that it names."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

from polyworld.world import World

READERS = {
    ".xml": "MJCF",
    ".mjcf": "MJCF",
    ".urdf": "URDF",
    ".usd": "USD",
    ".usda": "USD",
    ".usdc": "USD",
    ".usdz": "USD",
}
EXTRA = "pip install 'atw-mcp[importers]'"
MOST_ELEMENTS = 20_000  # of an XML file, those that it multiplies counted: MuJoCo compiles as many in some seconds


@dataclass(frozen=True)
class Imported:
    """A world read from a file, and a sentence for everything of the file that it does not hold, or holds otherwise."""

    world: World
    left_out: tuple[str, ...]


def import_world(
    path: str | Path,
    *,
    keyframe: str | int | None = None,
    floating: bool = False,
    read: Callable[[Path], bytes] | None = None,
) -> Imported:
    """Read a file of MJCF, URDF or USD as a world, with a list of what it does not hold.

    keyframe: name or number of an MJCF file's keyframe to start from; default: the model's own pose, at rest.
    floating: whether the root link of a URDF file is free, not fixed to the world. read:
    reads the files that the file names (meshes, included files); default: from where they lie. Raises ValueError for
    what cannot be read or has no counterpart, ImportError naming the extra where the reader is not installed.
    """
    path = Path(path)
    kind = READERS.get(path.suffix.lower())
    if kind is None:
        raise ValueError(f"{path.name} is no file that can be read: endings are {', '.join(READERS)}")
    if keyframe is not None and kind != "MJCF":
        raise ValueError(f"{path.name} is {kind}, which has no keyframes")
    if floating and kind != "URDF":
        raise ValueError(f"{path.name} is {kind}, which says itself what is fixed to the world: leave `floating` out")
    if kind == "USD":
        from polyworld.exchange.usd import world_of_stage

        if read is None:
            return world_of_stage(path)
        with TemporaryDirectory() as folder:
            alone = Path(folder) / path.name
            alone.write_bytes(read(path))
            return world_of_stage(alone, alone=True)
    return _by_mujoco(path, kind, keyframe, floating, read)


def needed(module: str, what: str) -> ModuleType:
    """Import a module of the extra; ImportError that names it where it is not installed."""
    from importlib import import_module

    try:
        return import_module(module)
    except ImportError as error:
        raise ImportError(f"{what} needs {module.split('.')[0]}, which is not installed: {EXTRA}") from error


def _by_mujoco(
    path: Path, kind: str, keyframe: str | int | None, floating: bool, read: Callable[[Path], bytes] | None
) -> Imported:
    mujoco: Any = needed("mujoco", f"reading {kind}")
    from polyworld.exchange.mujoco_model import world_of_model

    try:
        text = (path.read_bytes() if read is None else read(path)).decode()
        _check_elements(text)
        if read is not None:
            spec = _alone(mujoco, text, path.parent, floating, read)
        elif floating:
            spec = mujoco.MjSpec.from_string(_freed(text))
            spec.modelfiledir = str(path.parent)
        else:
            spec = mujoco.MjSpec.from_file(str(path))
        model = spec.compile()
    except (ValueError, ET.ParseError) as error:
        raise ValueError(f"{path.name} is not read by MuJoCo: {error}") from error
    data = mujoco.MjData(model)
    if keyframe is not None:
        mujoco.mj_resetDataKeyframe(model, data, _keyframe(mujoco, model, keyframe))
    moved = _within_limits(mujoco, model, data)
    mujoco.mj_forward(model, data)
    found = world_of_model(model, data)
    found = Imported(found.world, (*moved, *found.left_out))
    if kind == "URDF" and not floating:
        found = Imported(found.world, ("the root link is fixed to the world; `floating` frees it", *found.left_out))
    return found


def _within_limits(mujoco: Any, model: Any, data: Any) -> list[str]:
    """Move joints that start outside their limits to the nearer one, and say so: stops here do not push back."""
    moved = []
    single = [int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)]
    for joint in range(model.njnt):
        if model.jnt_limited[joint] and int(model.jnt_type[joint]) in single:
            at = int(model.jnt_qposadr[joint])
            now, (lower, upper) = float(data.qpos[at]), (float(v) for v in model.jnt_range[joint])
            if not lower <= now <= upper:
                data.qpos[at] = min(max(now, lower), upper)
                name = model.joint(joint).name or f"joint{joint}"
                moved.append(
                    f"joint {name} starts at its limit {data.qpos[at]:.4g} instead of {now:.4g} beyond it; a keyframe "
                    "may start it elsewhere"
                )
    return moved


def _freed(text: str) -> str:
    """URDF whose root link hangs on a link more, by a joint that leaves it free."""
    robot = ET.fromstring(text)
    held = {child.get("link") for child in robot.findall("joint/child")}
    roots = [link.get("name", "") for link in robot.findall("link") if link.get("name") not in held]
    if len(roots) != 1:
        raise ValueError(f"it has {len(roots)} root links, {roots}, of which there must be one")
    ET.SubElement(robot, "link", name="world-of-the-root")
    joint = ET.SubElement(robot, "joint", name="freedom-of-the-root", type="floating")
    ET.SubElement(joint, "parent", link="world-of-the-root")
    ET.SubElement(joint, "child", link=roots[0])
    return ET.tostring(robot, encoding="unicode")


def _check_elements(text: str) -> None:
    """Raise ValueError where a file makes more elements than MuJoCo should compile, before it begins."""
    count, found = 0, [(ET.fromstring(text), 1)]
    while found:
        element, times = found.pop()
        count += times
        if element.tag in ("replicate", "composite", "flexcomp"):
            times *= max(1, prod(int(float(n)) for n in element.get("count", "1").split()))
            count += times  # they take their time even where there is nothing in them
        if count > MOST_ELEMENTS:
            raise ValueError(f"it makes more than {MOST_ELEMENTS:,} elements, those that it multiplies counted")
        found += [(child, times) for child in element]


def _alone(mujoco: Any, text: str, parent: Path, floating: bool, read: Callable[[Path], bytes]) -> Any:
    """A spec of a file's text that gets at no other file but through `read`."""
    # Of what names a file, meshes and height fields are read here, textures are not needed.
    named = {e.tag for e in ET.fromstring(text).iter() if "file" in e.attrib} - {"mesh", "hfield", "texture"}
    if named:
        raise ValueError(f"it names other files in {sorted(named)}: write them into one, as MuJoCo's `compile` does")
    spec = mujoco.MjSpec.from_string(_freed(text) if floating else text)
    assets: dict[str, bytes] = {}
    for folder, parts in ((spec.meshdir, spec.meshes), (spec.meshdir, spec.hfields)):
        for part in parts:
            if part.file:
                part.file = Path(part.file).name if spec.strippath else part.file
                assets[str(Path(folder) / part.file) if folder else part.file] = read(parent / folder / part.file)
    for texture in list(spec.textures):  # looks are colours here
        spec.delete(texture)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    spec.assets = assets
    return spec


def _keyframe(mujoco: Any, model: Any, keyframe: str | int) -> int:
    number: int = keyframe if isinstance(keyframe, int) else -1
    if isinstance(keyframe, str):
        number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, keyframe)
    if not 0 <= number < model.nkey:
        there = [model.key(k).name or k for k in range(model.nkey)]
        raise ValueError(f"there is no keyframe {keyframe!r}; keyframes: {there}")
    return number
