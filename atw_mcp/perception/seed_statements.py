"""Turning what was said of objects into constraints: boxes, points and places into whole masks."""

from __future__ import annotations

import numpy as np

from atw_mcp.perception.constraints import Constraint, Exclusion, Rest, Seed, Shade
from atw_mcp.perception.corrections import Box, Exclude, Outline, Place, Point, Shadow, Stay
from atw_mcp.perception.masks import Mask, RunLengthMask
from atw_mcp.perception.observation import ObservationError
from atw_mcp.perception.partition import template_of
from atw_mcp.perception.pixel_evidence import PixelEvidence
from atw_mcp.perception.scene_models import SceneModels
from atw_mcp.perception.seed_outline import Hint, outlined
from atw_mcp.perception.track_edits import TrackEdits
from polyworld.world.camera import Camera

LEAST = 8  # pixels of a mask
NOTHING = "nothing in this outline stands out from its surroundings: give a tighter box, more points, or a mask"


class SeedReader:
    """Reads statements about the objects of one observation; notes says of which masks it is unsure."""

    def __init__(self, models: SceneModels, edits: TrackEdits, camera: Camera | None) -> None:
        self.models, self.edits, self.camera = models, edits, camera
        self.observation = edits.observation
        self.evidence = PixelEvidence(models)
        self.notes: list[str] = []

    def constraints(self) -> list[Constraint]:
        """All constraints that hold: the earlier ones but for seeds said again, and the new ones."""
        plain = [self._region(s) for s in self.edits.statements if isinstance(s, Exclude | Shadow | Stay)]
        outlines: dict[int, list[Outline | Place]] = {}
        for statement in self.edits.statements:
            if isinstance(statement, Outline | Place):
                self.observation.row(statement.frame)
                outlines.setdefault(statement.frame, []).append(statement)
        for frame, own in outlines.items():
            twice = {s.object for s in own if sum(o.object == s.object for o in own) > 1}
            if twice:
                raise ObservationError(f"{sorted(twice)} were outlined twice in frame {frame}: give each once")
        said_again = {(s.object, frame) for frame, own in outlines.items() for s in own}
        kept = [c for c in self.edits.constraints if not (isinstance(c, Seed) and (c.object, c.frame) in said_again)]
        kept += [c for c in plain if c not in kept]
        for frame, own in sorted(outlines.items()):
            kept += self._seeds(frame, own, kept)
        _check(kept)
        return kept

    def _seeds(self, frame: int, said: list[Outline | Place], kept: list[Constraint]) -> list[Seed]:
        """Seeds of one frame: masks given are taken as they are; of the others each keeps off what is given, and of two
        that share pixels the smaller one has them, as it could not be seen before the larger one otherwise."""
        taken = [(c.object, c.mask.decode()) for c in kept if isinstance(c, Seed) and c.frame == frame]
        barred = [c for c in kept if isinstance(c, Exclusion) and c.mask is not None and c.first <= frame <= c.last]
        made: list[Seed] = []
        drawn: list[tuple[Mask, Outline | Place]] = []
        for statement in sorted(said, key=lambda s: s.object):
            exact = _exact(statement)
            if exact is not None:
                mask = self._given_mask(exact)
                made.append(Seed(statement.object, frame, exact))
                taken.append((statement.object, mask))
            else:
                drawn.append((self._drawn(statement), statement))
        for mask, statement in sorted(drawn, key=lambda item: (int(item[0].sum()), item[1].object)):
            for other, own in taken:
                if other != statement.object:
                    mask = mask & ~own
            for c in barred:
                if c.object in (None, statement.object) and c.mask is not None:
                    mask = mask & ~c.mask.decode()
            if mask.sum() < LEAST:
                raise ObservationError(f"{statement.object} in frame {frame}: {NOTHING}")
            position = statement.position if isinstance(statement, Place) else None
            made.append(Seed(statement.object, frame, RunLengthMask.encode(mask), position))
            taken.append((statement.object, mask))
        return made

    def _given_mask(self, mask: RunLengthMask) -> Mask:
        height, width = self.observation.video.height, self.observation.video.width
        if (mask.height, mask.width) != (height, width):
            raise ObservationError(f"the mask is {mask.width} x {mask.height}, the image {width} x {height}")
        decoded = mask.decode()
        if decoded.sum() < LEAST:
            raise ObservationError(f"the mask holds fewer than {LEAST} pixels")
        return decoded

    def _drawn(self, statement: Outline | Place) -> Mask:
        """Return the mask, as filmed, of what a statement says."""
        row = self.observation.row(statement.frame)
        current = self.edits.current[statement.object][row]
        if isinstance(statement, Place):
            return self._placed(statement, row)
        hint = self._hint(statement, row, current)
        made = outlined(self.evidence, row, hint)
        if made is None:
            raise ObservationError(f"{statement.object} in frame {statement.frame}: {NOTHING}")
        if not made.distinct:
            self.notes.append(
                f"{statement.object} in frame {statement.frame}: nothing stands out in this box, so its mask is the "
                "ellipse in it; a mask would be surer"
            )
        return self.models.filmed(made.mask, row)

    def _hint(self, said: Outline, row: int, current: Mask) -> Hint:
        width, height = self.observation.video.width, self.observation.video.height
        if said.box is None and not said.positive and said.mask is None:
            raise ObservationError("an outline needs a box, positive points or a mask")
        for x, y in (*said.positive, *said.negative):
            if not (0 <= x < width and 0 <= y < height):
                raise ObservationError(f"point ({x:g}, {y:g}) is outside the image of {width} x {height}")
        mask = None
        if said.mask is not None:
            mask = self.models.working(self._given_mask(said.mask), row)
        elif said.box is None and current.any() and any(current[round(y), round(x)] for x, y in said.positive):
            mask = self.models.working(current, row)  # points refine the mask that is there
        box = None if said.box is None else self._working_box(inside(said.box, width, height), row)
        return Hint(box, self._working_points(said.positive, row), self._working_points(said.negative, row), mask)

    def _working_points(self, points: tuple[Point, ...], row: int) -> tuple[Point, ...]:
        return tuple(self.models.working_point(x, y, row) for x, y in points)

    def _working_box(self, box: Box, row: int) -> Box:
        left, top = self.models.working_point(box[0], box[1], row)
        scale = self.models.size[1] / self.observation.video.width
        return left, top, box[2] * scale, box[3] * scale

    def _placed(self, said: Place, row: int) -> Mask:
        """Return the object's nearest mask, moved to where a place in the world is seen; else an outline around it."""
        if self.camera is None:
            raise ObservationError("a place in the world needs a camera: CalibrateCamera first")
        width, height = self.observation.video.width, self.observation.video.height
        x, y = (float(v) for v in self.camera.project(np.array([said.position]))[0])
        if not (0 <= x < width and 0 <= y < height):
            raise ObservationError(
                f"{said.object} in frame {said.frame}: the place {list(said.position)} is seen at pixel "
                f"({x:.0f}, {y:.0f}), outside the image of {width} x {height}"
            )
        seen = [t for t, mask in enumerate(self.edits.current[said.object]) if mask.sum() >= LEAST]
        if not seen:
            made = outlined(self.evidence, row, Hint(inside=(self.models.working_point(x, y, row),)))
            if made is None:
                raise ObservationError(f"{said.object} in frame {said.frame}: {NOTHING}")
            return self.models.filmed(made.mask, row)
        nearest = min(seen, key=lambda t: abs(t - row))
        template = template_of(self.edits.current[said.object][nearest])
        shift = np.array([x, y]) - template.centre
        return template.moved(float(shift[0]), float(shift[1])).drawn(0, 0, width, height)

    def _region(self, said: Exclude | Shadow | Stay) -> Constraint:
        self.observation.row(said.frame)
        if isinstance(said, Stay):
            return self._rest(said)
        mask = said.mask
        if said.box is not None:
            if mask is not None:
                raise ObservationError("give box or mask, not both: a region is one of them")
            width, height = self.observation.video.width, self.observation.video.height
            left, top, wide, tall = (round(v) for v in inside(said.box, width, height))
            region = np.zeros((height, width), dtype=bool)
            region[top : top + tall, left : left + wide] = True
            mask = RunLengthMask.encode(region)
        elif mask is not None:
            self._given_mask(mask)
        if isinstance(said, Shadow):
            if mask is None:
                raise ObservationError("shadow needs a box or a mask: the region that is shadow")
            return Shade(said.frame, mask, said.object)
        if mask is None and said.object is None:
            raise ObservationError("exclude needs an object, a region (box or mask), or both")
        last = self._last(said.frame, said.frame if said.last_frame is None else said.last_frame)
        return Exclusion(said.frame, last, said.object, mask)

    def _rest(self, said: Stay) -> Rest:
        last = self._last(said.frame, said.last_frame)
        rows = range(self.observation.row(said.frame), self.observation.row(last) + 1)
        seeded = any(isinstance(s, Outline | Place) and s.object == said.object for s in self.edits.statements)
        seeded |= any(isinstance(c, Seed) and c.object == said.object for c in self.edits.constraints)
        if not seeded and not any(self.edits.found[said.object][row].any() for row in rows):
            raise ObservationError(
                f"{said.object} is seen in none of frames {said.frame}..{last}: outline it in one of them too"
            )
        return Rest(said.object, said.frame, last)

    def _last(self, first: int, last: int) -> int:
        self.observation.row(last)
        if last < first:
            raise ObservationError(f"last_frame {last} is before frame {first}")
        return last


def _exact(said: Outline | Place) -> RunLengthMask | None:
    """Return the mask that a statement gives as it is."""
    plain = isinstance(said, Outline) and said.box is None and not said.positive and not said.negative
    return said.mask if plain and isinstance(said, Outline) else None


def inside(box: Box, width: int, height: int) -> Box:
    """Return the part of a box inside the image; raises ObservationError where there is hardly any."""
    left, top, wide, tall = box
    if wide < 3 or tall < 3:
        raise ObservationError(f"a box is (left, top, width, height) of at least 3 px, got {box}")
    x0, y0 = max(round(left), 0), max(round(top), 0)
    x1, y1 = min(round(left + wide), width), min(round(top + tall), height)
    if x1 - x0 < 3 or y1 - y0 < 3:
        raise ObservationError(f"the box {box} lies outside the image of {width} x {height}")
    return x0, y0, x1 - x0, y1 - y0


def _check(constraints: list[Constraint]) -> None:
    """Raise ObservationError where an exclusion holds part of a seed."""
    seeds = [c for c in constraints if isinstance(c, Seed)]
    for c in constraints:
        if not isinstance(c, Exclusion | Shade):
            continue
        first, last = (c.frame, c.frame) if isinstance(c, Shade) else (c.first, c.last)
        for seed in seeds:
            if not first <= seed.frame <= last or c.object not in (None, seed.object):
                continue
            own = seed.mask.decode()
            covered = int(own.sum()) if c.mask is None else int((own & c.mask.decode()).sum())
            if covered:
                what = "shadow" if isinstance(c, Shade) else "free of it"
                raise ObservationError(
                    f"{covered} pixels of the outline given for {seed.object} in frame {seed.frame} are in a region "
                    f"said to be {what}: outline {seed.object} there again without them, or give a smaller region"
                )
