"""The sweep back in time, with what the sweep forward learned.

Going backwards, an object that was first seen apart is followed into the frames in which it was still one
region with another, or behind it; and every shared region is divided again between what is expected from
before and from after it, each weighted by how near in time the object was last seen by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.appearance import Bins, colour_bins, histogram, log_likelihood
from atw_mcp.perception.background import Mask
from atw_mcp.perception.partition import Member, Template, partition, renewed, template_of
from atw_mcp.perception.segmentation import Foreground
from atw_mcp.perception.tracking import Sweep, touches_border, whole, window_of
from atw_mcp.perception.video import Frames

Floats = NDArray[np.float64]

LEAST_LIFE = 5  # frames; what is seen for less is a flicker, not an object
COLOUR_FRAMES = 16


@dataclass
class _Ahead:
    """Knowledge of an object from later frames."""

    template: Template
    frame: int
    velocity: Floats = field(default_factory=lambda: np.zeros(2))  # per frame, backwards in time


def resweep(frames: Frames, foregrounds: list[Foreground], sweep: Sweep, stop: Callable[[], None]) -> Sweep:
    """Improve the sweep by one pass from the last frame to the first; `stop()` is called before each frame."""
    numbers = _lasting(sweep, len(frames))
    likelihoods = _likelihoods(frames, sweep, numbers)
    since_alone, until_alone = _nearest_alone(sweep, numbers, len(frames))
    size = (frames.shape[2], frames.shape[1])
    labels = np.zeros_like(sweep.labels)
    alone: list[set[int]] = [set() for _ in range(len(frames))]
    placed: dict[tuple[int, int], Template] = {}
    clarity: dict[tuple[int, int], float] = {}
    ahead: dict[int, _Ahead] = {}
    for t in range(len(frames) - 1, -1, -1):
        stop()
        foreground = foregrounds[t]
        bins: Bins | None = None
        for k in range(len(foreground.areas)):
            region = foreground.labels == k + 1
            before = [int(n) for n in np.unique(sweep.labels[t][region]) if int(n) in numbers]
            before = [n for n in before if (sweep.labels[t][region] == n).sum() >= 8]
            after = _reaching_in(t, region, before, sweep, ahead, labels)
            members = sorted({*before, *after})
            if not members:
                continue
            if len(members) == 1:
                number = members[0]
                labels[t][region] = number
                alone[t].add(number)
                _follow(ahead, number, t, template_of(labels[t] == number))
                continue
            if bins is None:
                bins = colour_bins(frames[t])
            left, top, right, bottom = window_of(region, 6)
            view = (slice(top, bottom), slice(left, right))
            claims = []
            for number in members:
                templates = _expectations(t, number, sweep, ahead, since_alone, until_alone, members)
                claims.append(Member(likelihoods[number], templates, _reach(t, number, ahead)))
            shares = partition(region[view], bins[view], left, top, claims, size)
            for number, share in zip(members, shares, strict=True):
                mask = whole(share.mask, left, top, size)
                area = int(mask.sum())
                if area < max(8, 0.03 * share.placed[0].area):
                    continue
                labels[t][mask] = number
                placed[t, number] = share.placed[0]
                clarity[t, number] = share.clarity
                _follow(ahead, number, t, renewed(share.placed[-1], mask, share.clarity))
    _own_leftovers(labels, foregrounds)
    return Sweep(
        labels=labels,
        alone=alone,
        placed=placed,
        clarity=clarity,
        tracks={n: sweep.tracks[n] for n in sorted(numbers)},
        born=sweep.born,
        split_from=sweep.split_from,
    )


def _lasting(sweep: Sweep, count: int) -> set[int]:
    """Objects seen in enough frames, and in enough of them by themselves not to be a piece of another."""
    numbers = set()
    for number in sweep.tracks:
        life = sum(bool((sweep.labels[t] == number).any()) for t in range(count))
        apart = sum(number in sweep.alone[t] for t in range(count))
        if life >= min(LEAST_LIFE, count) and (apart >= 3 or life >= min(10, count)):
            numbers.add(number)
    return numbers


def _likelihoods(frames: Frames, sweep: Sweep, numbers: set[int]) -> dict[int, Floats]:
    """Colours of each object from frames in which it was alone, leaving out those before another split off it."""
    result = {}
    for number in numbers:
        mixed_until = max((t for t, other in sweep.split_from.values() if other == number), default=0)
        rows = [t for t in range(len(frames)) if number in sweep.alone[t]]
        own = [t for t in rows if t >= mixed_until] or rows
        if not own:
            own = [t for t in range(len(frames)) if (sweep.labels[t] == number).any()]
        picks = sorted({own[round(i)] for i in np.linspace(0, len(own) - 1, min(COLOUR_FRAMES, len(own)))})
        total = np.zeros_like(sweep.tracks[number].colours)
        for t in picks:
            total += histogram(colour_bins(frames[t])[sweep.labels[t] == number])
        result[number] = log_likelihood(total)
    return result


def _nearest_alone(
    sweep: Sweep, numbers: set[int], count: int
) -> tuple[dict[int, NDArray[np.float64]], dict[int, NDArray[np.float64]]]:
    """Frames since, and until, each object is by itself (T,), inf where it never is."""
    since, until = {}, {}
    for number in numbers:
        rows = np.array([t for t in range(count) if number in sweep.alone[t]])
        forward, backward = np.full(count, np.inf), np.full(count, np.inf)
        for t in range(count):
            earlier, later = rows[rows <= t], rows[rows >= t]
            forward[t] = t - earlier[-1] if len(earlier) else np.inf
            backward[t] = later[0] - t if len(later) else np.inf
        since[number], until[number] = forward, backward
    return since, until


def _reaching_in(
    t: int, region: Mask, before: list[int], sweep: Sweep, ahead: dict[int, _Ahead], labels: NDArray[np.uint8]
) -> list[int]:
    """Objects known from later frames that should be in this region though the sweep forward did not see them."""
    height, width = region.shape
    found = []
    for number, known in ahead.items():
        if number in before or (sweep.labels[t] == number).any() or (labels[t] == number).any():
            continue
        if t < sweep.born[number] and touches_border(sweep.labels[sweep.born[number]] == number):
            continue  # it came in over the border: before that it was not there
        if known.frame - t > 40:
            continue
        outline = _expected(known, t).drawn(0, 0, width, height)
        if outline.any() and (outline & region).sum() > 0.3 * outline.sum():
            found.append(number)
    return found


def _expected(known: _Ahead, t: int) -> Template:
    steps = known.frame - t
    reach = steps if steps <= 1 else (1 - 0.93**steps) / 0.07
    return known.template.moved(float(known.velocity[0] * reach), float(known.velocity[1] * reach))


def _expectations(
    t: int,
    number: int,
    sweep: Sweep,
    ahead: dict[int, _Ahead],
    since_alone: dict[int, Floats],
    until_alone: dict[int, Floats],
    members: list[int],
) -> tuple[tuple[Template, float], ...]:
    """Return where the object is expected from before and from after, weighted by nearness to a frame of its own."""
    templates = []
    later = ahead.get(number)
    mine = sweep.labels[t] == number
    mixed = any(n != number and sweep.split_from.get(n, (0, 0))[1] == number and t < sweep.born[n] for n in members)
    if mine.any() and not (mixed and later is not None):
        earlier = sweep.placed.get((t, number))
        template = earlier if earlier is not None else template_of(mine)
        templates.append((template, 1.0 / (2.0 + min(float(since_alone[number][t]), 1e3))))
    if later is not None:
        templates.append((_expected(later, t), 1.0 / (2.0 + min(float(until_alone[number][t]), 1e3))))
    if not templates:
        templates.append((template_of(mine), 1.0))
    return tuple(templates)


def _reach(t: int, number: int, ahead: dict[int, _Ahead]) -> int:
    known = ahead.get(number)
    if known is None:
        return 2
    missing = max(known.frame - t - 1, 0)
    return int(min(3 + 0.5 * float(np.hypot(*known.velocity)) + 1.5 * missing, 30))


def _follow(ahead: dict[int, _Ahead], number: int, t: int, template: Template) -> None:
    known = ahead.get(number)
    if known is None:
        ahead[number] = _Ahead(template, t)
        return
    step = known.frame - t
    if step > 0:
        shift = (template.centre - known.template.centre) / step
        known.velocity = 0.5 * known.velocity + 0.5 * shift if step < 4 else shift
    known.template, known.frame = template, t


def _own_leftovers(labels: NDArray[np.uint8], foregrounds: list[Foreground]) -> None:
    """Pixels of a region that were given to nobody, because their share was too small, go to its largest owner."""
    for t, foreground in enumerate(foregrounds):
        left_over = (foreground.labels > 0) & (labels[t] == 0)
        if not left_over.any():
            continue
        for k in np.unique(foreground.labels[left_over]):
            region = foreground.labels == k
            owners = np.bincount(labels[t][region], minlength=2)
            owners[0] = 0
            if owners.any():
                labels[t][region & left_over] = int(owners.argmax())
