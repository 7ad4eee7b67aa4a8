"""Run-length masks agree with COCO's reference implementation (pycocotools 2.0), whose output is quoted."""

from __future__ import annotations

import numpy as np
import pytest

from atw_mcp.perception.masks import MaskError, RunLengthMask


def blocks() -> np.ndarray:
    mask = np.zeros((7, 9), dtype=bool)
    mask[2:5, 3:8] = True
    mask[0, 0] = True
    return mask


def disc() -> np.ndarray:
    y, x = np.mgrid[0:60, 0:80]
    return np.hypot(x - 40, y - 30) < 22


COCO = [
    (blocks(), "01f02^O00000005"),
    (
        disc(),
        "\\T1=\\16K4M2N2M4M2O0O2N2N2O0O2O000O2O000000000000000000000001N10001N101N2N2N101N3L3N2N3L5JSQ1",
    ),
]


@pytest.mark.parametrize(("mask", "text"), COCO)
def test_compressed_counts_equal_those_of_the_reference(mask: np.ndarray, text: str) -> None:
    assert RunLengthMask.encode(mask).to_dict() == {"size": list(mask.shape), "counts": text}
    assert np.array_equal(RunLengthMask.from_dict({"size": list(mask.shape), "counts": text}).decode(), mask)


def test_plain_counts_run_down_the_columns() -> None:
    record = {"size": [2, 3], "counts": [1, 2, 3]}
    assert np.array_equal(RunLengthMask.from_dict(record).decode(), [[0, 1, 0], [1, 0, 0]])


@pytest.mark.parametrize(
    ("record", "says"),
    [
        ({"counts": [6]}, '"size"'),
        ({"size": [2], "counts": [6]}, r"\[height, width\]"),
        ({"size": [2, 3], "counts": [5]}, "cover 5 pixels"),
        ({"size": [2, 3], "counts": [-1, 7]}, "run lengths >= 0"),
        ({"size": [2, 3], "counts": "1~"}, "character"),
        ({"size": [2, 3], "counts": "o"}, "break off"),
        ("nonsense", "keys"),
    ],
)
def test_malformed_records_are_refused_with_the_reason(record: object, says: str) -> None:
    with pytest.raises(MaskError, match=says):
        RunLengthMask.from_dict(record)
