"""The report and the live view of both demos and of each material show what the store holds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from atw_mcp.observation.track_records import TrackRecord
from evidence_store import Answer, EvidenceStore
from polyworld.trajectory import Rollout
from polyworld.world import World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Cylinder, Sphere
from tests.atw_mcp.viewer import acceptance
from tests.atw_mcp.viewer.acceptance import DEMO_CASE, DEMOS, MATERIALS, Reader, report, served
from tests.atw_mcp.viewer.conftest import Pages
from tests.atw_mcp.viewer.stores import ASIDE, discs_store

if TYPE_CHECKING:
    from playwright.sync_api import Page

Array = NDArray[np.float64]
MOMENTS = (0.31, 0.77)  # shares of all time that are scrubbed to
FLOAT32 = 1e-6  # relative: the document holds float32
WAYS = ("report", "view")
DESKTOP = {"width": 1280, "height": 900}
PHONE = {"width": 360, "height": 740, "dark": True, "touch": True}


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Stores by name, made once: those of the demos, and one with a case of each material."""
    made: dict[str, Path] = {}

    def get(name: str) -> Path:
        if name not in made:
            folder = tmp_path_factory.mktemp(name)
            made[name] = (
                acceptance.materials_store(folder / "atw.db")
                if name == "materials"
                else acceptance.demo_store(name, folder)
            )
        return made[name]

    return get


@pytest.fixture
def open_case(pages: Pages, tmp_path: Path) -> Iterator[Callable[[str, Path, str], Page]]:
    """Open a case: its report on a light desktop, or its live view on a dark phone, with the commands of a user."""
    serving = []

    def opened(way: str, store: Path, case: str) -> Page:
        if way == "report":
            return pages.open(report(store, case, tmp_path / "report.html"), **DESKTOP)
        live = served(store)
        address = live.__enter__()
        serving.append(live)
        return pages.open(f"{address}{case}/", **PHONE)

    yield opened
    pages.close()  # before its server ends
    for live in serving:
        live.__exit__(None, None, None)


def stored(store: EvidenceStore, case: str) -> dict[str, tuple[World, Rollout]]:
    """Read the rollouts that the case's evidence is about, with their worlds."""
    named = dict.fromkeys(row.rollout for row in store.evidence.of_case(case) if row.rollout)
    runs = {rollout: acceptance.stored_rollout(store, rollout) for rollout in named}
    return {rollout: (acceptance.stored_world(store, run.world_id), run) for rollout, run in runs.items()}


def kinetic(item: RigidObject, velocity: Array, spin: Array, turned: Array) -> Array | None:
    """Return the kinetic energy (T,) [J] of a homogeneous ball, box or cylinder by its textbook moments of inertia."""
    m, shape = item.mass, item.shape
    if m is None or not isinstance(shape, Sphere | Box | Cylinder):
        return None
    if isinstance(shape, Sphere):
        moments = np.full(3, 0.4 * m * shape.radius**2)
    elif isinstance(shape, Box):
        squares = np.square(shape.half_extents)
        moments = m / 3.0 * (squares.sum() - squares)
    else:
        across = m * (3.0 * shape.radius**2 + (2.0 * shape.half_height) ** 2) / 12.0
        moments = np.array([across, across, 0.5 * m * shape.radius**2])
    own = Rotation.from_quat(turned, scalar_first=True).inv().apply(spin)
    return np.asarray(0.5 * m * (velocity**2).sum(axis=-1) + 0.5 * (own**2 * moments).sum(axis=-1))


def expected(world: World, run: Rollout) -> dict[str, dict[str, Array]]:
    """Return series (T,) of each object that follow from the stored motion alone, by quantity."""
    motion, found = run.trajectory, {}
    found["x"], found["y"], found["z"] = (
        {n: motion.positions[:, k, axis] for k, n in enumerate(motion.names)} for axis in range(3)
    )
    found["speed"] = {n: np.linalg.norm(motion.velocities[:, k], axis=-1) for k, n in enumerate(motion.names)}
    found["kinetic_energy"] = {}
    for item in world.objects:
        k = motion.names.index(item.name)
        energy = kinetic(item, motion.velocities[:, k], motion.angular_velocities[:, k], motion.orientations[:, k])
        if energy is not None:
            found["kinetic_energy"][item.name] = energy
    return found


def contacts(run: Rollout, name: str) -> list[float]:
    """Return when contacts of an object begin or end [s]."""
    return [e.time for e in run.events if e.kind.startswith("contact") and name in e.participants]


def at_clock(now: float, times: Array, values: Array, jumps: list[float]) -> float:
    """Interpolate a series (T,) linearly, but not across jumps: before one the last sample holds, after it the next."""
    k = int(np.searchsorted(times, now, side="right")) - 1
    if k + 1 < len(times):
        inside = [t for t in jumps if times[k] < t <= times[k + 1]]
        if inside:
            return float(values[k] if now < min(inside) else values[k + 1])
    return float(np.interp(now, times, values))


def check_series(reader: Reader, runs: dict[str, tuple[World, Rollout]]) -> int:
    """Compare the numbers shown at the clock's time with the stored motion; returns how many were compared."""
    now, compared = reader.time, 0
    for quantity in ("x", "y", "z", "speed", "kinetic_energy"):
        for (rollout, name), value in reader.series(quantity).items():
            world, run = runs[rollout]
            column = run.trajectory.names.index(name)
            values = expected(world, run)[quantity].get(name)
            if values is None:
                continue
            at = np.searchsorted(run.trajectory.times, now)
            if (
                not run.trajectory.active[max(at - 1, 0) : at + 1, column].all()
                or now > run.trajectory.times[-1] + 1e-6
            ):
                continue  # it enters or leaves here, or this run has ended
            scale = float(np.nanmax(np.abs(values)))
            jumps = contacts(run, name) if quantity in ("speed", "kinetic_energy") else []
            right = at_clock(now, run.trajectory.times, values, jumps)
            assert value == pytest.approx(right, rel=FLOAT32, abs=2 * FLOAT32 * scale + 1e-12), (quantity, name, now)
            compared += 1
    return compared


def check_views(reader: Reader, world: World) -> None:
    """Go through layouts, eyes and an object followed."""
    page, scene = reader.page, reader.page.get_by_role("region", name="scene")
    if page.locator("[name=compared]").count():
        for key, layout in (("2", "side"), ("3", "ghost"), ("1", "one")):
            reader.press(key)
            assert page.get_attribute(".stage", "data-layout") == layout
    name = world.moving_names[0]
    page.locator(f'.objects [data-object="{name}"] button').first.click()
    reader.press("f")
    reader.scrub(0.4)
    before = reader.label(name)
    reader.scrub(0.8)
    assert reader.label(name) == pytest.approx(before, abs=2.0), "the eye follows it"  # px
    reader.press("f", "p", "o")
    if world.camera is not None:
        reader.press("v", "Home")
        left, top, width = scene.locator(".frame").evaluate(
            "({style: s}) => [s.left, s.top, s.width].map(Number.parseFloat)"
        )
        seen = (reader.label(name) - [left, top]) * world.camera.width / width
        place = next(o.position for o in world.objects if o.name == name)
        assert seen == pytest.approx(world.camera.project(np.array([place]))[0], abs=0.5)  # px
        reader.press("o")
    size = page.viewport_size
    assert size is not None
    assert page.evaluate("document.documentElement.scrollWidth") == size["width"]


def check_events(reader: Reader, runs: dict[str, tuple[World, Rollout]], rollout: str) -> None:
    """Compare the marks on a rollout's lane with its stored events; contacts whose end is hidden are not shown."""
    shown = {
        (mark["kind"], float(mark["time"]))
        for mark in reader.data(f'[data-lane="{rollout}"] .mark')
        if not mark.get("count")
    }
    known = {(event.kind, event.time) for event in runs[rollout][1].events}
    for kind, time in shown:
        assert any(k == kind and abs(t - time) < 1e-6 for k, t in known), (kind, time)


def walk(reader: Reader, store: EvidenceStore, case: str) -> None:
    """Scrub, step and switch between all rollouts of a case, and compare what is shown with the store."""
    runs, page = stored(store, case), reader.page
    assert set(reader.rollouts()) == set(runs)
    reader.open_tab("series")
    for rollout, (world, run) in runs.items():
        reader.choose(rollout)
        for share in MOMENTS:
            now = reader.scrub(share)
            assert now == pytest.approx(share * run.trajectory.times[-1], abs=0.02 * run.horizon)
            assert check_series(reader, runs) >= 4 * len(world.objects) * bool(world.objects)
        frame = world.time.seconds_per_frame
        before = reader.time
        reader.press("ArrowRight")
        assert reader.time == pytest.approx((np.floor(before / frame + 0.5) + 1) * frame)
        check_events(reader, runs, rollout)
    if len(runs) > 1:
        first, second = list(runs)[:2]
        reader.choose(first, second)
        reader.press("3")
        reader.scrub(0.5)
        assert {rollout for rollout, _ in reader.series("x")} == {first, second}
        check_series(reader, runs)
    check_views(reader, runs[page.locator("[name=rollout]").input_value()][0])


@pytest.mark.benchmark
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("material", MATERIALS)
def test_scene_of_each_material(
    stores: Callable[[str], Path], open_case: Callable[[str, Path, str], Page], material: str, way: str
) -> None:
    path = stores("materials")
    store = EvidenceStore.to_read(path)
    walk(Reader(open_case(way, path, material)), store, material)
    store.close()


@pytest.mark.benchmark
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("demo", DEMOS)
def test_demo(stores: Callable[[str], Path], open_case: Callable[[str, Path, str], Page], demo: str, way: str) -> None:
    path = stores(demo)
    store = EvidenceStore.to_read(path)
    page = open_case(way, path, DEMO_CASE)
    reader = Reader(page)
    walk(reader, store, DEMO_CASE)
    check_answers(reader, store)
    check_residuals(reader, store)
    check_fits(reader, store)
    check_comparisons(reader, store)
    check_gap(reader, store)
    if way == "view":
        writer = EvidenceStore(path)
        writer.cases.add_question(DEMO_CASE, "Is this page live?")
        writer.cases.add_answer(DEMO_CASE, Answer("Is this page live?", "true", None, ("ev-2",), ""))
        writer.close()
        page.wait_for_selector('[data-question="Is this page live?"][data-answer="true"]', state="attached")
    store.close()


def payloads(store: EvidenceStore, tool: str) -> list[tuple[str, dict[str, Any]]]:
    """Ids and data of the completed results of a tool, oldest first."""
    heads = store.evidence.of_case(DEMO_CASE, tool=tool)
    return [(h.id, store.evidence.get(h.id).payload["data"]) for h in heads if h.status == "completed"]


def check_answers(reader: Reader, store: EvidenceStore) -> None:
    """Compare answers with the store, and follow each back to the case."""
    for answer in store.cases.answers(DEMO_CASE):
        shown = reader.page.locator(f'[data-question="{answer.question}"]')
        assert shown.get_attribute("data-answer") == answer.answer
        for identifier in answer.evidence:
            assert shown.get_by_text(identifier, exact=True).count() == 1
        shown.get_by_role("button", name="how it was found").click()
        reader.settle()
        chain = reader.page.locator(".provenance")
        for identifier in answer.evidence:
            assert chain.locator(f'[data-node="{identifier}"]').count() >= 1, identifier
        assert chain.locator('[data-kind="case"]').count() >= 1, "it leads back to the video"


def check_residuals(reader: Reader, store: EvidenceStore) -> None:
    """Compare residuals with distances between stored tracks and stored rollouts."""
    listed = store.cases.observations(DEMO_CASE)
    record = TrackRecord.of(store.observations.get([i for kind, i in listed if kind == "tracks"][-1]))
    tracks = record.tracks
    reader.open_tab("series")
    checked = 0
    for rollout, (world, run) in stored(store, DEMO_CASE).items():
        reader.choose(rollout)
        reader.scrub(0.4)
        step = world.time.seconds_per_frame
        if "distance" not in reader.quantities():
            continue
        for quantity in ("distance", "sigmas"):
            for (of, name), value in reader.series(quantity).items():
                if of != rollout or np.isnan(value):
                    continue
                k, column = tracks.names.index(name), run.trajectory.names.index(name)
                row = int(np.argmin(np.abs(tracks.frames * step - reader.time)))
                there = [
                    np.interp(
                        tracks.frames[row] * step, run.trajectory.times, run.trajectory.positions[:, column, axis]
                    )
                    for axis in range(3)
                ]
                size = float(np.linalg.norm((tracks.positions[row, k] - there)[:2]))  # both demos move on the floor
                sigma = float(tracks.position_sigma[row, k])
                right = size if quantity == "distance" else size / sigma
                assert value == pytest.approx(right, rel=0.01, abs=1e-5 if quantity == "distance" else 1e-5 / sigma)
                checked += 1
    assert checked >= 6


def check_fits(reader: Reader, store: EvidenceStore) -> None:
    """Compare fitted values and their intervals with the records of the fits."""
    reader.open_tab("fits")
    for identifier, data in payloads(store, "FitWorld"):
        panel = reader.page.locator(f'[data-fit="{identifier}"]')
        if panel.get_attribute("open") is None:
            panel.locator("summary").first.click()
            reader.settle()
        shown = {d["parameter"]: d for d in reader.data(f'[data-fit="{identifier}"] [data-parameter]')}
        for value in data["values"]:
            check_parameter(shown[value["name"].removeprefix("objects.")], value)


def check_parameter(one: dict[str, str], value: dict[str, Any]) -> None:
    """Compare a fitted value and its interval, on a linear or a logarithmic scale, with its record."""
    assert float(one["value"]) == value["value"]
    assert one["unit"] == value["unit"]
    assert one["atBound"] == str(value["at_bound"]).lower()
    if value["standard_error"] is None:
        assert one["low"] == one["high"] == ""
        return
    at, spread, bounds = value["value"], 1.959964 * value["standard_error"], value["bounds"]
    plain = (max(at - spread, bounds[0]), min(at + spread, bounds[1]))
    factor = np.exp(min(spread / at, 700.0)) if at > 0 else 1.0
    logarithmic = (max(at / factor, bounds[0]), min(at * factor, bounds[1]))
    interval = (float(one["low"]), float(one["high"]))
    assert any(interval == pytest.approx(each, rel=1e-6) for each in (plain, logarithmic)), one


def check_comparisons(reader: Reader, store: EvidenceStore) -> None:
    """Compare distances and events of comparisons with what CompareWorlds answered."""
    for row in [r for r in store.evidence.of_case(DEMO_CASE, tool="CompareWorlds") if r.status == "completed"]:
        arguments, data = row.arguments, store.evidence.get(row.id).payload["data"]
        reader.choose(arguments["base"], arguments["edited"])
        reader.open_tab("comparison")
        shown = {d["object"]: d for d in reader.data(".comparison tr[data-object]")}
        for item in data["objects"]:
            if item["largest_distance"] is not None:
                assert float(shown[item["object"]]["value"]) == pytest.approx(item["largest_distance"])
                assert float(shown[item["object"]]["time"]) == pytest.approx(item["at"])
        changes = reader.data(".comparison tr[data-change]")
        for change in ("gone", "new"):
            times = sorted(e["time"] for e in data["events"][change])
            begins = sorted(float(d["time"]) for d in changes if d["change"] == change and d["kind"] != "contact_end")
            assert begins == pytest.approx(times)


def check_gap(reader: Reader, store: EvidenceStore) -> None:
    """Compare the gap before and after with what AddEffect answered."""
    added = payloads(store, "AddEffect")
    if not added:
        return
    reader.open_tab("gap")
    identifier, data = added[-1]
    step = reader.page.locator(f'[data-gap-step="{identifier}"]')
    for kind, name in (("before", "gap_before"), ("after", "gap_after"), ("noise", "noise_floor")):
        shown = step.locator(f"[data-gap={kind}]").get_attribute("data-value")
        assert float(shown or "nan") == data["sealed"][name], kind
    for effect in data["effects"]:
        for name, number in effect["unknowns"].items():
            value = step.locator(f'[data-parameter="{name}"]').first
            assert float(value.get_attribute("data-value") or "nan") == number["value"]
            assert float(value.get_attribute("data-low") or "nan") == number["interval95"][0]


def test_report_of_a_small_case_shows_what_the_store_holds(pages: Pages, tmp_path: Path) -> None:
    path = tmp_path / "atw.db"
    discs_store(path)
    page = pages.open(report(path, "discs", tmp_path / "report.html"), width=640, height=700)
    reader, store = Reader(page), EvidenceStore.to_read(path)
    reader.scrub(MOMENTS[1])
    assert check_series(reader, stored(store, "discs")) >= 5
    assert page.get_attribute("[data-question]", "data-answer") == "true"
    shown = float(page.get_attribute("[data-agreement]", "data-agreement") or "nan")
    assert shown == pytest.approx(ASIDE * (8 / 15) ** 0.5, rel=1e-3), "the target is seen 7 times, in its place"
    store.close()
