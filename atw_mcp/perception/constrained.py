"""Masks of all objects that satisfy what was said of them: seeds as they are, followed to all other frames, and what
others had of them taken away.

The result depends on the masks found before and on the set of constraints, not on the order in which they were given.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.background import Mask
from atw_mcp.perception.constraints import Constraint, Exclusion, Rest, Seed, Shade
from atw_mcp.perception.pixel_evidence import Look, PixelEvidence, View
from atw_mcp.perception.propagation import Followed, Follower, Given, overlap
from atw_mcp.perception.scene_models import SceneModels

Floats = NDArray[np.float64]

ROUNDS = 2  # in which objects that claim the same pixels are followed again
CONFLICT = 0.3  # share of the smaller of two masks that both claim
NEARER = 0.99  # by which a claim weakens with each frame from the seed
APART = 0.1  # share of a seed that an object found before may overlap where it is another body
TAKEN = 0.1  # share of a mask whose loss makes the rest doubtful
REMAINS = 0.4  # least share of a mask that is still the object after such a loss
PASSING = 25.0  # levels by which something in front of a resting object differs from it
MOST_REST_ANCHORS = 3  # rows of a rest that are anchors of the look: first, middle, last
UMBRA = 20  # percentile of the brightness ratio in a region said to be shadow that is the full shadow's
IN_SHADE = 0.2  # share of a region called shadow that lies in a mask which is then freed of shadow
WEIGHT = 4.0  # nats that a full difference of claims is worth in sharing pixels


@dataclass
class Constrained:
    """masks (T) of each object as filmed; sureness (T,) of objects that were followed, NaN where masks were found
    before; changed: objects whose masks are not those found; notes: where objects were lost."""

    masks: dict[str, list[Mask]]
    sureness: dict[str, Floats] = field(default_factory=dict)
    changed: set[str] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Claims:
    """Inputs to follow one object with."""

    anchors: dict[int, Mask]
    resting: dict[int, tuple[Mask, int]]  # by row: the outline, and a row that shows it
    span: tuple[int, int]


class Constrainer:
    """Derives masks from those found before and from constraints."""

    def __init__(
        self,
        models: SceneModels,
        found: Mapping[str, list[Mask]],
        constraints: Sequence[Constraint],
        frames: Sequence[int],
        stop: Callable[[], None],
        report: Callable[[float, str], None],
    ) -> None:
        self.models, self.found, self.frames = models, found, frames
        self.stop, self.report = stop, report
        self.rows = {frame: row for row, frame in enumerate(frames)}
        self.seeds = [c for c in constraints if isinstance(c, Seed)]
        self.exclusions = [c for c in constraints if isinstance(c, Exclusion)]
        self.shades = [c for c in constraints if isinstance(c, Shade)]
        self.rests = [c for c in constraints if isinstance(c, Rest)]

    def run(self) -> Constrained:
        """Return the masks that satisfy all constraints."""
        result = Constrained({name: list(masks) for name, masks in self.found.items()})
        anchors = self._anchors()
        self.models.uncover([(row, mask) for own in anchors.values() for row, mask in own.anchors.items()])
        self._learn_shadow()
        evidence = PixelEvidence(self.models)
        followed = self._follow_all(evidence, anchors)
        self._share(evidence, followed, anchors)
        self._shade(evidence, result, set(followed))
        for name, way in followed.items():
            self._take_over(result, name, way, anchors[name])
        self._take_away(evidence, result, set(followed))
        self._exclude(result)
        for seed in self.seeds:
            result.masks[seed.object][self.rows[seed.frame]] = seed.mask.decode()
        for name, masks in result.masks.items():
            before = self.found[name]
            if any(not np.array_equal(a, b) for a, b in zip(masks, before, strict=True)):
                result.changed.add(name)
        result.changed |= set(followed)
        return result

    # --- what is given ---

    def _anchors(self) -> dict[str, _Claims]:
        """Working masks of each object that has any, by row."""
        anchors: dict[str, dict[int, Mask]] = {}
        resting: dict[str, dict[int, tuple[Mask, int]]] = {}
        for seed in self.seeds:
            row = self.rows[seed.frame]
            anchors.setdefault(seed.object, {})[row] = self.models.working(seed.mask.decode(), row)
        for rest in self.rests:
            rows = [self.rows[f] for f in self.frames if rest.first <= f <= rest.last]
            own = anchors.setdefault(rest.object, {})
            seen = self._resting(rows, own, self._known(rest.object))
            if seen is None:
                continue  # where it is then shows when it is followed
            outline = seen[0]
            for row in rows:
                resting.setdefault(rest.object, {})[row] = seen
            for k in np.linspace(0, len(rows) - 1, min(MOST_REST_ANCHORS, len(rows))).round().astype(int):
                own.setdefault(rows[k], outline)
        return {
            name: _Claims(own, resting.get(name, {}), self._span(name, own))
            for name, own in sorted(anchors.items())
            if own
        }

    def _known(self, name: str) -> dict[int, Mask]:
        """Working masks of an object as they were found, by row."""
        return {row: self.models.working(mask, row) for row, mask in enumerate(self.found[name]) if mask.any()}

    @staticmethod
    def _resting(rows: Sequence[int], own: Mapping[int, Mask], known: Mapping[int, Mask]) -> tuple[Mask, int] | None:
        """Return the outline of an object at rest, and a row that shows it: a seed's, else that of most rows."""
        seeded = [row for row in rows if row in own]
        if seeded:
            middle = seeded[len(seeded) // 2]
            return own[middle], middle
        masks = [(row, known[row]) for row in rows if row in known]
        if not masks or own:
            return None
        return _most_alike(masks)

    def _resting_then(self, name: str, way: Followed, own: _Claims) -> dict[int, tuple[Mask, int]]:
        """Outlines of an object at rest by row, those included that only following it has shown."""
        found = dict(own.resting)
        for rest in self.rests:
            rows = [self.rows[f] for f in self.frames if rest.first <= f <= rest.last]
            if rest.object != name or any(row in found for row in rows):
                continue
            masks = [(row, way.masks[row]) for row in rows if row in way.masks and way.masks[row].any()]
            if masks:
                found |= dict.fromkeys(rows, _most_alike(masks))
        return found

    def _span(self, name: str, anchors: Mapping[int, Mask]) -> tuple[int, int]:
        """First and last row in which an object may be, as exclusions from the whole image say."""
        absent = self._absent(name)
        first, last = min(anchors), max(anchors)
        while first > 0 and first - 1 not in absent:
            first -= 1
        while last < self.models.count - 1 and last + 1 not in absent:
            last += 1
        return first, last

    def _absent(self, name: str) -> set[int]:
        whole = [e for e in self.exclusions if e.mask is None and e.object in (None, name)]
        return {row for e in whole for frame, row in self.rows.items() if e.first <= frame <= e.last}

    def _barred(self, name: str) -> Callable[[int], Mask | None]:
        """Return where an object cannot be, by row, in working pixels."""
        regions = [e for e in self.exclusions if e.mask is not None and e.object in (None, name)]
        drawn = [(e.first, e.last, e.mask.decode()) for e in regions if e.mask is not None]

        def barred(row: int) -> Mask | None:
            own = [mask for first, last, mask in drawn if first <= self.frames[row] <= last]
            return self.models.working(np.any(own, axis=0), row) if own else None

        return barred

    def _learn_shadow(self) -> None:
        """Take the factor of shadows from the regions that were said to be shadow."""
        factors = []
        for shade in self.shades:
            row = self.rows[shade.frame]
            where = self.models.working(shade.mask.decode(), row)
            if where.any():
                ground = self.models.background[where][:, 0] + 4.0
                factors.append(float(np.percentile((self.models.ycc[row][where][:, 0] + 4.0) / ground, UMBRA)))
        dark = [f for f in factors if 0.1 < f < 0.97]
        if dark:
            self.models.shadow = float(np.median(dark))

    # --- following ---

    def _follow_all(self, evidence: PixelEvidence, anchors: Mapping[str, _Claims]) -> dict[str, Followed]:
        """Follow every object by itself, then those again that took what another has the better claim to."""
        blocked: dict[str, dict[int, Mask]] = {name: self._others(name, own) for name, own in anchors.items()}
        followed: dict[str, Followed] = {}
        again = list(anchors)
        for round_ in range(ROUNDS + 1):
            for k, name in enumerate(again):
                self.report((round_ + k / max(len(again), 1)) / (ROUNDS + 1), f"following {name}")
                followed[name] = self._follow(evidence, name, anchors[name], blocked[name])
            again = self._losers(followed, anchors, blocked) if round_ < ROUNDS else []
            if not again:
                break
        return followed

    def _follow(self, evidence: PixelEvidence, name: str, own: _Claims, blocked: Mapping[int, Mask]) -> Followed:
        given = Given(own.anchors, self._known(name), blocked.get, self._barred(name), own.span)
        return Follower(evidence, given, self.stop).run()

    def _others(self, name: str, own: _Claims) -> dict[int, Mask]:
        """Return what belongs to others: their seeds, and bodies found before that were seen beside this one."""
        blocked: dict[int, Mask] = {}

        def add(row: int, mask: Mask) -> None:
            blocked[row] = blocked[row] | mask if row in blocked else mask

        for seed in self.seeds:
            if seed.object != name:
                row = self.rows[seed.frame]
                add(row, self.models.working(seed.mask.decode(), row))
        constrained = {s.object for s in self.seeds} | {r.object for r in self.rests}
        for other, masks in self.found.items():
            if other == name or other in constrained:
                continue
            if all(self._seen_apart(masks[row], self.models.filmed(mask, row)) for row, mask in own.anchors.items()):
                for row, mask in enumerate(masks):
                    if mask.any():
                        add(row, self.models.working(mask, row))
        return blocked

    @staticmethod
    def _seen_apart(other: Mask, own: Mask) -> bool:
        return bool(other.any()) and (other & own).sum() <= APART * own.sum()

    def _losers(
        self, followed: Mapping[str, Followed], anchors: Mapping[str, _Claims], blocked: dict[str, dict[int, Mask]]
    ) -> list[str]:
        """Objects that claim what another has the better claim to; what they are to keep off is added to `blocked`."""
        names = sorted(followed)
        beaten: dict[str, set[str]] = {}
        for k, one in enumerate(names):
            for other in names[k + 1 :]:
                for row in followed[one].masks.keys() & followed[other].masks.keys():
                    a, b = followed[one].masks[row], followed[other].masks[row]
                    if (a & b).sum() > CONFLICT * min(a.sum(), b.sum()):
                        lost = self._weaker(one, other, row, followed, anchors)
                        beaten.setdefault(lost, set()).add(other if lost == one else one)
        for name, winners in beaten.items():
            for winner in winners:
                for row, mask in followed[winner].masks.items():
                    if self._weaker(name, winner, row, followed, anchors) == name:
                        kept = blocked[name].get(row)
                        blocked[name][row] = mask if kept is None else kept | mask
        return sorted(beaten)

    def _weaker(
        self, one: str, other: str, row: int, followed: Mapping[str, Followed], anchors: Mapping[str, _Claims]
    ) -> str:
        claims = [(self._claim(followed[n], anchors[n], row), n) for n in (one, other)]
        return min(claims)[1]

    @staticmethod
    def _claim(way: Followed, own: _Claims, row: int) -> float:
        """Compute how well founded a mask is: its confidence, the less the farther from a seed."""
        if row in own.anchors or row in own.resting:
            return 2.0
        nearest = min(abs(row - anchor) for anchor in own.anchors)
        return way.confidence.get(row, 0.0) * NEARER**nearest

    def _share(self, evidence: PixelEvidence, followed: Mapping[str, Followed], anchors: Mapping[str, _Claims]) -> None:
        """Give each pixel that several followed objects claim to the one whose colours and claim fit best."""
        looks = {
            name: Look.of(self.models.ycc, sorted(own.anchors), [own.anchors[r] for r in sorted(own.anchors)])
            for name, own in anchors.items()
        }
        before = {name: dict(way.masks) for name, way in followed.items()}
        names = sorted(followed)
        for k, one in enumerate(names):
            for other in names[k + 1 :]:
                for row in before[one].keys() & before[other].keys():
                    both = before[one][row] & before[other][row]
                    if not both.any():
                        continue
                    view = _window(both)
                    gain = cv2.GaussianBlur(
                        evidence.ratio(looks[one], row, view) - evidence.ratio(looks[other], row, view), (0, 0), 1.0
                    )
                    claims = [self._claim(followed[n], anchors[n], row) for n in (one, other)]
                    mine = np.zeros_like(both)
                    mine[view] = gain + WEIGHT * (claims[0] - claims[1]) > 0
                    followed[one].masks[row] = followed[one].masks[row] & ~(both & ~mine)
                    followed[other].masks[row] = followed[other].masks[row] & ~(both & mine)

    # --- putting together ---

    def _take_over(self, result: Constrained, name: str, way: Followed, own: _Claims) -> None:
        """Put what was followed in place of what was found, and say where and why it ends."""
        sure = np.full(self.models.count, np.nan)
        for row, mask in way.masks.items():
            result.masks[name][row] = self.models.filmed(mask, row)
            sure[row] = way.confidence[row]
        for row, (outline, shown) in self._resting_then(name, way, own).items():
            kept = outline & ~self._passing(row, shown)
            result.masks[name][row] = self.models.filmed(kept, row)
            sure[row] = float(kept.sum() / max(int(outline.sum()), 1))
        result.sureness[name] = sure
        for row, why in sorted(way.ended.items()):
            if why != "left the image" and not result.masks[name][row].any():
                result.notes.append(f"{name} could not be followed to frame {self.frames[row]} and beyond: {why}")

    def _passing(self, row: int, shown: int) -> Mask:
        """Return where a row differs from one that shows an object at rest: something is in front of it."""
        images = self.models.ycc[[row, shown]].astype(np.int16)
        differing = (np.abs(images[0] - images[1]).max(axis=2) > PASSING).astype(np.uint8)
        return cv2.morphologyEx(differing, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0

    def _take_away(self, evidence: PixelEvidence, result: Constrained, followed: set[str]) -> None:
        """Take the pixels of followed objects, and with them their shadows, from objects that were only found."""
        for name, masks in result.masks.items():
            if name in followed:
                continue
            for row, mask in enumerate(masks):
                if not mask.any():
                    continue
                owned = [result.masks[o][row] for o in followed if not np.isnan(result.sureness[o][row])]
                lost = mask & np.any(owned, axis=0) if owned else np.zeros_like(mask)
                if not lost.any():
                    continue
                rest = mask & ~lost
                if lost.sum() > TAKEN * mask.sum():
                    rest = self._without_shadow(evidence, rest, row)
                    if rest.sum() < REMAINS * mask.sum():
                        rest = np.zeros_like(mask)
                masks[row] = rest

    def _without_shadow(self, evidence: PixelEvidence, mask: Mask, row: int) -> Mask:
        """Return the part of a filmed mask that is neither background nor shadow."""
        small = self.models.working(mask, row)
        if not small.any():
            return np.zeros_like(mask)
        view = _window(small)
        apart = np.zeros_like(small)
        apart[view] = cv2.GaussianBlur(evidence.apart(row, view), (0, 0), 0.8) > 0
        kept = cv2.morphologyEx((small & apart).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
        return mask & self.models.filmed(kept, row)

    def _shade(self, evidence: PixelEvidence, result: Constrained, followed: set[str]) -> None:
        """Free objects that hold a region said to be shadow of shadow, in all frames; that region is nobody's."""
        for shade in self.shades:
            row = self.rows[shade.frame]
            where = shade.mask.decode()
            holding = [
                name
                for name, masks in result.masks.items()
                if name not in followed
                and (
                    name == shade.object
                    or (shade.object is None and (masks[row] & where).sum() > IN_SHADE * where.sum())
                )
            ]
            for name in holding:
                masks = result.masks[name]
                for t, mask in enumerate(masks):
                    self.stop()
                    if mask.any():
                        masks[t] = self._without_shadow(evidence, mask & ~where if t == row else mask, t)

    def _exclude(self, result: Constrained) -> None:
        regions = [*self.exclusions, *(Exclusion(s.frame, s.frame, s.object, s.mask) for s in self.shades)]
        for exclusion in regions:
            region = None if exclusion.mask is None else exclusion.mask.decode()
            for name, masks in result.masks.items():
                if exclusion.object not in (None, name):
                    continue
                for frame, row in self.rows.items():
                    if exclusion.first <= frame <= exclusion.last and masks[row].any():
                        masks[row] = np.zeros_like(masks[row]) if region is None else masks[row] & ~region


def _most_alike(masks: list[tuple[int, Mask]]) -> tuple[Mask, int]:
    """Return where most of the masks (row, mask) of an object at rest lie, and the row whose mask is most like that."""
    most = np.mean([mask for _, mask in masks], axis=0) > 0.5
    row, mask = max(masks, key=lambda item: overlap(item[1], most))
    return (most if most.any() else mask), row


def _window(mask: Mask) -> View:
    y, x = np.nonzero(mask)
    return slice(max(int(y.min()) - 3, 0), int(y.max()) + 4), slice(max(int(x.min()) - 3, 0), int(x.max()) + 4)
