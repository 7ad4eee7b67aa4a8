"""Text beside pictures of each object: one row over all frames; the evidence keeps every frame."""

from __future__ import annotations

from typing import Any

import numpy as np

EVERY_FRAME = "ReadEvidence(EVIDENCE, path='frames') has every object in every picture"


def observed_rows(frames: list[dict[str, Any]]) -> dict[str, Any]:
    """Observed objects over the frames shown: lists in the order of the frames, null where there is nothing.

    frames: rows with "frame", "time" and "objects" (None where the frame was not looked at).
    """
    seen = [{item["name"]: item for item in row.get("objects") or []} for row in frames]
    names = list(dict.fromkeys(name for row in seen for name in row))
    rows = []
    for name in names:
        items = [row.get(name, {}) for row in seen]
        status = [item.get("status") for item in items]
        confidence = [item["confidence"] for item in items if "confidence" in item]
        rows.append(
            {
                "name": name,
                "status": status[0] if len(set(status)) == 1 else status,
                "centroid": [_whole(item.get("centroid")) for item in items],
                "area": [item.get("area", 0) for item in items],
                "least_confidence": min(confidence) if confidence else None,
            }
        )
    return {
        "frames": [row["frame"] for row in frames],
        "times": [row["time"] for row in frames],
        "objects": rows,
    }


def simulated_rows(
    frames: list[dict[str, Any]], fit: dict[str, Any] | None, worst: dict[str, tuple[float, int]]
) -> dict[str, Any]:
    """Simulated objects over the frames shown, and where they are in the last of them.

    fit: errors over all observed frames (`RolloutView.accuracy`). worst: by object, the largest [m] and its frame.
    """
    rows = []
    for name in [item["name"] for item in frames[-1]["objects"]]:
        items = [next(i for i in row["objects"] if i["name"] == name) for row in frames]
        row: dict[str, Any] = {"name": name, "last_position": items[-1].get("position")}
        hidden = [f["frame"] for f, i in zip(frames, items, strict=True) if i.get("visible_pixels") == 0]
        absent = [f["frame"] for f, i in zip(frames, items, strict=True) if "position" not in i]
        overlaps = [i["overlap"] for i in items if "overlap" in i]
        if hidden:
            row["not_in_the_picture"] = hidden
        if absent:
            row["not_yet_simulated"] = absent
        if any("from_base_m" in i for i in items):
            row["from_base_m"] = [i.get("from_base_m") for i in items]
        if fit is not None:
            row["position_rmse"] = fit["position_rmse_by_object"].get(name)
            row["rotation_rmse"] = fit["rotation_rmse_by_object"].get(name)
        if name in worst:
            row["worst_error_m"], row["worst_at_frame"] = worst[name]
        if overlaps:
            row["mean_overlap"] = round(float(np.mean(overlaps)), 3)
        rows.append(row)
    return {
        "frames": [row["frame"] for row in frames],
        "times": [row["time"] for row in frames],
        "over_video": all(row["over_video"] for row in frames),
        "objects": rows,
        "error": None if fit is None else {key: value for key, value in fit.items() if not key.endswith("_by_object")},
    }


def _whole(point: list[float] | None) -> list[int] | None:
    return None if point is None else [round(v) for v in point]
