"""A world's joints as a tree of links, where they are one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.integrate import DOP853

from polyworld.core import buffers
from polyworld.solver.spatial import joint_layout, tree_layout

_FREEDOMS = {
    joint_layout.HINGE: 1,
    joint_layout.SLIDER: 1,
    joint_layout.BALL: 3,
    joint_layout.FIXED: 0,
    tree_layout.FREE: 6,
}

STAGES = DOP853.n_stages + 1


def build_tree(kinds: Any, bodies: int, rows: int, *, locked: bool) -> tree_layout.Tree:
    """Build the tree of joints (records of `JointKind`) on a number of bodies, with room for `rows` worlds at a time.

    Springs are forces on its links. It has no links where a body is held by two other joints, or is
    free to leave the plane that it is `locked` to.
    """
    links = _links(kinds, bodies)
    if locked and any(link["kind"] != joint_layout.HINGE for link in links):
        links = []
    freedoms = sum(int(link["freedoms"]) for link in links)
    tree = tree_layout.Tree()
    tree.count, tree.freedoms = len(links), freedoms
    tree.kinds = buffers.array(_records(links), tree_layout.LinkKind)
    tree.link_of = buffers.ints(np.argsort([int(link["body"]) for link in links]))
    room = rows if links else 1
    tree.links = _zeros((room, len(links)), tree_layout.Link)
    tree.inertia = _zeros((room, len(links)), tree_layout.Inertia)
    tree.coordinates = _zeros((room, freedoms), tree_layout.Freedom)
    tree.slopes = _zeros((room, STAGES * freedoms), wp.float64)
    tree.rates = _zeros((room, STAGES * freedoms), wp.float64)
    tree.known = _zeros((rows,), wp.int32)
    tree.wanted, tree.clear = _zeros((rows,), wp.float64), _zeros((rows,), wp.float64)
    tree.method = buffers.array(_method(), wp.float64)
    return tree


def _method() -> NDArray[np.float64]:
    """Coefficients of the stages, their instants as parts of the step, weights of the errors of fifth and third order.

    The last stage is at the end of the step: Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I, 2nd
    ed., sec. II.5 and II.10.
    """
    table = np.zeros((STAGES + 3, STAGES))
    table[: STAGES - 1, : STAGES - 1] = DOP853.A
    table[STAGES - 1, : STAGES - 1] = DOP853.B
    table[STAGES] = [*DOP853.C, 1.0]
    table[STAGES + 1], table[STAGES + 2] = DOP853.E5, DOP853.E3
    return table


def _links(kinds: Any, bodies: int) -> list[dict[str, float]]:
    """Bodies in an order in which parents come first; none where that is not possible."""
    if not len(kinds):
        return []
    at: dict[int, int] = {}  # body -> its link
    links: list[dict[str, float]] = []
    left = {j for j, k in enumerate(kinds) if int(k["kind"]) != joint_layout.SPRING}

    def add(body: int, parent: int, joint: int, kind: int, sign: float) -> None:
        at[body] = len(links)
        first = sum(int(link["freedoms"]) for link in links)
        freedoms = _FREEDOMS[kind]
        links.append(
            {
                "body": body,
                "parent": parent,
                "joint": joint,
                "kind": kind,
                "sign": sign,
                "first": first,
                "freedoms": freedoms,
            }
        )

    def held(body: int) -> bool:
        return body in at or body >= bodies

    while len(at) < bodies:
        ready = [j for j in sorted(left) if held(int(kinds[j]["a"])) != held(int(kinds[j]["b"]))]
        if ready:
            j = ready[0]
            a, b, kind = (int(kinds[j][name]) for name in ("a", "b", "kind"))
            child, parent, sign = (b, a, -1.0) if held(a) else (a, b, 1.0)
            add(child, at.get(parent, tree_layout.ROOT), j, kind, sign)
            left.remove(j)
        else:
            body = next(i for i in range(bodies) if i not in at)  # nothing leads from it to the world
            add(body, tree_layout.ROOT, -1, tree_layout.FREE, 1.0)
    return [] if left else links


def _records(links: Sequence[dict[str, float]]) -> Any:
    records = np.zeros(max(len(links), 1), dtype=tree_layout.LinkKind.numpy_dtype())
    for record, link in zip(records, links, strict=False):
        for name, value in link.items():
            record[name] = value
    return records


def _zeros(shape: tuple[int, ...], dtype: Any) -> Any:
    return buffers.zeros(tuple(max(s, 1) for s in shape), dtype)
