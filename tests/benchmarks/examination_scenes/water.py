"""Simulate water and bodies in a vertical slice: FLIP with cut cells and rigid bodies coupled by pressure.

Tank, water and bodies do not vary along y: every body reaches from pane to pane, so the motion is two-dimensional.
Particles carry velocity, a staggered grid makes it free of divergence (Zhu and Bridson 2005, "Animating sand as a
fluid"). One pressure moves water and bodies together (Batty, Bertails and Bridson 2007, "A fast variational framework
for accurate solid-fluid coupling"), so added mass and Archimedes' force are not put in but come out. The surface is
where half of the rest density is, to a part of a cell (ghost pressure, Enright et al. 2003). No viscosity, no surface
tension, free slip; bodies touch floor, walls and each other with Coulomb friction and restitution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from tests.benchmarks.examination_scenes.solids import Array, Solid, settle

Mask = NDArray[np.bool_]
GRAVITY, DENSITY = 9.81, 1000.0  # [m/s^2], [kg/m^3]
KEPT = 0.98  # of a particle's own velocity at each step of 1 ms (FLIP); the rest is the grid's (PIC)
PULL = 0.1  # part of an excess of density that a step corrects
LOOSE = 1e-4  # of a link between cells: keeps the pressure of an enclosed pocket finite
OFFSETS = (0, 0.5), (0.5, 0)  # of the first face across x and across z, in cells
THIN = 0.1  # least distance of the surface from a wet cell's centre, and least opening of a face, in cells


@dataclass
class Tank:
    """Hold water in a tank from (0, 0) to `size` [m] with square cells, and bodies in it."""

    size: tuple[float, float]
    cell: float
    blocks: tuple[tuple[float, float, float, float], ...]  # water at first: x, z low, x, z high [m]
    solids: list[Solid] = field(default_factory=list)
    restitution: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Fill the blocks with four particles a cell, slightly off a lattice."""
        self.shape = round(self.size[0] / self.cell), round(self.size[1] / self.cell)
        spacing, places = self.cell / 2, []
        for low_x, low_z, high_x, high_z in self.blocks:
            x, z = (np.arange(lo + spacing / 2, hi, spacing) for lo, hi in ((low_x, high_x), (low_z, high_z)))
            places.append(np.stack(np.meshgrid(x, z, indexing="ij"), axis=-1).reshape(-1, 2))
        at = np.concatenate(places) if places else np.zeros((0, 2))
        at += np.random.default_rng(self.seed).uniform(-0.1, 0.1, at.shape) * spacing
        for solid in self.solids:
            at = at[solid.distance(at) > 0.25 * spacing]
        self.at, self.velocities = at, np.zeros_like(at)
        nx, nz = self.shape
        self.grids = [np.zeros((nx + 1, nz)), np.zeros((nx, nz + 1))]
        i, j = (np.arange(n + 1.0) for n in self.shape)
        self.corners = self.cell * np.stack(np.meshgrid(i, j, indexing="ij"), axis=-1)
        self.pressure = self.filled = np.zeros(self.shape)
        self.filled = self.fill(np.ones(self.shape))

    @property
    def energy(self) -> float:
        """Return kinetic and potential energy of water and bodies per metre of depth [J/m]."""
        drop = DENSITY * self.cell**2 / 4
        total = drop * float((self.velocities**2).sum() / 2 + GRAVITY * self.at[:, 1].sum())
        return total + sum(
            float(s.inertia @ s.motion**2) / 2 + s.mass * GRAVITY * float(s.place[1]) for s in self.solids
        )

    def spread(self, offset: tuple[float, float], shape: tuple[int, int]) -> tuple[NDArray[np.int64], Array]:
        """Return flat indices and bilinear weights (4, particles) of nodes at (i, j) + offset, clamped at the edge."""
        part = np.clip(self.at / self.cell - offset, 0, np.array(shape) - 1.0)
        low = np.minimum(part.astype(np.int64), np.array(shape) - 2)
        x, z = (part - low).T
        first = low[:, 0] * shape[1] + low[:, 1]
        nodes = np.stack([first, first + 1, first + shape[1], first + shape[1] + 1])
        return nodes, np.stack([(1 - x) * (1 - z), (1 - x) * z, x * (1 - z), x * z])

    def step(self, dt: float) -> None:
        """Move particles and bodies by a time step [s]."""
        for solid in self.solids:
            solid.place = solid.place + dt * solid.motion[:2]
            solid.angle += dt * solid.motion[2]
            solid.motion[1] -= dt * GRAVITY
        self.advect(dt)
        nodes = [self.spread(o, g.shape) for o, g in zip(OFFSETS, self.grids, strict=True)]
        grids, seen = [], []
        for axis, ((node, weight), old) in enumerate(zip(nodes, self.grids, strict=True)):
            total = np.bincount(node.ravel(), weight.ravel(), old.size)
            moment = np.bincount(node.ravel(), (weight * self.velocities[:, axis]).ravel(), old.size)
            grids.append((moment / np.maximum(total, 1e-9)).reshape(old.shape))
            seen.append((total > 1e-3).reshape(old.shape))
        before = [extend(g, s) for g, s in zip(grids, seen, strict=True)]
        after = self.project([before[0], before[1] - dt * GRAVITY], dt)
        kept = KEPT ** (dt / 1e-3)
        for axis, (node, weight) in enumerate(nodes):
            new, change = ((weight * g.ravel()[node]).sum(axis=0) for g in (after[axis], after[axis] - before[axis]))
            self.velocities[:, axis] = kept * (self.velocities[:, axis] + change) + (1 - kept) * new
        self.grids = after
        settle(self.solids, self.size[0], self.restitution)

    def advect(self, dt: float) -> None:
        """Carry the particles with the grid's velocity (midpoint), and keep them in the tank and out of bodies."""
        start = self.at
        for part in (0.5, 1.0):
            flow = [
                (w * g.ravel()[n]).sum(axis=0)
                for g, (n, w) in ((g, self.spread(o, g.shape)) for o, g in zip(OFFSETS, self.grids, strict=True))
            ]
            self.at = np.clip(start + part * dt * np.stack(flow, axis=-1), 1e-3 * self.cell, self.limit)
        for solid in self.solids:
            near = np.flatnonzero(np.abs(self.at - solid.place).max(axis=1) < math.hypot(*solid.half) + self.cell)
            near = near[solid.distance(self.at[near]) < 0.0]
            normal, at = solid.normal(self.at[near]), self.at[near]
            closing = np.minimum(((self.velocities[near] - solid.velocity(at)) * normal).sum(axis=1), 0.0)
            self.velocities[near] -= closing[:, None] * normal
            self.at[near] = np.clip(at - solid.distance(at)[:, None] * normal, 1e-3 * self.cell, self.limit)

    @property
    def limit(self) -> Array:
        """Return the highest place of a particle (2,)."""
        return np.array(self.size) - 1e-3 * self.cell

    def fill(self, open_part: Array) -> Array:
        """Return the density of water at cells (nx, nz) in parts of the rest density, of what bodies leave open."""
        node, weight = self.spread((0.5, 0.5), self.shape)
        room, count = open_part, np.bincount(node.ravel(), weight.ravel(), open_part.size).reshape(self.shape) / 4
        for axis in (0, 1):
            wide = np.pad(room, [(1, 1) if a == axis else (0, 0) for a in (0, 1)], mode="edge")
            lo, hi = (np.delete(wide, ends, axis=axis) for ends in ([-1, -2], [0, 1]))
            room = (lo + 6 * room + hi) / 8
        dense = np.where(room > 0.2, count / np.maximum(room, 0.2), 0.0)
        wide = np.pad(dense, 1)
        around = np.maximum.reduce([wide[:-2, 1:-1], wide[2:, 1:-1], wide[1:-1, :-2], wide[1:-1, 2:]])
        return np.asarray(np.where(room > 0.2, dense, around))

    def project(self, grids: list[Array], dt: float) -> list[Array]:
        """Return the grids (faces) without divergence, and give the bodies their part of the momentum."""
        nx, cell = self.shape[0], self.cell
        centres = self.corners[:-1, :-1] + cell / 2
        faces = [self.corners[:, :-1] + cell * np.array(OFFSETS[0]), self.corners[:-1] + cell * np.array(OFFSETS[1])]
        opens, room, columns, masses, motions = [np.ones(f.shape[:2]) for f in faces], np.ones(self.shape), [], [], []
        for solid in self.solids:
            room -= np.clip(0.5 - solid.distance(centres) / cell, 0, 1)
            corner, covers = solid.distance(self.corners), []
            for axis, (a, b) in enumerate(((corner[:, :-1], corner[:, 1:]), (corner[:-1], corner[1:]))):
                covers.append(covered(a, b))
                opens[axis] -= covers[axis]
                edge = np.moveaxis(covers[axis], axis, 0)
                edge[0] = edge[-1] = 0.0  # no body comes through the tank: what leaves a wall makes room for water
            basis = [[covers[0], 0], [0, covers[1]]]
            turn = -covers[0] * (faces[0][..., 1] - solid.place[1]), covers[1] * (faces[1][..., 0] - solid.place[0])
            columns += [flux(x * np.ones_like(covers[0]), z * np.ones_like(covers[1])) for x, z in (*basis, turn)]
            masses.append(solid.inertia)
            motions.append(solid.motion)
        for axis in (0, 1):
            opens[axis][opens[axis] < THIN] = 0.0  # else thin films between bodies and floor squirt out
            edge = np.moveaxis(opens[axis], axis, 0)
            edge[0] = edge[-1] = 0.0
        filled = self.filled = self.fill(np.clip(room, 0, 1))
        under = room[:, 0] < 0.5
        for start, end in between(filled[:, 0] > 0.5, under):
            filled[start:end, 0] = 1.0  # a gap too low for particles
        ways = opens[0][:-1] + opens[0][1:] + opens[1][:, :-1] + opens[1][:, 1:]
        wet = (filled > 0.5) & (ways > 0)
        seep(columns, wet[:, 0], under)
        deep = wet.copy()
        for axis, ahead in ((0, 1), (0, -1), (1, 1), (1, -1)):
            deep &= np.roll(wet | (room < 0.5), ahead, axis)  # the tank's edge counts by what is across: harmless
        excess = np.clip(filled - 1.0, np.where(deep, -0.3, 0.0), 0.5) * (room > 0.5)
        right = -flux(*(o * g for o, g in zip(opens, grids, strict=True))) * cell + PULL * excess * cell**2 / dt
        top = int(np.flatnonzero(wet.any(axis=0)).max(initial=0)) + 1
        scale, diagonal = dt / DENSITY, np.full(self.shape, LOOSE * dt / DENSITY)
        banded, factors = np.zeros((top + 1, nx * top)), []
        for axis in (0, 1):
            inner, (lo, hi) = ((slice(1, -1), slice(None)), (wet[:-1], wet[1:])) if axis == 0 else (
                (slice(None), slice(1, -1)), (wet[:, :-1], wet[:, 1:]))  # fmt: skip
            f_lo, f_hi = (filled[:-1], filled[1:]) if axis == 0 else (filled[:, :-1], filled[:, 1:])
            gap = np.abs(f_lo - f_hi)
            theta = np.clip((np.maximum(f_lo, f_hi) - 0.5) / np.maximum(gap, 1e-9), THIN, 1.0)
            factor = np.where(lo & hi, 1.0, np.where(lo ^ hi, 1 / theta, 0.0))
            factors.append(factor)
            link = scale * opens[axis][inner] * factor
            both = -link * (lo & hi)
            if axis == 0:
                diagonal[:-1] += link * lo
                diagonal[1:] += link * hi
                banded[top, : (nx - 1) * top] = both[:, :top].ravel()
            else:
                diagonal[:, :-1] += link * lo
                diagonal[:, 1:] += link * hi
                banded[1] = np.pad(both[:, : top - 1], ((0, 0), (0, 1))).ravel()
        banded[0] = np.where(wet, diagonal, 1.0)[:, :top].ravel()
        wanted = np.stack([right, *(c * cell for c in columns)], axis=-1) * wet[..., None]
        wanted = wanted[:, :top].reshape(-1, wanted.shape[-1])
        if motions:
            wanted[:, 0] -= wanted[:, 1:] @ np.concatenate(motions)
        solved = solveh_banded(banded, wanted, lower=True, overwrite_ab=True, check_finite=False)
        pressure = solved[:, 0]
        if motions:
            push, mass = wanted[:, 1:], np.concatenate(masses)
            part = np.linalg.solve(np.diag(mass / dt) + push.T @ solved[:, 1:], push.T @ pressure)
            pressure = pressure - solved[:, 1:] @ part
            for solid, change in zip(self.solids, (dt * (push.T @ pressure) / mass).reshape(-1, 3), strict=True):
                solid.motion = solid.motion + change
        self.pressure = np.zeros(self.shape)
        self.pressure[:, :top] = pressure.reshape(nx, top)
        result = []
        for axis in (0, 1):
            new, inner = grids[axis].copy(), (slice(1, -1), slice(None)) if axis == 0 else (slice(None), slice(1, -1))
            new[inner] -= scale / cell * factors[axis] * np.diff(self.pressure, axis=axis)
            known = np.zeros(new.shape, dtype=bool)
            known[inner] = (factors[axis] > 0) & (opens[axis][inner] > 0)
            edge, sure = np.moveaxis(new, axis, 0), np.moveaxis(known, axis, 0)
            edge[0] = edge[-1] = 0.0
            sure[0] = sure[-1] = True
            result.append(extend(new, known))
        return result


def covered(a: Array, b: Array) -> Array:
    """Return which part of edges is inside a body whose distances at their ends are a and b (Batty et al. 2007)."""
    low, high = np.minimum(a, b), np.maximum(a, b)
    return np.asarray(np.where(high <= 0, 1.0, np.where(low >= 0, 0.0, low / np.minimum(low - high, -1e-12))))


def seep(columns: list[Array], wet: Mask, under: Mask) -> None:
    """Let water come below bodies on the floor from both sides, where both are wet: half of what they lift from each.

    Else no pressure would lift what stands flat. columns: what leaves each cell, of bodies that move; wet, under (nx,):
    cells of the lowest row that hold water, and that bodies fill.
    """
    for start, end in between(wet, under & ~wet):
        for column in columns:
            drawn = column[start:end, 0].sum() / 2
            column[start - 1, 0] += drawn
            column[end, 0] += drawn


def between(wet: Mask, under: Mask) -> list[tuple[int, int]]:
    """Return the stretches of cells under bodies, first and one after last, that have wet cells on both sides."""
    ends = np.flatnonzero(np.diff(np.pad(under, 1).astype(int))).reshape(-1, 2).tolist()
    return [(start, end) for start, end in ends if start > 0 and end < len(wet) and wet[start - 1] and wet[end]]


def flux(x: Array, z: Array) -> Array:
    """Return what leaves each cell, of flows through its faces."""
    return np.asarray(np.diff(x, axis=0) + np.diff(z, axis=1))


def extend(grid: Array, known: Mask, layers: int = 3) -> Array:
    """Return values carried into unknown nodes next to known ones, layer by layer; 0 farther away."""
    value, known = np.where(known, grid, 0.0), known.copy()
    for _ in range(layers):
        wide, mark = np.pad(value, 1), np.pad(known.astype(float), 1)
        total, count = (w[:-2, 1:-1] + w[2:, 1:-1] + w[1:-1, :-2] + w[1:-1, 2:] for w in (wide, mark))
        fresh = ~known & (count > 0)
        value = np.where(fresh, total / np.maximum(count, 1.0), value)
        known |= fresh
    return value
