"""Scores of questions against hand counts, folders of the official layouts, and programs on a made-up world."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.benchmarks import questions_clevrer, questions_pulleys
from tests.benchmarks.clevrer_programs import Happening, Known, Thing
from tests.benchmarks.pulley_worlds import Layout
from tests.benchmarks.question_folders import Asked, AskedPulleys, clevrer_scenes, pulley_scenes
from tests.benchmarks.question_scores import Judged, Question, SceneRun, causes, rows, wilson
from tests.benchmarks.question_worlds import Track, annotated, named_shapes, straight
from tests.benchmarks.questions_clevrer import cause, same_events
from tests.benchmarks.questions_pulleys import way_of


def asked(kind: str, *options: tuple[object, object], family: str = "", why: str = "fit") -> Question:
    judged = tuple(Judged(said, right, right) for said, right in options)
    return Question("7", "CLEVRER", kind, "?", judged, why, family)


def test_scores_are_what_a_hand_count_gives() -> None:
    questions = [
        asked("predictive", (True, True), (False, False)),
        asked("predictive", (True, False), (False, False)),
        asked("predictive", (None, True), (False, False)),
        asked("descriptive", ("2", "2"), family="count"),
        asked("descriptive", ("3", "2"), family="count"),
        asked("descriptive", ("red", "red"), family="query_color"),
    ]
    predictive, descriptive, whole = rows(questions)
    assert (predictive.options, predictive.right_options, predictive.unanswered) == (6, 4, 1)
    assert (predictive.questions, predictive.right_questions) == (3, 1)
    # Most options are wrong: "always wrong" judges 4 of 6 rightly, and one question as a whole.
    assert (predictive.majority_options, predictive.majority_questions) == (4, 1)
    assert (predictive.line_options, predictive.line_questions) == (6, 3)
    # The usual answer is counted among questions of one kind: 2 of counts, red of colours.
    assert (descriptive.right_questions, descriptive.majority_questions) == (2, 3)
    assert (whole.kind, whole.options, whole.right_options, whole.right_questions) == ("all", 9, 6, 3)
    assert causes(questions) == {"CLEVRER predictive": {"fit": 2}, "CLEVRER descriptive": {"fit": 1}}


def test_wilson_intervals_are_those_of_the_tables() -> None:
    assert wilson(8, 10) == pytest.approx((0.4902, 0.9433), abs=1e-4)  # Newcombe 1998's method 3
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)


def test_a_kept_run_reads_as_it_was() -> None:
    run = SceneRun("7", "CLEVRER", "video", 3.0, 20, None, {"rmse": 0.01}, [asked("predictive", (True, False))])
    assert SceneRun.from_dict(json.loads(json.dumps(run.to_dict()))) == run


def test_questions_of_a_scene_that_failed_count_as_wrong() -> None:
    choices = [{"program": [], "answer": "correct"}, {"program": [], "answer": "wrong"}]
    predictive = {"question": "?", "question_type": "predictive", "program": [], "choices": choices}
    lost = questions_clevrer.unanswered(Asked("7", None, None, Path(), (predictive,)), "video", "its worker died")
    open_ended = {"question": "?", "answer": "yes", "program": [], "answer_type": "open_ended"}
    pulleys = AskedPulleys("8", None, Path(), {"mass": [open_ended]})
    also = questions_pulleys.unanswered(pulleys, "video", "its worker died")
    table = rows([*lost.questions, *also.questions])
    assert [(r.kind, r.options, r.questions, r.right_questions, r.unanswered) for r in table] == [
        ("predictive", 2, 1, 0, 2),
        ("property", 1, 1, 0, 1),
    ]
    assert lost.questions[0].cause == also.questions[0].cause == "no world"


def test_scenes_are_found_in_the_layout_of_the_downloads(tmp_path: Path) -> None:
    scene = {"scene_index": 10003, "video_filename": "video_10003.mp4", "questions": [{"question_id": 0}]}
    (tmp_path / "validation.json").write_text(json.dumps([scene, {**scene, "scene_index": 10004}]))
    folder = tmp_path / "annotation_validation" / "annotation_10000-11000"
    folder.mkdir(parents=True)
    (folder / "annotation_10003.json").write_text("{}")
    (found,) = clevrer_scenes(tmp_path, tmp_path / "elsewhere.json")  # of 10004 there is nothing but questions
    assert (found.number, found.video, found.camera.name) == ("10003", None, "elsewhere.json")
    video = tmp_path / "pulley_group" / "12"
    video.mkdir(parents=True)
    (video / "outputs.json").write_text("{}")
    (tmp_path / "questions").mkdir()
    (tmp_path / "questions" / "12.json").write_text(json.dumps({"video_id": "12", "question_dict": {"mass": []}}))
    (pulleys,) = pulley_scenes(tmp_path)
    assert (pulleys.number, pulleys.video, pulleys.questions) == ("12", None, {"mass": []})


THINGS = [Thing(n, c, "rubber", "cube") for n, c in (("a", "red"), ("b", "blue"), ("c", "gray"))]


def test_straight_lines_go_on_after_the_clip_and_stop_at_nothing() -> None:
    frames = np.arange(40)[:, None]
    moves = np.hstack([-2.0 + 0.05 * frames, 0.0 * frames])  # at x = -0.05 in the last frame
    still, aside = np.tile([1.0, 0.0], (40, 1)), np.tile([0.0, 3.0], (40, 1))
    tracks = (Track("a", moves), Track("b", still), Track("c", aside))
    known = straight(Known(THINGS, [], last=39.0), tracks)
    assert known.events == []
    (met,) = known.unseen
    assert met.objects == {"a", "b"}
    assert 39 < met.frame <= 39 + 21  # a metre away at 0.05 m a frame
    assert known.moving("a", 0.0) is True
    assert known.moving("b", 39.0) is False
    assert known.without("c") == []  # the clip's first frames, drawn out to its end, do not reach


def annotation() -> dict[str, object]:
    def item(k: int, x: float, speed: float) -> dict[str, object]:
        return {"object_id": k, "location": [x, 0, 0.2], "velocity": [speed, 0, 0], "inside_camera_view": x > -3}

    return {
        "object_property": [
            {"object_id": 0, "color": "red", "material": "rubber", "shape": "cube"},
            {"object_id": 1, "color": "blue", "material": "metal", "shape": "sphere"},
        ],
        "motion_trajectory": [
            {"frame_id": f, "objects": [item(0, -4.0 + f, 1.0), item(1, 0.0, 0.0)]} for f in range(5)
        ],
        "collision": [{"object_ids": [0, 1], "frame_id": 3, "location": [0, 0, 0.2]}],
    }


def test_wrong_answers_are_put_down_to_what_went_wrong() -> None:
    truth = annotated(annotation())
    assert [(e.kind, e.frame) for e in truth.events] == [("in", 2.0), ("collision", 3.0)]
    assert truth.moving("red_rubber_cube", 0.0) is None
    predictive = {"question_type": "predictive", "choices": [{}]}
    wrong = asked("predictive", (True, False))
    same = {t.name: t.name for t in truth.things}
    assert same_events(truth, truth, same)
    assert cause(predictive, wrong, truth, truth) == "prediction"
    late = Known(truth.things, [truth.events[0], Happening("collision", 9.0, truth.events[1].objects)])
    assert cause(predictive, wrong, late, truth) == "fit"
    assert cause(predictive, wrong, Known(truth.things[:1], truth.events), truth) == "observation"
    count = {"question_type": "descriptive", "program": ["events", "objects", "filter_collision", "count"]}
    assert cause(count, asked("descriptive", ("0", "2")), truth, truth) == "program"  # the annotation says 1


LAYOUT = Layout(
    ropes=(
        ("red cube", "blue pulley", "pink sphere"),
        ("green fixed point", "gray pulley", "cyan pulley", "black cube"),
    ),
    kinds={
        "red cube": "cube",
        "blue pulley": "pulley",
        "pink sphere": "sphere",
        "green fixed point": "fixed",
        "gray pulley": "movable",
        "cyan pulley": "pulley",
        "black cube": "cube",
        "white cube": "cube",
    },
    places={},
    radii={},
    hung={"gray pulley": "white cube"},
    half_size=0.1,
    seconds_per_frame=1 / 30,
    offset=(0.0, 0.0),
)


def test_wheels_turn_as_the_rope_runs_over_and_under_them() -> None:
    rises = {"red cube": 0.2, "pink sphere": -0.2, "black cube": 0.3, "white cube": -0.15}
    assert way_of(LAYOUT, rises, "blue pulley", "rotation") == "clockwise"  # the right side sinks
    assert way_of(LAYOUT, rises, "cyan pulley", "rotation") == "anti-clockwise"
    assert way_of(LAYOUT, rises, "gray pulley", "rotation") == "clockwise"  # its right strand runs down, under it
    assert way_of(LAYOUT, rises, "gray pulley", "motion") == "down"
    assert way_of(LAYOUT, rises, "cyan pulley", "motion") == "stationary"
    assert LAYOUT.loads(LAYOUT.ropes[1]) == ["black cube", "white cube"]


def test_shapes_that_were_not_made_out_are_those_that_questions_name() -> None:
    choice = {"program": ["all_events", "objects", "red", "filter_color", "cube", "filter_shape", "unique"]}
    about = {"program": ["objects", "gray", "filter_color", "sphere", "filter_shape", "exist"], "choices": [choice]}
    seen = {"red_object": "other", "gray_cube": "cube", "blue_object": "other"}
    assert named_shapes(seen, [about]) == {"red_object": "cube"}  # gray's was made out, of blue nothing is said
    assert named_shapes({**seen, "red_sphere": "sphere"}, [about]) == {}  # which of two red ones is meant?
