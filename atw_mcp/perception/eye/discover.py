"""Discover: propose bodies where nothing is given, from regions that move over the still background."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment

from atw_mcp.perception.eye.bodies import Outline
from atw_mcp.perception.eye.pixels import Bytes, Floats
from atw_mcp.perception.eye.regions import Region, find_regions, reduced
from atw_mcp.perception.eye.seeds import Seed, outline_body
from atw_mcp.perception.eye.settings import EyeSettings
from atw_mcp.perception.eye.standing import standing

Kind = Literal["body", "shadow", "changing"]


@dataclass(frozen=True)
class Proposal:
    """A body that may be meant.

    seeds: its outline at the frame that shows it most clearly. confidence: probability that it is one rigid body. kind:
    shadow, where it darkens the background and nothing more and moves as a body near it does; changing, where its area
    or shape does not stay, as that of a hand, a person or a cloth. ask: whether an agent should be asked about it.
    frames: first and last. regions: of a body that moves, in reduced pixels.
    """

    body: Outline
    seeds: tuple[Seed, ...]
    confidence: float
    kind: Kind
    ask: bool
    frames: tuple[int, int]
    regions: tuple[Region, ...] = ()

    def centre(self) -> Floats:
        """Centre (2,) of the outline at its first seed [px]."""
        return np.asarray(np.asarray(self.seeds[0].value).mean(axis=0))


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
    at_rest = [r for r in standing(small, still, settings) if not any(_is_of(r, c) for c in moving)]
    return found + [_at_rest(f"body {n}", r, len(frames), factor) for n, r in enumerate(at_rest, len(found) + 1)]


def _is_of(region: Region, chain: _Chain) -> bool:
    """Whether a region at rest is where a body of about its size stands that moves in other frames."""
    reach = 0.7 * region.radius
    near = [r for r in chain.regions if np.linalg.norm(r.centre - region.centre) < reach]
    return not chain.last.dark and any(abs(np.log(r.area / region.area)) < 1.0 for r in near)


def _at_rest(name: str, region: Region, count: int, factor: float) -> Proposal:
    seed = Seed(name, "outline", region.frame, _outline(region, factor))
    return Proposal(outline_body(name, seed), (seed,), 0.8, "body", False, (0, count - 1))


def _linked(regions: list[list[Region]], settings: EyeSettings) -> list[_Chain]:
    """Chains of regions from frame to frame: the nearest to the predicted place, of like size and colour."""
    open_: list[_Chain] = []
    closed: list[_Chain] = []
    for frame, own in enumerate(regions):
        price = np.full((len(open_), len(own)), 1e3)
        for i, chain in enumerate(open_):
            for j, region in enumerate(own):
                price[i, j] = _price(chain, region, chain.predicted(frame), frame - chain.last.frame, settings)
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


def _price(chain: _Chain, region: Region, predicted: Floats, gap: int, settings: EyeSettings) -> float:
    """Unlikeness of a region to a chain: distance, size and colour, each about 1 where they are just alike."""
    last = chain.last
    if region.dark != last.dark:
        return 1e3
    radius = max(region.radius, last.radius)
    apart = min(np.linalg.norm(region.centre - predicted), np.linalg.norm(region.centre - last.centre) + 0.5 * radius)
    size = abs(np.log(region.area / last.area))
    if size > 2 * settings.growing and not (region.border or last.border):
        return 1e3
    colour = float(np.abs((region.look - last.look) / [0.5, 0.15, 0.15]).max())
    return float(apart / (settings.search * 0.5 * radius * (1 + 0.5 * (gap - 1))) + size + 0.5 * colour)


def _stitched(chains: list[_Chain], settings: EyeSettings) -> list[_Chain]:
    """Join chains of one body that was hidden or merged with another between them."""
    while True:
        best: tuple[float, int, int] | None = None
        for i, one in enumerate(chains):
            for j, other in enumerate(chains):
                gap = other.regions[0].frame - one.last.frame
                if i == j or not 0 < gap <= 5 * settings.gap or one.last.dark != other.last.dark:
                    continue
                ahead = one.predicted(other.regions[0].frame)
                behind = other.predicted(one.last.frame, back=True)
                radius = np.sqrt(max(one.area(), other.area()) / np.pi)
                apart = min(
                    np.linalg.norm(ahead - other.regions[0].centre),
                    np.linalg.norm(behind - one.last.centre),
                    np.linalg.norm(other.regions[0].centre - one.last.centre),
                )
                size = abs(np.log(one.area() / other.area()))
                colour = float(np.abs((one.look() - other.look()) / [0.5, 0.1, 0.1]).max())
                price = float(apart / (settings.search * radius) + size + 0.5 * colour)
                if price < settings.link and (best is None or price < best[0]):
                    best = (price, i, j)
        if best is None:
            return chains
        _, i, j = best
        joined = _Chain(chains[i].regions + chains[j].regions)
        chains = [c for k, c in enumerate(chains) if k not in (i, j)] + [joined]


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
    """Whether a chain lasts and moves on from frame to frame: noise of outlines goes to and fro, blocks of coding jump
    and stand."""
    if len(chain.regions) <= settings.gap:
        return False
    places = np.array([r.centre for r in chain.regions])
    reach = float(np.linalg.norm(np.percentile(places, 95, axis=0) - np.percentile(places, 5, axis=0)))
    steps = np.diff(places, axis=0) / np.diff([r.frame for r in chain.regions])[:, None]
    persists = float((steps[1:] * steps[:-1]).sum() / max((steps**2).sum(), 1e-9))
    return persists > settings.persistence and reach > max(0.5 * np.sqrt(chain.area() / np.pi), 3.0)


def _proposal(name: str, chain: _Chain, others: list[_Chain], factor: float, settings: EyeSettings) -> Proposal:
    whole = [r for r in chain.regions if not r.border] or chain.regions
    usual = float(np.median([r.area for r in whole]))
    clearest = max(
        whole,
        key=lambda r: r.solid * np.exp(-abs(np.log(r.area / usual))) * min(0.5 + r.alone, 1.0),
    )
    seed = Seed(name, "outline", clearest.frame, _outline(clearest, factor))
    solid = float(np.median([r.solid for r in whole]))
    spread = float(np.median(np.abs(np.log([r.area / usual for r in whole]))))
    bordering = np.mean([r.border for r in chain.regions])
    kind: Kind = "body"
    if chain.last.dark and _follows(chain, others, settings):
        kind = "shadow"
    elif spread > settings.growing or solid < settings.hollow or bordering > 0.8:
        kind = "changing"
    lasting = 1 - np.exp(-len(chain.regions) / (2 * (settings.gap + 1)))
    confidence = lasting * (1 - min(spread / (2 * settings.growing), 0.5)) * min(solid / 0.85, 1.0)
    if kind == "shadow":
        confidence *= 0.2
    elif kind == "changing" or chain.last.dark:
        confidence *= 0.6
    span = (chain.regions[0].frame, chain.last.frame)
    return Proposal(
        outline_body(name, seed), (seed,), float(confidence), kind, bool(confidence < 0.7), span, tuple(chain.regions)
    )


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


def _outline(region: Region, factor: float) -> Floats:
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
