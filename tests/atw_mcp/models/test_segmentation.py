"""Promptable segmentation: against the library's own loop over a video, and from masks to an observation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from atw_mcp.models import Limits, ModelError, PredictedMasks, Prompt, Provenance, follow, open_folder, prompts_from
from atw_mcp.models.folders import ModelFolder
from atw_mcp.models.images import IMAGENET
from atw_mcp.perception.video import load
from tests.atw_mcp.models import tiny
from tests.atw_mcp.perception.clips import Clip, Disc, render

CPU = Limits("cpu", 4)


def clip(path: Path, count: int = 12) -> Clip:
    red = Disc(lambda t: (40.0 + 4.0 * t, 60.0), 14.0, (40, 40, 200))
    blue = Disc(lambda t: (200.0 - 4.0 * t, 110.0), 17.0, (200, 70, 40))
    return render(path, [red, blue], count)


def noise(count: int = 12, size: int = 128) -> NDArray[np.uint8]:
    """Frames of the tiny models' own input size, so that resizing changes nothing."""
    return np.random.default_rng(0).integers(0, 256, (count, size, size, 3), dtype=np.uint8)


def test_masks_are_those_of_the_librarys_own_propagation(tmp_path: Path) -> None:
    torch, transformers = tiny.libraries()
    model = open_folder(tiny.sam2(tmp_path / "sam2"))
    frames = noise()
    found = follow(model, frames, [Prompt("a", 4, (20, 30, 40, 50), ((35, 45),), ((100, 100),))], CPU)

    network = transformers.Sam2VideoModel.from_pretrained(str(model.path)).eval()
    rgb = torch.from_numpy(frames[..., ::-1].copy()).permute(0, 3, 1, 2).float() / 255
    mean, std = (torch.tensor(v).view(1, 3, 1, 1) for v in IMAGENET)
    session = transformers.Sam2VideoInferenceSession(
        video=(rgb - mean) / std, video_height=128, video_width=128, dtype=torch.float32
    )
    session.add_point_inputs(
        session.obj_id_to_idx(1),
        4,
        {
            "point_coords": torch.tensor([[[[20.0, 30], [60, 80], [35, 45], [100, 100]]]]),
            "point_labels": torch.tensor([[[2, 3, 1, 0]]], dtype=torch.int32),
        },
    )
    session.obj_with_new_inputs = [1]
    with torch.inference_mode():
        network(session, frame_idx=4)
    logits = {}
    for reverse in (False, True):
        for output in network.propagate_in_video_iterator(session, start_frame_idx=4, reverse=reverse):
            logits[output.frame_idx] = torch.nn.functional.interpolate(output.pred_masks, (128, 128), mode="bilinear")
    expected = np.stack([logits[t][0, 0].numpy() > 0 for t in range(len(frames))])
    assert expected.any()
    assert not expected.all()
    assert (found.masks["a"] == expected).mean() > 0.9999  # rounding where a logit is near 0


@pytest.mark.parametrize("make", [tiny.sam2, tiny.sam3])
def test_objects_of_different_frames_are_followed_through_all(tmp_path: Path, make: Callable[[Path], Path]) -> None:
    model = open_folder(make(tmp_path / "model"))
    frames = load(clip(tmp_path / "clip.mp4").path)[1]
    prompts = [
        Prompt("red", 3, (38, 46, 28, 28)),
        Prompt("blue", 8, None, ((168, 110),)),
        Prompt("blue", 10, (143, 93, 34, 34)),
    ]
    shares: list[float] = []
    found = follow(model, frames, prompts, CPU, progress=lambda share, _what: shares.append(share))
    assert list(found.masks) == ["red", "blue"]
    assert all(m.shape == frames.shape[:3] for m in found.masks.values())
    assert not (found.masks["red"] & found.masks["blue"]).any()
    assert all((s > 0.5).all() for s in found.scores.values())
    assert shares == sorted(shares)
    made = found.provenance.to_dict()
    assert made["device"] == "cpu"
    assert made["licence"] == "unknown"
    assert len(made["weights_sha256"]) == 64
    assert made["versions"]["torch"]


def test_equal_inputs_give_equal_masks_for_any_batch(tmp_path: Path) -> None:
    model = open_folder(tiny.sam2(tmp_path / "sam2"))
    prompts = [Prompt("a", 2, (20, 30, 40, 50)), Prompt("b", 2, (70, 30, 40, 50))]
    one, many = (follow(model, noise(6), prompts, Limits("cpu", batch)) for batch in (1, 2))
    for name in ("a", "b"):
        assert (one.masks[name] == many.masks[name]).mean() > 0.999


def test_impossible_prompts_are_refused(tmp_path: Path) -> None:
    model = ModelFolder("none", tmp_path, "segmentation", "sam2_video", "unknown", 0)
    frames = noise(4)
    for prompts, text in (
        ([], "nothing to follow"),
        ([Prompt("a", 0)], "a box or positive points"),
        ([Prompt("a", 9, (1, 1, 5, 5))], "no frame 9"),
        ([Prompt("a", 0, (200, 1, 5, 5))], "outside the image"),
        ([Prompt("a", 0, None, ((500, 1),))], "outside the image"),
        ([Prompt("a", 0, (1, 1, 5, 5)), Prompt("a", 0, (1, 1, 6, 6))], "two prompts in one frame"),
    ):
        with pytest.raises(ModelError, match=text):
            follow(model, frames, prompts, CPU)


def test_weights_of_another_model_are_refused(tmp_path: Path) -> None:
    tiny.libraries()
    path = tiny.sam2(tmp_path / "sam2")
    config = (path / "config.json").read_text()
    (path / "config.json").write_text(config.replace('"memory_fuser_num_layers": 1', '"memory_fuser_num_layers": 2'))
    with pytest.raises(ModelError, match="the weights lack"):
        follow(open_folder(path), noise(3), [Prompt("a", 0, (1, 1, 50, 50))], CPU)


def test_recorded_masks_become_the_observation_they_describe(tmp_path: Path) -> None:
    drawn = clip(tmp_path / "clip.mp4")
    info, frames = load(drawn.path)
    model = ModelFolder("recorded", tmp_path, "segmentation", "sam2_video", "unknown", 0)
    scores = {"red": np.ones(12), "blue": np.linspace(1.0, 0.4, 12), "lost": np.zeros(12)}
    masks = {"red": drawn.truth[0], "blue": drawn.truth[1], "lost": np.zeros_like(drawn.truth[0])}
    seen = PredictedMasks(masks, scores, Provenance(model, "cpu", 1)).observation(info, frames, tuple(range(12)))
    assert seen.names == ("red", "blue")
    assert any("lost" in text for text in seen.warnings)
    for k, name in enumerate(seen.names):
        item = seen.object(name)
        assert item.colour.name == name
        assert np.abs(item.centroid - drawn.centres(k)).max() < 1e-9
        assert set(item.status) == {"visible"}
    assert seen.object("red").confidence[11] == pytest.approx(0.97)
    assert seen.object("blue").confidence[11] == pytest.approx(0.4 * 0.97, abs=1e-3)


def test_prompts_point_into_each_object_of_an_observation(tmp_path: Path) -> None:
    drawn = clip(tmp_path / "clip.mp4")
    info, frames = load(drawn.path)
    model = ModelFolder("recorded", tmp_path, "segmentation", "sam2_video", "unknown", 0)
    late = drawn.truth[1].copy()
    late[:7] = False
    masks = {"red": drawn.truth[0], "late": late}
    ones = {name: np.ones(12) for name in masks}
    seen = PredictedMasks(masks, ones, Provenance(model, "cpu", 1)).observation(info, frames, tuple(range(12)))
    prompts = prompts_from(seen)
    assert [p.object for p in prompts] == ["red", "late"]
    assert len({p.row for p in prompts}) == 1  # one frame shows both
    assert prompts[0].row >= 7
    for prompt in prompts:
        (u, v), mask = prompt.positive[0], masks[prompt.object][prompt.row]
        assert mask[round(v), round(u)]
        assert prompt.box is not None
        y, x = np.nonzero(mask)
        assert prompt.box == (x.min(), y.min(), np.ptp(x) + 1, np.ptp(y) + 1)
