"""A USD stage in metres, kilograms and z up."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SHAPES = ("SphereShape", "CubeShape", "CapsuleShape", "CylinderShape", "ConeShape", "PlaneShape", "MeshShape")
_OTHER_SHAPES = ("Capsule1Shape", "Cylinder1Shape", "CustomShape", "SpherePointsShape")
_OTHER_JOINTS = ("D6Joint", "DistanceJoint", "CustomJoint")


@dataclass(frozen=True)
class Material:
    """Friction [1], restitution [1] and density [kg/m^3], None where the material does not say."""

    friction: float
    restitution: float
    density: float | None


class Stage:
    """Parts of a file that UsdPhysics' parser finds.

    metre, kilogram: a unit of the stage in SI. up: rotation (3, 3) from the stage's axes to axes with z up.
    """

    def __init__(self, path: Path, alone: bool) -> None:
        from polyworld.exchange.reading import needed

        usd = needed("pxr.Usd", "reading USD")
        geom, self._physics = needed("pxr.UsdGeom", "reading USD"), needed("pxr.UsdPhysics", "reading USD")
        layers = needed("pxr.Sdf", "reading USD")
        try:
            root = layers.Layer.FindOrOpen(str(path))  # the layer alone: composing a stage opens what it refers to
            if alone and root and _refers(layers, root):
                raise ValueError("it refers to other files: flatten it, as `usdcat --flatten` does")
            self.usd: Any = usd.Stage.Open(root)
        except Exception as error:  # USD's own, of no useful type
            raise ValueError(
                f"{path.name} is not read by USD: {max(str(error).splitlines(), key=len, default='')}"
            ) from error
        self.metre = float(geom.GetStageMetersPerUnit(self.usd))
        self.kilogram = float(self._physics.GetStageKilogramsPerUnit(self.usd))
        y_up = geom.GetStageUpAxis(self.usd) == geom.Tokens.y
        self.up: Array = np.array(((1.0, 0, 0), (0, 0, -1.0), (0, 1.0, 0))) if y_up else np.eye(3)
        self._geom = geom
        self._time = usd.TimeCode.EarliestTime()
        found = self._physics.UsdPhysicsLoadStageFromPrimRange(self.usd, ["/"])
        self._found = {str(kind).rsplit(".", 1)[-1]: pair for kind, pair in found.items()}
        self._materials = {at: self._read(m) for at, m in self.of("RigidBodyMaterial")}

    def of(self, kind: str) -> Iterator[tuple[str, Any]]:
        """Path and description of everything of a kind, in the stage's order."""
        paths, descriptions = self._found.get(kind, ((), ()))
        for path, description in zip(paths, descriptions, strict=True):
            if description.isValid:
                yield str(path), description

    def shapes(self) -> list[Any]:
        """Colliders of all kinds."""
        return [found for kind in (*_SHAPES, *_OTHER_SHAPES) for _, found in self.of(kind)]

    def absent(self) -> list[str]:
        """Parts that have no counterpart."""
        joints = [(kind, at) for kind in _OTHER_JOINTS for at, _ in self.of(kind)]
        found = [f"joint {at} is left out: {kind} has no counterpart" for kind, at in joints]
        groups = [at for at, _ in self.of("CollisionGroup")]
        read = {str(shape.primPath) for shape in self.shapes()}
        solid = [p for p in self.usd.Traverse() if p.HasAPI(self._physics.CollisionAPI)]
        unread = [str(p.GetPath()) for p in solid if str(p.GetPath()) not in read]
        found += [f"{at} is left out: UsdPhysics knows no such collider" for at in unread]
        return found + ([f"collision groups are left out: {', '.join(groups)}"] if groups else [])

    def prim(self, path: str) -> Any:
        """The prim at a path."""
        return self.usd.GetPrimAtPath(path)

    def matrix(self, path: str) -> Array:
        """Transform (4, 4) of column vectors from a prim's axes to the stage's, in its units."""
        cache = self._geom.XformCache(self._time)
        return np.array(cache.GetLocalToWorldTransform(self.prim(path)), dtype=float).T

    def pose(self, path: str) -> tuple[Array, Array]:
        """Position (3,) [m] and rotation (3, 3) of a prim's axes, z up."""
        matrix = self.matrix(path)
        return self.up @ matrix[:3, 3] * self.metre, self.up @ rotation_of(matrix[:3, :3])

    def owner(self, path: str) -> str:
        """Path of the rigid body that a prim is part of, or an empty one."""
        prim = self.prim(path)
        while prim and not prim.IsPseudoRoot():
            if prim.HasAPI(self._physics.RigidBodyAPI):
                return str(prim.GetPath())
            prim = prim.GetParent()
        return ""

    def material(self, collider: Any) -> Material | None:
        """Material of a collider, None where it has none."""
        named = [str(path) for path in collider.materials]
        return self._materials.get(named[0]) if named else None

    def mass_api(self, path: str) -> dict[str, Any]:
        """Values that a prim states of its mass, centre of mass, diagonal inertia and principal axes, stage units."""
        prim = self.prim(path)
        if not prim.HasAPI(self._physics.MassAPI):
            return {}
        api = self._physics.MassAPI(prim)
        names = ("Mass", "Density", "CenterOfMass", "DiagonalInertia", "PrincipalAxes")
        attributes = {name: getattr(api, f"Get{name}Attr")() for name in names}
        return {name: a.Get() for name, a in attributes.items() if a and a.HasAuthoredValue()}

    def colour(self, path: str) -> Any:
        """Display colour of a prim, None where it states none."""
        prim = self.prim(path)
        if not prim.IsA(self._geom.Gprim):
            return None
        values = self._geom.Gprim(prim).GetDisplayColorAttr().Get(self._time)
        return values[0] if values else None

    def mesh(self, path: str) -> tuple[Array, list[list[int]]]:
        """Points (k, 3) in a mesh's own axes, stage units, and its faces."""
        mesh = self._geom.Mesh(self.prim(path))
        points = np.array(mesh.GetPointsAttr().Get(self._time), dtype=float).reshape(-1, 3)
        counts = list(mesh.GetFaceVertexCountsAttr().Get(self._time) or [])
        indices = [int(i) for i in mesh.GetFaceVertexIndicesAttr().Get(self._time) or []]
        starts = np.concatenate([[0], np.cumsum(counts)]).astype(int)
        return points, [indices[a:b] for a, b in itertools.pairwise(starts)]

    def _read(self, found: Any) -> Material:
        density = float(found.density) * self.kilogram / self.metre**3
        return Material(float(found.dynamicFriction), float(found.restitution), density if density > 0.0 else None)


def _refers(layers: Any, root: Any) -> bool:
    """Return whether a layer names files that composing or evaluating its stage would open."""
    if root.GetExternalReferences() or root.GetCompositionAssetDependencies():
        return True
    clips: list[Any] = []

    def visit(path: Any) -> None:
        prim = root.GetPrimAtPath(path) if path.IsPrimPath() or path.IsPrimVariantSelectionPath() else None
        if prim is not None and prim.HasInfo("clips"):
            clips.append(path)

    root.Traverse(layers.Path.absoluteRootPath, visit)
    return bool(clips)


def rotation_of(matrix: Array) -> Array:
    """The rotation nearest to a (3, 3) matrix with scales: its polar factor."""
    u, _, v = np.linalg.svd(matrix)
    found: Array = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    return found
