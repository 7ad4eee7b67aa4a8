"""Discover: propose bodies where nothing is given, from regions that move over the still background."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment

from atw_mcp.perception.eye.bodies import Outline
from atw_mcp.perception.eye.pixels import Bytes, Floats, features
from atw_mcp.perception.eye.regions import Region, Still, find_regions, reduced
from atw_mcp.perception.eye.seeds import Seed, outline_body
from atw_mcp.perception.eye.settings import EyeSettings
from atw_mcp.perception.eye.standing import standing

Kind = Literal["body", "shadow", "changing"]
UNLIKE_RIGID = 0.6  # factor of the probability of a body that is not rigid, or only darkens: shreds and shadows are so


@dataclass(frozen=True)
class Proposal:
    """A body that may be meant.

    seeds: its outline at the frame that shows it most clearly. confidence: probability that it is one rigid body.
    moves: probability that a body is there at all, whatever its area does. kind: shadow, where it darkens the
    background and nothing more and moves as a body near it does; changing, where its area or shape does not stay, as
    that of a hand, a person or a cloth. ask: whether an agent should be asked about it.
    frames: first and last. regions: of a body that moves, in reduced pixels.
    """

    body: Outline
    seeds: tuple[Seed, ...]
    confidence: float
    moves: float
    kind: Kind
    ask: bool
    frames: tuple[int, int]
    regions: tuple[Region, ...] = ()

    def centre(self) -> Floats:
        """Centre (2,) of the outline at its first seed [px]."""
        return np.asarray(self.seeds[0].points().mean(axis=0))

    def unlike_rigid(self) -> float:
        """Probability of a body that was not surely followed as a rigid one."""
        return self.confidence if self.kind == "changing" else UNLIKE_RIGID * self.moves


@dataclass
class _Chain:
    """Regions of one body in the order of their frames."""

    regions: list[Region] = field(default_factory=list)

    @property
    def last(self) -> Region:
        return self.regions[-1]

    def area(self) -> float:
        return float(np.median([r.area for r in self.regions]))

    def look(self) -> Floats:
        return np.asarray(np.median([r.look for r in self.regions], axis=0), dtype=float)

    def predicted(self, frame: int, *, back: bool = False) -> Floats:
        """Centre in a frame after the last region, or before the first, by the motion of the nearest frames."""
        own = self.regions[:4][::-1] if back else self.regions[-4:]
        if len(own) < 2:
            return own[-1].centre
        rate = (own[-1].centre - own[0].centre) / (own[-1].frame - own[0].frame)
        return np.asarray(own[-1].centre + rate * (frame - own[-1].frame))


def discover(
    frames: Bytes, settings: EyeSettings | None = None, least: int = 0, tick: Callable[[], None] = lambda: None
) -> list[Proposal]:
    """Propose bodies in frames (T, H, W, 3) of BGR bytes: those that move, the surest first, then those at rest.

    least: pixels of the smallest body that is looked for.
    """
    settings = settings or EyeSettings()
    small, factor = reduced(frames, settings.discovery_pixels)
    settings = replace(settings, least_region=max(settings.least_region, round(least * factor**2)))
    regions, still = find_regions(small, settings, tick)
    lasting = [c for c in _linked(regions, settings) if len(c.regions) >= 3]
    chains = _stitched([c for c in lasting if not _several(c, lasting)], settings)
    moving = [c for c in chains if _moves(c, settings)]
    found = [_proposal(f"body {n}", c, moving, factor, settings) for n, c in enumerate(moving, 1)]
    found.sort(key=lambda p: -p.confidence)
    at_rest = [
        r for r in standing(small, still, settings) if not any(_is_of(r, c, small, still, settings) for c in moving)
    ]
    sizes = [np.sqrt(c.area() / np.pi) for c in moving if not c.last.dark]
    for n, r in enumerate(at_rest, len(found) + 1):
        like = not sizes or any(abs(np.log(r.radius / size)) < np.log(settings.like_size) for size in sizes)
        found.append(_at_rest(f"body {n}", r, len(frames), factor, 0.8 if like else 0.2))
    return found


def _is_of(region: Region, chain: _Chain, frames: Bytes, still: Still, settings: EyeSettings) -> bool:
    """Whether a region at rest is of a body that moves: that covers it, and it is not to be seen when that is away."""
    whole = region.enlarged(*region.picture)
    near = [np.linalg.norm(r.centre - region.centre) < r.radius + region.radius for r in chain.regions]
    seen = [r for r, close in zip(chain.regions, near, strict=True) if close]
    covered = [(whole & r.enlarged(*r.picture)).sum() / region.area for r in seen]
    if chain.last.dark or max(covered, default=0.0) <= 0.5 or len(seen) <= 0.2 * len(chain.regions):
        return False
    look, spread = still.feature[whole], settings.differs * still.spread[whole]
    away = [r.frame for r, close in zip(chain.regions, near, strict=True) if not close]
    shown = [np.abs(features(frames[k][whole].astype(np.float32), settings) - look) < spread for k in away]
    return bool(sum(s.all(axis=1).mean() > 0.5 for s in shown) <= 0.5 * len(away))


def _at_rest(name: str, region: Region, count: int, factor: float, confidence: float) -> Proposal:
    seed = Seed.outlined(name, region.frame, outline_in_full(region, factor))
    body, span = replace(outline_body(name, seed), scales=True), (0, count - 1)
    return Proposal(body, (seed,), confidence, confidence, "body", False, span)


def _linked(regions: list[list[Region]], settings: EyeSettings) -> list[_Chain]:
    """Chains of regions from frame to frame: the nearest to the predicted place, of like size and colour."""
    open_: list[_Chain] = []
    closed: list[_Chain] = []
    for frame, own in enumerate(regions):
        price = _prices(open_, own, frame, settings)
        rows, columns = linear_sum_assignment(price) if price.size else ((), ())
        taken = set()
        for i, j in zip(rows, columns, strict=True):
            if price[i, j] < settings.link:
                open_[i].regions.append(own[j])
                taken.add(int(j))
        open_ += [_Chain([r]) for j, r in enumerate(own) if j not in taken]
        closed += [c for c in open_ if frame - c.last.frame >= settings.gap]
        open_ = [c for c in open_ if frame - c.last.frame < settings.gap]
    return closed + open_


def _prices(chains: list[_Chain], regions: list[Region], frame: int, settings: EyeSettings) -> Floats:
    """Unlikeness (C, R) of regions of a frame to chains: distance, size and colour, each about 1 where just alike."""
    if not chains or not regions:
        return np.zeros((len(chains), len(regions)))
    last = [c.last for c in chains]
    centres, areas = np.array([r.centre for r in regions]), np.array([r.area for r in regions], float)
    own_areas = np.array([r.area for r in last], float)[:, None]
    radius = np.sqrt(np.maximum(own_areas, areas) / np.pi)
    ahead = np.linalg.norm(np.array([c.predicted(frame) for c in chains])[:, None] - centres, axis=2)
    still = np.linalg.norm(np.array([r.centre for r in last])[:, None] - centres, axis=2) + 0.5 * radius
    size = np.abs(np.log(areas / own_areas))
    looks = np.array([r.look for r in last])[:, None] - np.array([r.look for r in regions])
    colour = np.abs(looks / [0.5, 0.15, 0.15]).max(axis=2)
    gap = np.array([frame - r.frame for r in last])[:, None]
    known = np.array([len(c.regions) > 1 for c in chains])[:, None]  # of one region no motion is known
    reach = settings.search * radius * np.where(known, 0.5, 1.0) * (1 + 0.5 * (gap - 1))
    # The edge of either is known to half a pixel.
    grown = size > 2 * (settings.growing + 1 / radius)
    grown &= ~(np.array([r.border for r in last])[:, None] | np.array([r.border for r in regions]))
    unlike = grown | (np.array([r.dark for r in last])[:, None] != np.array([r.dark for r in regions]))
    return np.asarray(np.where(unlike, 1e3, np.minimum(ahead, still) / reach + size + 0.5 * colour))


def _stitched(chains: list[_Chain], settings: EyeSettings) -> list[_Chain]:
    """Join chains of one body that was hidden or merged with another between them, those that fit best first."""
    areas, looks = [c.area() for c in chains], [c.look() for c in chains]
    pairs: list[tuple[float, int, int]] = []
    for i, one in enumerate(chains):
        for j, other in enumerate(chains):
            start = other.regions[0]
            if not 0 < start.frame - one.last.frame <= 5 * settings.gap or one.last.dark != other.last.dark:
                continue
            apart = min(
                np.linalg.norm(one.predicted(start.frame) - start.centre),
                np.linalg.norm(other.predicted(one.last.frame, back=True) - one.last.centre),
                np.linalg.norm(start.centre - one.last.centre),
            )
            radius = np.sqrt(max(areas[i], areas[j]) / np.pi)
            colour = float(np.abs((looks[i] - looks[j]) / [0.5, 0.1, 0.1]).max())
            price = float(apart / (settings.search * radius) + abs(np.log(areas[i] / areas[j])) + 0.5 * colour)
            if price < settings.link:
                pairs.append((price, i, j))
    after: dict[int, int] = {}
    for _, i, j in sorted(pairs):
        if i not in after and j not in after.values():
            after[i] = j
    joined = []
    for first in [k for k in range(len(chains)) if k not in after.values()]:
        whole, k = list(chains[first].regions), first
        while k in after:
            k = after[k]
            whole += chains[k].regions
        joined.append(_Chain(whole))
    return joined


def _several(chain: _Chain, chains: list[_Chain]) -> bool:
    """Whether a chain is of bodies that touch: where it begins or ends, at least two others that lie in it go on."""
    for end, step in ((chain.regions[0], -1), (chain.last, 1)):
        parts = 0
        for other in chains:
            near = other.regions[-1] if step < 0 else other.regions[0]
            if other is not chain and not near.dark and 0 < step * (near.frame - end.frame) <= 3:
                inside = np.linalg.norm(near.centre - end.centre) < 1.5 * end.radius
                parts += int(inside and near.area < 0.9 * end.area)
        if parts > 1:
            return True
    return False


def _moves(chain: _Chain, settings: EyeSettings) -> bool:
    """Whether a chain lasts and moves on from frame to frame."""
    if len(chain.regions) <= settings.gap:
        return False
    places = np.array([r.centre for r in chain.regions])
    reach = float(np.linalg.norm(np.percentile(places, 95, axis=0) - np.percentile(places, 5, axis=0)))
    return _persistence(chain) > settings.persistence and reach > max(0.5 * np.sqrt(chain.area() / np.pi), 3.0)


def _persistence(chain: _Chain) -> float:
    """Correlation of displacements of following frames: noise of outlines goes to and fro, blocks of coding jump and
    stand."""
    places = np.array([r.centre for r in chain.regions])
    steps = np.diff(places, axis=0) / np.diff([r.frame for r in chain.regions])[:, None]
    length = np.linalg.norm(steps, axis=1)
    steps *= np.minimum(1.0, np.percentile(length, 90) / np.maximum(length, 1e-9))[:, None]  # of those half hidden
    return float((steps[1:] * steps[:-1]).sum() / max((steps**2).sum(), 1e-9))


def _proposal(name: str, chain: _Chain, others: list[_Chain], factor: float, settings: EyeSettings) -> Proposal:
    whole = [r for r in chain.regions if not r.border] or chain.regions
    usual = float(np.median([r.area for r in whole]))
    most = float(np.percentile([r.area for r in whole], 75))  # more often a part is missing than something is added
    clearest = max(whole, key=lambda r: r.solid * np.exp(-abs(np.log(r.area / most))) * min(0.5 + r.alone, 1.0))
    seed = Seed.outlined(name, clearest.frame, outline_in_full(clearest, factor))
    solid = float(np.median([r.solid for r in whole]))
    spread = float(np.median(np.abs(np.log([r.area / usual for r in whole]))))
    bordering = np.mean([r.border for r in chain.regions])
    kind: Kind = "body"
    if chain.last.dark and _follows(chain, others, settings):
        kind = "shadow"
    elif spread > settings.growing or solid < settings.hollow or bordering > 0.8:
        kind = "changing"
    lasting = 1 - np.exp(-len(chain.regions) / (2 * (settings.gap + 1)))
    growing = settings.growing + np.sqrt(np.pi / usual)  # half a pixel along its edge
    smooth = min(_persistence(chain) / (2 * settings.persistence), 1.0)
    moves = lasting * smooth
    confidence = moves * (1 - min(spread / (2 * growing), 0.5))
    if kind == "shadow":
        confidence *= 0.2
    elif kind == "changing" or chain.last.dark:
        confidence *= UNLIKE_RIGID
    span = (chain.regions[0].frame, chain.last.frame)
    moves = confidence if chain.last.dark else moves
    body = replace(outline_body(name, seed), scales=True)  # it may come nearer
    regions = tuple(chain.regions)
    return Proposal(body, (seed,), float(confidence), float(moves), kind, bool(confidence < 0.7), span, regions)


def _follows(chain: _Chain, others: list[_Chain], settings: EyeSettings) -> bool:
    """Whether a dark region's place is a linear function of that of a body around it, as its shadow's on a plane is."""
    own = {r.frame: r for r in chain.regions}
    for other in others:
        pairs = [(own[r.frame].centre, r.centre) for r in other.regions if r.frame in own]
        if other is chain or other.last.dark or len(pairs) < 0.5 * len(own):
            continue
        dark, body = (np.array(p) for p in zip(*pairs, strict=True))
        radius = np.sqrt(max(chain.area(), other.area()) / np.pi)
        design = np.c_[np.ones(len(body)), body]
        left = dark - design @ np.linalg.lstsq(design, dark, rcond=None)[0]
        near = np.median(np.linalg.norm(dark - body, axis=1)) < settings.shadow_reach * radius
        if near and np.median(np.linalg.norm(left, axis=1)) < 0.5 * radius:
            return True
    return False


def outline_in_full(region: Region, factor: float) -> Floats:
    """Outline (V, 2) of a region in pixels of the whole frame."""
    padded = cv2.copyMakeBorder(region.mask.astype(np.float32), 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=0)
    scale = 4
    fine = cv2.resize(padded, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
    fine = cv2.GaussianBlur(fine, (0, 0), 0.4 * scale)
    contours, _ = cv2.findContours((fine > 0.5).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        v, u = np.nonzero(region.mask)
        box = np.array([[u.min(), v.min()], [u.max(), v.min()], [u.max(), v.max()], [u.min(), v.max()]], float)
        return np.asarray((box + region.corner + 0.5) / factor - 0.5)
    outline = max(contours, key=cv2.contourArea)
    outline = cv2.approxPolyDP(outline, 0.25 * scale, True)[:, 0].astype(float)
    return np.asarray(((outline + 0.5) / scale - 2 + region.corner) / factor - 0.5)
