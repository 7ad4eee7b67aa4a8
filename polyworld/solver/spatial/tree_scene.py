"""A world's joints as a tree of links, where they are one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.solver.spatial import joint_layout, tree_layout

_FREEDOMS = {
    joint_layout.HINGE: 1,
    joint_layout.SLIDER: 1,
    joint_layout.BALL: 3,
    joint_layout.FIXED: 0,
    tree_layout.FREE: 6,
}

# Dormand & Prince 1980, J. Comput. Appl. Math. 6, 19: coefficients of seven stages, the last weights of fifth order;
# the stages' instants; and the differences from the weights of fourth order.
_STAGES = (
    (),
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
_NODES = (0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0)
_ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)


def build_tree(kinds: Any, bodies: int, rows: int) -> tree_layout.Tree:
    """Build the tree of joints (records of `JointKind`) on a number of bodies, with room for `rows` worlds at a time.

    It has no links where a spring is among the joints, or a body is held by two of them.
    """
    links = _links(kinds, bodies)
    freedoms = sum(int(link["freedoms"]) for link in links)
    tree = tree_layout.Tree()
    tree.count, tree.freedoms = len(links), freedoms
    tree.kinds = buffers.array(_records(links), tree_layout.LinkKind)
    room = rows if links else 1
    tree.links = _zeros((room, len(links)), tree_layout.Link)
    tree.inertia = _zeros((room, len(links)), wp.spatial_matrixd)
    tree.coordinates = _zeros((room, freedoms), tree_layout.Freedom)
    tree.slopes = _zeros((room, len(_STAGES) * freedoms), wp.float64)
    tree.rates = _zeros((room, len(_STAGES) * freedoms), wp.float64)
    tree.known = _zeros((rows,), wp.int32)
    tree.wanted = _zeros((rows,), wp.float64)
    tree.method = buffers.array(_method(), wp.float64)
    return tree


def _method() -> NDArray[np.float64]:
    """Rows: the stages' coefficients, their instants as parts of the step, the error's weights."""
    table = np.zeros((len(_STAGES) + 2, len(_STAGES)))
    for row, stage in zip(table, _STAGES, strict=False):
        row[: len(stage)] = stage
    table[-2], table[-1] = _NODES, _ERROR
    return table


def _links(kinds: Any, bodies: int) -> list[dict[str, float]]:
    """Bodies in an order in which parents come first; none where that is not possible."""
    if not len(kinds) or any(int(k["kind"]) == joint_layout.SPRING for k in kinds):
        return []
    at: dict[int, int] = {}  # body -> its link
    links: list[dict[str, float]] = []
    left = set(range(len(kinds)))

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
