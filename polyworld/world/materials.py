"""Registry of deformable materials: one entry holds all that the engine knows of a material.

The materials of `BUILT_IN` are found in `polyworld.materials`, a module each, and imported when a world first has them;
others join by `register`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from polyworld.world.description import Description
from polyworld.world.parameter_tables import SHIFT, SPIN, VELOCITY, ParameterSpec

if TYPE_CHECKING:
    from polyworld.model.mesh import DeformableMesh
    from polyworld.pictures.deformable_pictures import View
    from polyworld.pictures.scene import Rods, Surface
    from polyworld.solver.coupled.stage import MaterialStage
    from polyworld.world.world import World

Form = Literal["line", "sheet", "solid", "liquid"]
PLANAR = "_planar"  # ends the representation of what moves in the motion plane
BUILT_IN = ("rope", "cloth", "soft", "fluid")
MEASURES: dict[Form, tuple[str, str]] = {
    "line": ("length", "m"),
    "sheet": ("area", "m^2"),
    "solid": ("volume", "m^3"),
    "liquid": ("volume", "m^3"),
}
"""Name of the `measure` of a mesh of each form, and its unit."""

Place = Callable[[Any], tuple[float, float, float]]


@dataclass(frozen=True)
class Material:
    """One deformable material.

    kind: its representation; with `_planar` behind it, that of objects which move in the motion plane.
    description: the class of such objects in a world.
    form: what readouts, contacts and pictures make of it: a line of nodes, a sheet or solid of elements between nodes
    that keep their neighbours, or a liquid, whose particles do not.
    density: the parameter that makes a mesh's `measure` a mass.
    parameters: numbers that a fit may vary, by field of the description; fitted: those that it varies by default.
    planar: whether there are such objects in the motion plane, too.
    turns: whether it starts with an orientation and an angular velocity of its own.
    mesh: (world, item) -> its nodes and elements.
    stage: (world, items, first node by name, number of worlds) -> its part of the coupled solver; None for liquids,
    which `polyworld.solver.fluid` moves.
    kernels: package whose kernels are compiled before the first step; None to compile them as they are launched.
    moved: changes the description of an item, as a dictionary, so that its start is moved: `place` maps points, `turn`
    (4,) is the rotation in it (w, x, y, z), or None.
    picture: (world, item, mesh, points, view) -> the form that shows it with its points at (k, 3) [m]; None to show the
    triangles of its mesh.
    facts: (world, item, mesh) -> what an inspection adds to size, mass and counts.
    size: (world, item, mesh) -> length, area or volume without forces.
    reach: (world, item, mesh) -> points (k, 3) that span where it starts [m].
    notes: (world, item, mesh) -> what of its mesh or start is doubtful, and the number that cures it.
    stored: (world, item, mesh) -> elastic energy at its start, or somewhat more [J].
    color: of objects whose appearance names none; None for one of the palette. opacity: in plan views, 0 to 1.
    """

    kind: str
    description: type[Description]
    form: Form
    density: str
    parameters: Mapping[str, ParameterSpec]
    fitted: tuple[str, ...]
    mesh: Callable[[World, Any], DeformableMesh]
    moved: Callable[[dict[str, Any], Place, Any], None]
    stage: Callable[[World, Sequence[Any], dict[str, int], int], MaterialStage] | None = None
    kernels: str | None = None
    planar: bool = True
    turns: bool = False
    picture: Callable[[World, Any, DeformableMesh, Any, View], Surface | Rods] | None = None
    facts: Callable[[World, Any, DeformableMesh], dict[str, Any]] = lambda _world, _item, _mesh: {}
    size: Callable[[World, Any, DeformableMesh], float] = lambda _world, _item, mesh: float(mesh.measure.sum())
    reach: Callable[[World, Any, DeformableMesh], Any] = lambda _world, _item, mesh: mesh.nodes
    notes: Callable[[World, Any, DeformableMesh], list[str]] = lambda _world, _item, _mesh: []
    stored: Callable[[World, Any, DeformableMesh], float] = lambda _world, _item, _mesh: 0.0
    color: str | None = None
    opacity: float = 1.0

    @property
    def state(self) -> dict[str, ParameterSpec]:
        """Parameters of an object's start: displacement, velocity, and spin of what turns."""
        return {**SHIFT, **VELOCITY, **(SPIN if self.turns else {})}


_KNOWN: dict[str, Material] = {}


def register(material: Material) -> None:
    """Add a material. Raises ValueError where its kind is taken."""
    if material.kind in _KNOWN or material.kind in BUILT_IN:
        raise ValueError(f"a material {material.kind!r} is registered already; materials: {list(kinds())}")
    _KNOWN[material.kind] = material


def kinds() -> tuple[str, ...]:
    """Kinds of all materials: the built-in ones, then those registered."""
    return (*BUILT_IN, *(k for k in _KNOWN if k not in BUILT_IN))


def material(representation: str) -> Material:
    """The material of a representation, planar or not; raises KeyError naming the choices."""
    kind = representation.removesuffix(PLANAR)
    if kind in BUILT_IN and kind not in _KNOWN:
        entry: Material = importlib.import_module(f"polyworld.materials.{kind}").MATERIAL
        _KNOWN[kind] = entry
    if kind not in _KNOWN:
        raise KeyError(f"unknown material {kind!r}; materials: {list(kinds())}")
    return _KNOWN[kind]


def material_of(item: Any) -> Material:
    """The material of a deformable object."""
    return material(item.representation)


def measure_of(item: Any) -> tuple[str, str]:
    """Name of an object's size, length, area or volume, and its unit; of a planar liquid its area."""
    form = material_of(item).form
    return MEASURES["sheet" if form == "liquid" and item.representation.endswith(PLANAR) else form]


def kinds_of(*forms: Form) -> tuple[str, ...]:
    """Kinds of the materials that have one of some forms."""
    return tuple(k for k in kinds() if material(k).form in forms)
