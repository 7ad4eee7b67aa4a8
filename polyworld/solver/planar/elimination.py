"""The order in which the direct solver of hinges eliminates them, and what each elimination changes.

Minimum degree (Tinney & Walker 1967, Proc. IEEE 55, 1801): chains and trees of few branches fill nothing in, so that a
solution takes time and memory in proportion to the hinges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int32]


@dataclass(frozen=True)
class Elimination:
    """Pattern of a block Cholesky factor L D L^T of the compliance matrix of J hinges, B blocks below the diagonal."""

    order: Ints  # (J,) hinges as they are eliminated
    first_block: Ints  # (J + 1,) where the blocks of each, in that order, begin
    block_row: Ints  # (B,) hinge in whose row a block stands
    first_update: Ints  # (J + 1,) where the updates of blocks by each, in that order, begin
    updates: Ints  # (U, 3) block (r, s), which loses block (r, c) D^-1 block (s, c)^T
    couplings: Ints  # (M, 6) block, body that couples its two hinges; row's hinge and end, column's hinge and end


def eliminate(pairs: Sequence[tuple[int, int]]) -> Elimination:
    """Return the elimination of hinges between these pairs of bodies (-1: the world)."""
    ends: dict[int, list[tuple[int, int]]] = {}
    for j, pair in enumerate(pairs):
        for e, i in enumerate(pair):
            if i >= 0:
                ends.setdefault(i, []).append((j, e))
    beside: dict[int, set[int]] = {j: set() for j in range(len(pairs))}
    for met in ends.values():
        for j, _ in met:
            beside[j] |= {k for k, _ in met if k != j}
    order: list[int] = []
    below: list[set[int]] = []
    while beside:
        c = min(beside, key=lambda j: (len(beside[j]), j))
        rows = beside.pop(c)
        for r in rows:
            beside[r] = (beside[r] | rows) - {r, c}
        order.append(c)
        below.append(rows)
    place = {c: k for k, c in enumerate(order)}
    block: dict[tuple[int, int], int] = {}
    for c, rows in zip(order, below, strict=True):
        for r in sorted(rows, key=place.__getitem__):
            block[r, c] = len(block)
    updates: list[tuple[int, int, int]] = []
    first_update = [0]
    for c, rows in zip(order, below, strict=True):
        updates += [(block[r, s], block[r, c], block[s, c]) for s in rows for r in rows if place[r] > place[s]]
        first_update.append(len(updates))
    couplings = [
        (block[r, c], i, r, e, c, f) for i, met in ends.items() for r, e in met for c, f in met if place[r] > place[c]
    ]
    return Elimination(
        order=np.array(order, np.int32),
        first_block=np.concatenate([[0], np.cumsum([len(rows) for rows in below])]).astype(np.int32),
        block_row=np.array([r for r, _ in block], np.int32),
        first_update=np.array(first_update, np.int32),
        updates=np.array(updates, np.int32).reshape(-1, 3),
        couplings=np.array(couplings, np.int32).reshape(-1, 6),
    )
