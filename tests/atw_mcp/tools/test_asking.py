"""Ask, on two blocks that slide to rest: where they stop and whether they meet is known in closed form."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from atw_mcp.probing.asking import disagree
from tests.atw_mcp.session import Session
from tests.polyworld.sliding_block import block_places, stopping_distance

FRICTION, SPEED, SIGMA, FRAMES, HALF = 0.2, 1.0, 0.0005, 7, 0.05
FALL = FRICTION * 9.81  # [m/s^2]
STOP = stopping_distance(FRICTION, SPEED)
WAY = 0.85 * STOP  # that red goes until it meets blue, after the clip
MEET = {"predicate": "collides", "a": "red", "b": "blue"}


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return committed(tmp_path_factory.mktemp("asking"), FRAMES)[0]


def committed(folder: Path, frames: int, way: float = WAY) -> tuple[Session, dict[str, Any]]:
    """Commit a case: red slides towards blue, which rests within its reach; green rests far off."""
    session, path, rng = Session(folder / "atw.db"), folder / "slide.csv", np.random.default_rng(3)
    red = block_places(FRICTION, SPEED, frames)
    rest = {"blue": red[0] + [way + 2 * HALF, 0.0, 0.0], "green": red[0] + [0.0, 2.0, 0.0]}
    places = {"red": red} | {name: np.tile(place, (frames, 1)) for name, place in rest.items()}
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", "object", "x", "y", "z"])
        for k in range(frames):
            for name, own in places.items():
                x, y, z = own[k]
                dx, dy = SIGMA * rng.normal(size=2)
                writer.writerow([0.04 * k, name, x + dx, y + dy, z])
    session("OpenCase", data=str(path), name="slide")
    session("ImportObservation", case="slide", kind="tracks", path=str(path), position_sigma=SIGMA)
    session("BuildWorld", case="slide", default_shape={"kind": "box", "half_extents": [HALF] * 3})
    fitted = session("FitWorld", case="slide", patience_seconds=300)
    session("CommitWorld", case="slide", world=fitted["data"]["world"])
    return session, fitted["data"]


def asked(session: Session, *questions: dict[str, Any], **more: Any) -> list[dict[str, Any]]:
    """Whole answers; an agent is shown them in short."""
    short = session.shown("Ask", case="slide", questions=list(questions), **more)
    whole = session("ReadEvidence", evidence=short["evidence"], detail="full")["data"]["answers"]
    assert [row["answer"] for row in short["data"]["answers"]] == [row["answer"] for row in whole]
    answers: list[dict[str, Any]] = whole
    return answers


def test_every_kind_of_question_has_the_answer_of_the_closed_form(session: Session) -> None:
    alone = [{"action": "remove", "object": "blue"}]
    meets, free, where, fast, far, often, first = asked(
        session,
        {"ask": "when", "predicate": MEET},
        {"ask": "whether", "predicate": {"predicate": "collides", "a": "red"}, "edits": alone},
        {"ask": "where", "object": "red", "edits": alone},
        {"ask": "how_fast", "object": "red", "at": 0.3, "edits": alone},
        {"ask": "how_far", "object": "red", "at": 0.0, "to": "blue"},
        {"ask": "how_often", "predicate": MEET},
        {"ask": "which_first", "predicates": [MEET, {"predicate": "collides", "a": "red", "b": "green"}]},
        horizon_seconds=2.0,
    )
    time = (SPEED - np.sqrt(SPEED**2 - 2 * FALL * WAY)) / FALL
    assert time > 0.04 * (FRAMES - 1)
    assert meets["value"]["95%"][0] < time < meets["value"]["95%"][1]
    assert meets["value"]["median"] == pytest.approx(time, abs=0.03)
    assert free["probability"] < 0.1
    low, high = where["place"]["x"]["95%"]
    assert low < STOP < high
    assert high - low < 0.6 * STOP
    assert where["place"]["y"]["median"] == pytest.approx(0.0, abs=0.01)
    assert fast["value"]["median"] == pytest.approx(SPEED - 0.3 * FALL, abs=0.08)
    assert far["value"]["median"] == pytest.approx(WAY + 2 * HALF, abs=0.003)
    assert often["value"]["median"] == 1
    assert max(first["probabilities"], key=first["probabilities"].get) == "1. collides red blue"


def test_a_place_is_less_sure_after_the_clip_than_in_it(session: Session) -> None:
    alone = [{"action": "remove", "object": "blue"}]
    times = (0.2, 2.0)  # the clip ends at 0.24 s
    seen, later = asked(session, *({"ask": "where", "object": "red", "at": t, "edits": alone} for t in times))
    assert seen["members"] == later["members"] == 64
    widths = [[np.diff(row["place"]["x"][level])[0] for level in ("80%", "95%")] for row in (seen, later)]
    assert widths[1][0] > 3 * widths[0][0]
    assert widths[1][1] > widths[1][0]
    assert seen["place"]["x"]["median"] == pytest.approx(SPEED * 0.2 - 0.5 * FALL * 0.2**2, abs=2 * SIGMA)


def test_each_answer_is_evidence_of_its_own_and_equal_edits_are_run_once(session: Session) -> None:
    edits = [{"action": "set_velocity", "object": "red", "velocity": [0.5, 0, 0]}]
    one, two = asked(
        session,
        {"ask": "whether", "predicate": MEET, "edits": edits},
        {"ask": "where", "object": "red", "edits": edits},
    )
    assert one["rollout"] == two["rollout"]
    assert one["evidence"] != two["evidence"]
    kept = session("ReadEvidence", evidence=one["evidence"])
    assert kept["data"]["probability"] == one["probability"] < 0.1
    assert kept["source"]["rollout"] == one["rollout"]
    assert session("CompareWorlds", base=session("Rollout", case="slide")["data"]["rollout"], edited=one["rollout"])
    again = asked(session, {"ask": "whether", "predicate": MEET, "edits": edits})[0]
    assert again["probability"] == one["probability"]


def test_what_is_not_there_is_unknown_and_not_false(session: Session) -> None:
    gone = [{"action": "remove", "object": "green"}]
    statement = {"predicate": "moving", "object": "green"}
    (row,) = asked(session, {"ask": "whether", "predicate": statement, "edits": gone})
    assert "probability" not in row
    assert row["unknown"] == 64
    assert row["answer"].startswith("unknown: ")


@pytest.mark.parametrize(
    ("question", "said"),
    [
        ({"ask": "wether", "predicate": MEET}, "whether"),
        ({"predicate": MEET}, "'ask'"),
        ({"ask": "where", "object": "rde"}, "red"),
        ({"ask": "where"}, "object is missing"),
        ({"ask": "whether", "predicate": {"predicate": "collide", "a": "red"}}, "collides"),
        ({"ask": "whether", "predicate": MEET, "interval": [2, 1]}, "start <= end"),
        ({"ask": "whether", "predicate": MEET, "edits": [{"action": "remove", "object": "purple"}]}, "green"),
        ({"ask": "where", "object": "red", "at": 5.0}, "after horizon_seconds"),
    ],
)
def test_refusals_name_the_question_and_what_there_is(session: Session, question: dict[str, Any], said: str) -> None:
    first = {"ask": "where", "object": "red"}
    text = session.refused("Ask", case="slide", questions=[first, question], horizon_seconds=1.0)
    assert "question 2" in text
    assert said in text


def test_candidate_worlds_weigh_by_what_they_predicted(tmp_path: Path) -> None:
    """A block with half the friction predicts the frames left out worse, and has a say in proportion; a world may be
    asked before it is committed, and another committed after that."""
    session, fitted = committed(tmp_path, 10, 3 * STOP)
    slippery = [{"paths": ["objects.red.friction"], "lower": 0.09, "upper": 0.11}]
    worse = session("FitWorld", case="slide", world=fitted["world"], parameters=slippery, patience_seconds=300)["data"]
    first, other = fitted["world"], worse["world"]
    question = {"ask": "how_far", "object": "red", "edits": [{"action": "remove", "object": "blue"}], "at": 2.0}

    def answer(*worlds: str) -> tuple[dict[str, Any], Any]:
        shown = session.shown("Ask", case="slide", questions=[question], worlds=list(worlds))["data"]
        return shown["answers"][0]["value"], shown["weights"]

    (alone, only), (wrong, _), (both, weights) = answer(first), answer(other), answer(first, other)
    assert only == {first: 1.0}
    assert abs(wrong["median"] - STOP) > 0.01 > 2.0 * abs(alone["median"] - STOP)
    assert abs(both["median"] - STOP) < 0.005
    side = session.shown("Ask", case="slide", questions=[question], worlds=[first, other])["data"]["answers"][0]
    said = {name.split()[0]: float(words.split()[0]) for name, words in side["by_world"].items()}
    assert said == pytest.approx({first: alone["median"], other: wrong["median"]}, abs=0.005)
    squares = []
    for fit in (fitted, worse):
        about = next(body for body in fit["prediction"]["bodies"] if body["object"] == "red")
        squares.append(about["error"] ** 2 + about["noise"] ** 2)  # blue and green do not move
    assert squares[1] > 9.0 * squares[0]
    assert weights[other] / weights[first] == pytest.approx(
        squares[0] / squares[1], rel=0.3
    )  # a planar world: two coordinates
    assert weights[first] + weights[other] == pytest.approx(1.0, abs=1e-5)
    for world in (other, first):
        assert session("CommitWorld", case="slide", world=world)["source"]["world"] == world
        assert session("Ask", case="slide", questions=[question])["source"]["world"] == world


def test_what_does_not_happen_is_said_of_the_time_that_was_run_alone(session: Session) -> None:
    never = {"predicate": "collides", "a": "red", "b": "green"}  # which rests 2 m aside
    (answer,) = asked(session, {"ask": "when", "predicate": never}, horizon_seconds=1.5)
    assert answer["answer"].startswith("not until 1.5 s, in any member")


def test_a_list_of_numbers_in_an_edit_is_answered_for_each(session: Session) -> None:
    """From v the block stops after v^2 / (2 mu g)."""
    alone = {"action": "remove", "object": "blue"}
    factors = [0.5, 1.0, 1.5]
    scan = {"ask": "how_far", "object": "red", "edits": [alone, {"action": "scale_velocity", "object": "red"}]}
    scan["edits"][1]["factor"] = factors
    *rows, last = asked(session, scan, {"ask": "whether", "predicate": MEET}, horizon_seconds=2.0)
    assert last["question"] == "whether collides red blue"
    for factor, row in zip(factors, rows, strict=True):
        assert f"scale_velocity red factor={factor:g}" in row["question"]
        assert row["value"]["median"] == pytest.approx(factor**2 * STOP, rel=0.15)
    two = {**scan, "edits": [*scan["edits"], {"action": "scale_parameter", "path": "objects.red.friction"}]}
    two["edits"][2]["factor"] = [1, 2]
    assert "one number at a time" in session.refused("Ask", case="slide", questions=[two])
    text = session.refused("Ask", case="slide", questions=[scan, {"ask": "where", "object": "rde"}])
    assert text.startswith("question 2")
    many = {**scan, "edits": [{"action": "scale_velocity", "object": "red", "factor": [0.1 * k for k in range(1, 40)]}]}
    assert "ask for 32 at most" in session.refused("Ask", case="slide", questions=[many])


def test_whether_may_name_one_moment_and_rest_has_a_time(session: Session) -> None:
    """It has stopped by v / (mu g), and is at rest for sure some time later."""
    alone = [{"action": "remove", "object": "blue"}]
    rest, stop = {"predicate": "at_rest", "object": "red"}, {"predicate": "comes_to_rest", "object": "red"}
    early, late, stops = asked(
        session,
        {"ask": "whether", "predicate": rest, "at": 0.3, "edits": alone},
        {"ask": "whether", "predicate": rest, "at": 1.5, "edits": alone},
        {"ask": "when", "predicate": stop, "edits": alone},
        horizon_seconds=2.0,
    )
    assert early["probability"] < 0.1
    assert late["probability"] > 0.95
    assert late["question"].endswith("at 1.5 s")
    low, high = stops["value"]["95%"]
    assert low < SPEED / FALL < high < 1.0
    both = {"ask": "whether", "predicate": rest, "at": 1.0, "interval": [0, 1]}
    assert "at or interval" in session.refused("Ask", case="slide", questions=[both])


def test_an_answer_names_constants_as_the_fit_does_and_only_those_that_it_hangs_on(tmp_path: Path) -> None:
    """Where red stops, seen for 0.2 s, hangs on its speed; that it does not reach green, far off, on nothing."""
    session, fitted = committed(tmp_path, 6)
    alone = [{"action": "remove", "object": "blue"}]
    stops, misses = asked(
        session,
        {"ask": "how_far", "object": "red", "edits": alone},
        {"ask": "whether", "predicate": {"predicate": "nearer_than", "a": "red", "b": "green", "distance": 0.5}},
        horizon_seconds=2.0,
    )
    names = {value["name"] for value in fitted["values"]}
    assert stops["goes_with"]
    for row in stops["goes_with"]:
        assert row["parameter"] in names or row["parameter"].startswith(("red.position", "red.velocity"))
    assert misses["probability"] < 0.05
    assert "goes_with" not in misses


def test_a_body_that_enters_later_is_asked_about_from_then_on(tmp_path: Path) -> None:
    """It is not there before: neither unknown nor a collision."""
    session = Session(tmp_path / "atw.db")
    path = tmp_path / "late.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", "object", "x", "y", "z"])
        for k in range(8):
            writer.writerow([0.04 * k, "blue", 0.9, 0.0, HALF])
            if k >= 2:
                writer.writerow([0.04 * k, "red", 0.04 * (k - 2), 0.0, HALF])
    session("OpenCase", data=str(path), name="slide")
    session("ImportObservation", case="slide", kind="tracks", path=str(path), position_sigma=SIGMA)
    session("BuildWorld", case="slide", default_shape={"kind": "box", "half_extents": [HALF] * 3})
    world = session("FitWorld", case="slide", patience_seconds=300)["data"]["world"]
    session("CommitWorld", case="slide", world=world)
    meets, before = asked(
        session,
        {"ask": "whether", "predicate": MEET, "interval": [0.0, 0.4]},
        {"ask": "whether", "predicate": MEET, "interval": [0.0, 0.04]},
    )
    assert meets["probability"] < 0.2  # 0.8 m at 1 m/s take longer
    assert "from 0.08 s on, when red enters" in meets["answer"]
    assert before["answer"].startswith("unknown: ")


def test_the_questions_that_the_pages_show_are_read(session: Session) -> None:
    """With the names of this case in place of the page's."""
    pages = "".join(page.read_text("utf-8") for page in (Path(__file__).parents[3] / ".docs" / "pages").glob("*.md"))
    (text,) = re.findall(r"call Ask case=slide questions='(.*)'$", pages, re.MULTILINE)
    for written, here in (("puck", "red"), ("wall", "blue"), ("cube", "green")):
        text = text.replace(f'"{written}"', f'"{here}"')
    where, whether = asked(session, *json.loads(text))
    assert where["place"]["x"]["median"] > 0.0
    assert whether["probability"] > 0.5


def test_worlds_that_disagree_are_not_averaged(tmp_path: Path) -> None:
    """Whether the blocks rebound no frame shows: two worlds predict all frames equally well and part after it."""
    way = 0.95 * STOP  # they meet after the tenth frame
    session, _ = committed(tmp_path, 10, way)
    drafts = []
    for value in (0.05, 0.95):
        fixed = {"lower": value, "upper": value + 0.01}
        tied = [{"paths": [f"objects.{name}.restitution" for name in ("red", "blue", "green")], **fixed}]
        made = session("FitWorld", case="slide", parameters=tied, patience_seconds=300)
        drafts.append(made["data"]["world"])
    speed = np.sqrt(SPEED**2 - 2 * FALL * way)  # of red where it meets blue; of equal masses
    short, far = ((0.5 * (1.0 + e) * speed) ** 2 / (2 * FALL) for e in (0.055, 0.955))
    beyond = {"predicate": "moved_by_more_than", "object": "blue", "distance": 0.5 * (short + far)}
    question = {"ask": "whether", "predicate": beyond, "at": 2.0}
    torn = session.shown("Ask", case="slide", questions=[question], worlds=drafts)["data"]["answers"][0]
    assert torn["disagree"] is True
    assert "probability" not in torn
    assert torn["answer"].startswith("the worlds disagree")
    alone = [session.shown("Ask", case="slide", questions=[question], worlds=[w])["data"]["answers"] for w in drafts]
    assert [rows[0]["probability"] > 0.5 for rows in alone] == [False, True]


def test_places_that_differ_by_rounding_along_one_axis_agree() -> None:
    def place(x: float, z: float) -> dict[str, Any]:
        return {"place": {"x": {"80%": [x - 0.3, x + 0.3]}, "z": {"80%": [z, z]}}}

    assert not disagree([place(1.781, 0.167), place(1.784, 0.1671)], [0.5, 0.5])
    assert disagree([place(1.8, 0.167), place(1.8, 0.4)], [0.5, 0.5])
    assert disagree([place(1.0, 0.167), place(1.8, 0.167)], [0.5, 0.5])


def test_a_ball_is_nowhere_below_the_floor_that_it_bounces_on(tmp_path: Path) -> None:
    session, path, radius = Session(tmp_path / "atw.db"), tmp_path / "drop.csv", 0.05
    times = 0.02 * np.arange(18)
    heights = 1.0 - 0.5 * 9.81 * times**2 + 0.0005 * np.random.default_rng(4).normal(size=len(times))
    rows = [f"{t:.2f},ball,{0.5 * t:.6f},0,{z:.6f}" for t, z in zip(times, heights, strict=True)]
    path.write_text("\n".join(["t,object,x,y,z", *rows]))
    session("OpenCase", data=str(path), name="slide")
    session("ImportObservation", case="slide", kind="tracks", path=str(path), position_sigma=0.0005)
    session("BuildWorld", case="slide", default_shape={"kind": "sphere", "radius": radius}, floor=0.0)
    fitted = session("FitWorld", case="slide", patience_seconds=300)
    session("CommitWorld", case="slide", world=fitted["data"]["world"], even_if_poor=True)
    (found,) = asked(session, {"ask": "where", "object": "ball", "at": 1.2})
    assert found["place"]["z"]["95%"][0] > radius - 0.005
    assert found["place"]["z"]["95%"][1] > radius + 0.1
    (falling,) = asked(session, {"ask": "where", "object": "ball", "at": 0.42})  # before it lands; nothing later is run
    low, high = falling["place"]["z"]["95%"]
    middle = falling["place"]["z"]["median"]
    assert middle - low == pytest.approx(high - middle, rel=0.2)
