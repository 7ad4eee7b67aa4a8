"""Records of shapes: read back as written, cut and joined without losing which frame is which."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from polyworld.data.shape_series import ShapeSeries
from polyworld.data.tracks import ObservedTracks, shapes_only
from polyworld.probing.readouts import Amount, Centreline, Outline


def centreline(frames: int = 4, **fields: Any) -> ShapeSeries:
    values = np.arange(frames * 3 * 3, dtype=float).reshape(frames, 3, 3) / 7.0
    values[1, 2] = np.nan
    confidence = np.ones((frames, 3))
    confidence[1, 2] = 0.0
    return ShapeSeries(
        Centreline(object="rope", count=3), values, np.full((frames, 3), 0.01), fields.get("confidence", confidence)
    )


def level(frames: int) -> ShapeSeries:
    ones = np.ones((frames, 1))
    return ShapeSeries(
        Amount(object="water", container="cup"), np.linspace(0, 1, frames)[:, None, None], 0.1 * ones, ones
    )


def test_a_record_with_shapes_is_read_back_exactly_from_its_json() -> None:
    record = shapes_only((centreline(), level(4)), np.arange(4), 0.04)
    again = ObservedTracks.from_dict(json.loads(json.dumps(record.to_dict(), allow_nan=False)))
    for a, b in zip(record.shapes, again.shapes, strict=True):
        assert a.readout == b.readout
        for field in ("values", "sigma", "confidence"):
            np.testing.assert_array_equal(getattr(a, field), getattr(b, field))


def test_a_value_with_confidence_but_without_number_or_sigma_is_refused() -> None:
    with pytest.raises(ValueError, match="must be finite"):
        centreline(confidence=np.ones((4, 3)))
    series = level(3)
    with pytest.raises(ValueError, match="sigma must be above 0"):
        ShapeSeries(series.readout, series.values, 0.0 * series.sigma, series.confidence)
    with pytest.raises(ValueError, match="unit vectors"):
        Outline(object="ball", directions=((1.0, 1.0, 0.0),))


def test_windows_and_selections_keep_the_shapes_that_belong() -> None:
    record = shapes_only((centreline(), level(4)), np.array([2, 4, 6, 8]), 0.04)
    cut = record.window(4, 6)
    assert cut.frames.tolist() == [4, 6]
    assert cut.shapes[1].values[:, 0, 0] == pytest.approx([1 / 3, 2 / 3])
    assert [s.object for s in record.select(["water"]).shapes] == ["water"]
    assert record.observed_names == ("rope", "water")
    with pytest.raises(KeyError, match="unknown track"):
        record.select(["stone"])


def test_shapes_of_other_frames_join_a_record_and_replace_the_same_readout() -> None:
    record = shapes_only((level(3),), np.array([0, 2, 4]), 0.04)
    joined = record.with_shapes((centreline(),), np.array([1, 2, 3, 4]))
    assert joined.frames.tolist() == [0, 1, 2, 3, 4]
    assert joined.shapes[0].confidence[:, 0].tolist() == [1.0, 0.0, 1.0, 0.0, 1.0]
    assert joined.shapes[1].values[2:4, 0, 0] == pytest.approx([9 / 7, 18 / 7])
    newer = joined.with_shapes((level(2),), np.array([0, 4]))
    assert len(newer.shapes) == 2
    assert newer.shapes[1].confidence[:, 0].tolist() == [1.0, 0.0, 0.0, 0.0, 1.0]
