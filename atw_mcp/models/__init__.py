"""Learned models from local weights behind the same observations: the optional extra `atw-mcp[models]`.

model = find_model("sam2.1-hiera-tiny")               # a folder under ATW_MODELS
found = follow(model, frames, prompts, Limits())      # masks; then .observation(...), as from OpenCV
"""

from atw_mcp.models.depth import PredictedDepth, predict_depth
from atw_mcp.models.floor import camera_over_floor, intrinsics_of
from atw_mcp.models.folders import ModelError, ModelFolder, available, find_model, open_folder
from atw_mcp.models.mesh import PredictedMesh, meshes
from atw_mcp.models.points import PredictedPoints, Query, follow_points, queries_on
from atw_mcp.models.pose import poses
from atw_mcp.models.rotations import rotations
from atw_mcp.models.running import Limits, Provenance
from atw_mcp.models.segmentation import PredictedMasks, Prompt, follow, prompts_from

__all__ = [
    "Limits",
    "ModelError",
    "ModelFolder",
    "PredictedDepth",
    "PredictedMasks",
    "PredictedMesh",
    "PredictedPoints",
    "Prompt",
    "Provenance",
    "Query",
    "available",
    "camera_over_floor",
    "find_model",
    "follow",
    "follow_points",
    "intrinsics_of",
    "meshes",
    "open_folder",
    "poses",
    "predict_depth",
    "prompts_from",
    "queries_on",
    "rotations",
]
