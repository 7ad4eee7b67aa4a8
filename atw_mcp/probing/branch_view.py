"""A branch beside its base: through one camera and in one plan, with what is displaced joined and measured."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.looking.legend import GROUND, Entry, cross, draw_cross, draw_star, legend, line, star
from atw_mcp.looking.notes import write_list
from atw_mcp.looking.overlay import DARK, FINE_BITS, OBSERVED, Canvas, Color, Image, fine
from atw_mcp.looking.plan_view import CROWD, PlanView, pathless, plan_frame
from atw_mcp.probing.branch_difference import BranchDifference, Instant, Side
from atw_mcp.probing.rollout_view import SOME, everywhere
from atw_mcp.worlds.marks import LEGEND, WorldMarks
from polyworld.pictures.contact_shadow import with_contact_shadows
from polyworld.pictures.render import Picture, default_camera, render

Array = NDArray[np.float64]

BASE: Color = (233, 180, 86)  # sky blue of Okabe & Ito (2008); blue, green, red
BRANCH: Color = (0, 159, 230)  # their orange
WIDTH, GAP = 1000, 4  # [px] of the picture, and between its parts
PLAN = 480  # [px] height of the plan
SMALL = 0.005  # [m] less is no displacement: half of what CompareWorlds counts as one
MARKED = 9  # objects of a crowd that get names, outlines and paths


class BranchView:
    """Draws a branch and its base at the same instants."""

    def __init__(self, difference: BranchDifference, names: list[str]) -> None:
        self.difference, self.names = difference, names
        base, branch = self.sides = difference.base, difference.branch
        places = np.concatenate([everywhere(side.world, side.result.trajectory) for side in self.sides])
        self.camera = branch.world.camera or base.world.camera or default_camera(branch.world, places)
        self.marks = [WorldMarks(side.world, side.result.trajectory, self.camera) for side in self.sides]
        self.marked = self._marked()
        self.shows = ""  # the plane of the plan, once drawn

    def draw(self, instants: list[Instant]) -> tuple[dict[str, Image], list[dict[str, Any]]]:
        """Pictures by name, and for the text the objects of the branch with their distance from the base."""
        samples = [[self._sample(side, i.frame) for i in instants] for side in self.sides]
        axes = plan_frame(
            [(side.world, side.result.trajectory) for side in self.sides],
            self.camera,
            self.names,
            sorted({*samples[0], *samples[1]}),
            PLAN,
        )
        self.shows = axes.shows
        plans = [PlanView(side.world, side.result.trajectory, axes, self.marked) for side in self.sides]
        drawn, rows = {}, []
        for instant, *rows_of in zip(instants, *samples, strict=True):
            time = instant.frame * self.difference.frame_time
            apart = {name: float(self.difference.displacement(name, np.array([time]))[0]) for name in self.names}
            top = self._cameras(rows_of, time, apart)
            plan = self._plan(plans, rows_of, time, apart)
            notes = self._notes(instant, time, apart, WIDTH - plan.shape[1] - GAP)
            gap = np.full((PLAN, GAP, 3), 255, np.uint8)
            low = np.concatenate([plan, gap, notes], axis=1)
            bar = np.full((GAP, WIDTH, 3), 255, np.uint8)
            drawn[f"frame {instant.frame:06d}"] = np.concatenate([top, bar, low, legend(self._entries(), WIDTH)])
            rows.append(self._row(instant, rows_of, time, apart))
        return drawn, rows

    def _marked(self) -> list[str]:
        """Return the objects that get names, outlines and paths: all, but of a crowd those displaced most."""
        if len(self.names) <= CROWD:
            return self.names
        times = np.linspace(0.0, self.difference.end, SOME)
        most = {n: np.nan_to_num(self.difference.displacement(n, times), nan=np.inf).max() for n in self.names}
        return sorted(self.names, key=lambda name: -most[name])[:MARKED]

    def legend(self) -> str:
        """Explain the colours and lines of the pictures that `draw` made."""
        found = (
            "upper left: the base, upper right: the branch, at the same instant through the same camera; below: both "
            f"in one {self.shows}, to scale in metres of the world. Orange, solid: displaced objects and paths of the "
            "branch; blue, dashed: the base; white lines join an object to where it is in the base, the distance of "
            "the centres beside its name; blue crosses: events gone, orange stars: new ones"
        )
        if len(self.marked) < len(self.names):
            found += f". Marked are the {len(self.marked)} of {len(self.names)} objects displaced most"
        return found + (f"; {LEGEND}" if any(marks.any for marks in self.marks) else "")

    def _entries(self) -> list[Entry]:
        return [
            Entry("branch", line(BRANCH)),
            Entry("base", line(BASE, "dashed")),
            Entry("displacement of the centre, in m beside the name", line(OBSERVED)),
            Entry("event gone", cross(BASE, 15)),
            Entry("event new", star(BRANCH)),
        ]

    def _cameras(self, samples: list[int], time: float, apart: dict[str, float]) -> Image:
        """Both rollouts through the camera, side by side."""
        width = (WIDTH - GAP) // 2
        pictures, canvases = [], []
        for side, marks, sample in zip(self.sides, self.marks, samples, strict=True):
            picture, color = self._rendered(side, sample)
            canvas = Canvas.of(color, zoom=width / color.shape[1])
            marks.draw(canvas, sample)
            pictures.append(picture)
            canvases.append(canvas)
        left, right = canvases
        moved = self._moved(apart)
        masks = [self._masks(side, picture) for side, picture in zip(self.sides, pictures, strict=True)]
        for canvas, name in [(c, n) for c in canvases for n in self.marked]:
            self._path(canvas, self.difference.base, name, samples[0], BASE, dashed=True)
            if canvas is right:
                self._path(canvas, self.difference.branch, name, samples[1], BRANCH, dashed=False)
        for name in self.marked:
            gone = name in masks[0] and name not in self.difference.branch.result.trajectory.names
            if (name in moved or gone) and name in masks[0]:
                left.outline(masks[0][name], BASE, "dashed")
                right.outline(masks[0][name], BASE, "dashed")
            if name in moved and name in masks[1]:
                right.outline(masks[1][name], BRANCH)
        for name in moved:
            places = [self._place(side, name, s) for side, s in zip(self.sides, samples, strict=True)]
            ends = self.camera.project(np.stack(places)) * right.scale
            if np.all(np.isfinite(ends)) and np.abs(ends).max() < 1e5:
                cv2.polylines(right.image, [fine(ends)], False, DARK, 3, cv2.LINE_AA, FINE_BITS)
                cv2.polylines(right.image, [fine(ends)], False, OBSERVED, 1, cv2.LINE_AA, FINE_BITS)
        left.names(masks[0], OBSERVED)
        right.names({self._label(n, apart): m for n, m in masks[1].items()}, OBSERVED)
        left.write(f"base   {time:.4g} s", (8, 16), BASE)
        right.write(f"branch   {time:.4g} s", (8, 16), BRANCH)
        bar = np.full((len(left.image), WIDTH - left.image.shape[1] - right.image.shape[1], 3), 255, np.uint8)
        return np.concatenate([left.image, bar, right.image], axis=1)

    def _plan(self, plans: list[PlanView], samples: list[int], time: float, apart: dict[str, float]) -> Image:
        """Both rollouts in one plan."""
        before, after = plans
        canvas = after.frame.ground()
        after.statics(canvas)
        shown, others = after.objects(canvas, samples[1])
        before.paths(canvas, samples[0], BASE, dashed_from=0, to_come=False)
        after.paths(canvas, samples[1], BRANCH, to_come=False)
        moved = self._moved(apart)
        removed = [name for name in before.names if name not in after.names]
        ghosts = PlanView(before.world, before.trajectory, before.frame, [*moved, *removed])
        ghosts.outlines(canvas, samples[0], BASE, "dashed")
        PlanView(after.world, after.trajectory, after.frame, [*moved]).outlines(canvas, samples[1], BRANCH, "solid")
        for name in moved:
            start, end = (self._place(side, name, s) for side, s in zip(self.sides, samples, strict=True))
            after.joined(canvas, start, end)
        for view, events in ((before, self.difference.gone), (after, self.difference.new)):
            for event in events:
                place = view.place_of(event)
                if place is None or event.time > time + 1e-9 or not set(event.participants) & set(self.marked):
                    continue
                if view is before:
                    draw_cross(canvas, view.pixel(place), BASE, 15)
                else:
                    draw_star(canvas, view.pixel(place), BRANCH)
        after.frame.finish(canvas)
        outside = others | ~after.frame.inside
        canvas.names({self._label(name, apart): mask for name, mask in shown.items()}, OBSERVED, outside)
        left = {name: mask for name, mask in before.masks(samples[0]).items() if name in removed}
        canvas.names({f"{n}, base only": m for n, m in left.items()}, BASE, outside)
        return canvas.image

    def _notes(self, instant: Instant, time: float, apart: dict[str, float], width: int) -> Image:
        """The instant, distances and events in words."""
        canvas = Canvas(np.full((PLAN, width, 3), GROUND, np.uint8), 1.0)
        head, foot = 8, PLAN // 3
        write_list(canvas, f"{time:.4g} s, frame {instant.frame}", instant.why, OBSERVED, (8, head), (width - 16, foot))
        column, rest = width // 2 - 16, PLAN - foot - 16
        known = sorted((item for item in apart.items() if np.isfinite(item[1])), key=lambda item: -item[1])
        items = [f"{distance:.3g} m   {name}" for name, distance in known]
        write_list(canvas, "distance from the base now", items, OBSERVED, (8, foot), (column, rest))
        top = foot
        for what, side, events, color in (
            ("gone (base only)", self.sides[0], self.difference.gone, BASE),
            ("new (branch only)", self.sides[1], self.difference.new, BRANCH),
        ):
            items = [self.difference.in_words(side, event) for event in events]
            title = f"events {what}:" + (" none" if not events else "")
            write_list(canvas, title, items, color, (width // 2 + 8, top), (column, rest // 2))
            top += rest // 2
        return canvas.image

    def _row(self, instant: Instant, samples: list[int], time: float, apart: dict[str, float]) -> dict[str, Any]:
        run, objects = self.difference.branch.result.trajectory, []
        for name in [name for name in self.names if name in run.names]:
            about: dict[str, Any] = {"name": name}
            if run.active[samples[1], run.index(name)]:
                about["position"] = self._place(self.difference.branch, name, samples[1]).tolist()
                about["from_base_m"] = apart[name] if np.isfinite(apart[name]) else None
            else:
                about |= {"simulated": False, "why": "joins later"}
            objects.append(about)
        why = list(instant.why)
        return {"frame": instant.frame, "time": time, "over_video": False, "why": why, "objects": objects}

    def _label(self, name: str, apart: dict[str, float]) -> str:
        distance = apart.get(name, np.nan)
        return f"{name} {distance:.2g} m" if distance > SMALL else name

    def _moved(self, apart: dict[str, float]) -> set[str]:
        return {name for name in self.marked if apart[name] > SMALL}

    def _rendered(self, side: Side, sample: int) -> tuple[Picture, Image]:
        run = side.result.trajectory
        place, turn, visible = run.positions[sample], run.orientations[sample], run.active[sample].tolist()
        points = {name: motion.points[sample] for name, motion in run.deformables.items()}
        picture = render(side.world, place, turn, self.camera, points=points, visible=visible)
        color = with_contact_shadows(side.world, place, turn, self.camera, picture, points=points, visible=visible)
        return picture, np.ascontiguousarray(color[..., ::-1])

    def _masks(self, side: Side, picture: Picture) -> dict[str, NDArray[np.bool_]]:
        run = side.result.trajectory
        found = {name: picture.mask(run.index(name)) for name in self.marked if name in run.names}
        return {name: mask for name, mask in found.items() if mask.any()}

    def _path(self, canvas: Canvas, side: Side, name: str, sample: int, color: Color, *, dashed: bool) -> None:
        run = side.result.trajectory
        if name not in run.names or name in pathless(side.world):
            return
        column = run.index(name)
        began = int(np.argmax(run.active[:, column]))
        canvas.path(
            self.camera.project(run.positions[began : sample + 1, column]), color, dashed_from=0 if dashed else None
        )

    def _place(self, side: Side, name: str, sample: int) -> Array:
        place: Array = side.result.trajectory.positions[sample, side.result.trajectory.index(name)]
        return place

    def _sample(self, side: Side, frame: int) -> int:
        return int(np.argmin(np.abs(side.result.trajectory.times - frame * self.difference.frame_time)))
