"""Perception from plain video: masks and identities, cameras, motion in the world, corrections, importers.

info = probe("clip.mp4")
observation = observe("clip.mp4")                     # masks and names, in pixels
camera = calibrate_from_points(points, pixels, (w, h)).camera
solids = estimate_sizes(observation, camera)
tracks = world_tracks(observation, camera, {n: s.solid for n, s in solids.items()}, seconds_per_frame=0.04)

`video` reads, `observe` finds and follows, `calibration` gives the camera, `tracks` turns masks into places in the
world, `given_places` applies places that are known.
"""

from atw_mcp.perception.calibration import (
    Calibration,
    CalibrationError,
    calibrate_from_homography,
    calibrate_from_known_length,
    calibrate_from_points,
    calibrate_given,
)
from atw_mcp.perception.correction import correct
from atw_mcp.perception.corrections import (
    Correction,
    Drop,
    Exclude,
    Merge,
    Outline,
    Place,
    Rename,
    Shadow,
    Split,
    Stay,
    correction_of,
)
from atw_mcp.perception.import_files import ImportDataError
from atw_mcp.perception.import_images import (
    DepthMaps,
    ImportedMesh,
    import_camera,
    import_depth,
    import_masks,
    import_mesh,
)
from atw_mcp.perception.import_tracks import clevrer_appearances, import_tracks
from atw_mcp.perception.masks import MaskError, RunLengthMask
from atw_mcp.perception.observation import Cue, ImageObservation, ObservationError, ObservedObject
from atw_mcp.perception.observe import observe
from atw_mcp.perception.tracks import SolidEstimate, estimate_sizes, world_tracks
from atw_mcp.perception.video import PerceptionCancelled, VideoError, VideoInfo, probe, read_frames

__all__ = [
    "Calibration",
    "CalibrationError",
    "Correction",
    "Cue",
    "DepthMaps",
    "Drop",
    "Exclude",
    "ImageObservation",
    "ImportDataError",
    "ImportedMesh",
    "MaskError",
    "Merge",
    "ObservationError",
    "ObservedObject",
    "Outline",
    "PerceptionCancelled",
    "Place",
    "Rename",
    "RunLengthMask",
    "Shadow",
    "SolidEstimate",
    "Split",
    "Stay",
    "VideoError",
    "VideoInfo",
    "calibrate_from_homography",
    "calibrate_from_known_length",
    "calibrate_from_points",
    "calibrate_given",
    "clevrer_appearances",
    "correct",
    "correction_of",
    "estimate_sizes",
    "import_camera",
    "import_depth",
    "import_masks",
    "import_mesh",
    "import_tracks",
    "observe",
    "probe",
    "read_frames",
    "world_tracks",
]
