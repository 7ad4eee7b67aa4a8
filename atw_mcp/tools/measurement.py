"""World construction, second part: observations from elsewhere, and how the image maps to the world."""

from __future__ import annotations

from typing import Annotated, Literal

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from atw_mcp.app import App
from atw_mcp.observing import keep_calibration
from atw_mcp.perception.calibration import (
    calibrate_from_homography,
    calibrate_from_known_length,
    calibrate_from_points,
    calibrate_given,
)
from atw_mcp.results import Answer, explained, plain
from atw_mcp.toolbox import ToolGroup
from atw_mcp.tools.world_arguments import Argument, CaseId, Point
from evidence_store import Case

GROUP = ToolGroup("world construction")
Pixel = Annotated[list[float], Field(min_length=2, max_length=2)]
Matrix = Annotated[list[Annotated[list[float], Field(min_length=3, max_length=3)]], Field(min_length=3, max_length=3)]


class PointArgument(Argument):
    """A point whose place in the world and in the image is known."""

    world: Point = Field(description="x, y, z [m]; z is up")
    pixel: Pixel = Field(description="u to the right, v down [px]")


class LengthArgument(Argument):
    """A known length in the plane of motion, seen from the side or from above without perspective."""

    first_pixel: Pixel
    second_pixel: Pixel
    length: float = Field(gt=0, le=1e4, description="[m]")
    view: Literal["side", "top"] = Field(
        default="side", description="side: x right, z up, motion at y = 0; top: x right, y up, motion on the floor"
    )


class CameraArgument(Argument):
    """A camera that is known: pixel ~ K (R X + t), camera z forward, v down."""

    intrinsics: Matrix = Field(description="K, 3 x 3 [px]")
    rotation: Matrix = Field(description="R, 3 x 3, world axes to camera axes")
    translation: Point = Field(description="t, the world's origin in camera axes [m]")


@GROUP.tool("CalibrateCamera", title="Calibrate the camera", read_only=False)
def calibrate_camera(
    app: App,
    case: CaseId,
    points: Annotated[
        list[PointArgument] | None,
        Field(
            min_length=4,
            max_length=200,
            description="known points: at least 4 in one plane with no three in a line, or 6 in space",
        ),
    ] = None,
    homography: Annotated[
        Matrix | None, Field(description="3 x 3 map of (x, y, 1) in the plane z = plane_z [m] to pixels")
    ] = None,
    plane_z: Annotated[float, Field(ge=-1e4, le=1e4, description="height of the homography's plane [m]")] = 0.0,
    known_length: Annotated[LengthArgument | None, Field(description="one known length, for a flat view")] = None,
    camera: Annotated[CameraArgument | None, Field(description="the camera itself, where it is known")] = None,
    intrinsics: Annotated[
        Matrix | None, Field(description="K, where it is known, to go with points or a homography")
    ] = None,
    image_size: Annotated[
        list[Annotated[int, Field(gt=0, le=16384)]] | None,
        Field(min_length=2, max_length=2, description="width, height [px]; only for a case without a video"),
    ] = None,
) -> Answer:
    """Tell how the image maps to the world, by exactly one of points, homography, known_length or camera. Returns the
    camera and its reprojection error. A later calibration replaces this one. Next: BuildWorld."""
    found = app.case_to_model(case, "CalibrateCamera")
    ways = {"points": points, "homography": homography, "known_length": known_length, "camera": camera}
    given = [name for name, value in ways.items() if value is not None]
    if len(given) != 1:
        raise ToolError(f"CalibrateCamera takes exactly one of {', '.join(ways)}; got {' and '.join(given) or 'none'}")
    size = _image_size(found, image_size)
    view = None
    with explained():
        if points is not None:
            made = calibrate_from_points([p.world for p in points], [p.pixel for p in points], size, intrinsics)
        elif homography is not None:
            made = calibrate_from_homography(homography, size, plane_z=plane_z, intrinsics=intrinsics)
        elif known_length is not None:
            first, second = known_length.first_pixel, known_length.second_pixel
            view = known_length.view
            made = calibrate_from_known_length(first, second, known_length.length, size, view=view)
        else:
            assert camera is not None
            made = calibrate_given(camera.intrinsics, camera.rotation, camera.translation, size)
    inputs = plain({**ways, "plane_z": plane_z, "intrinsics": intrinsics, "size": size})
    content = keep_calibration(app, found, made, inputs, side_view=view == "side")
    return Answer(
        summary=f"calibrated by {made.method}" + ("" if made.rms is None else f": {made.rms:.3g} px rms"),
        data={
            **made.to_dict(),
            "centre": made.camera.centre,
            "next": f"BuildWorld(case={found.id!r})",
        },
        case=found.id,
        observation=content.id,
    )


def _image_size(case: Case, given: list[int] | None) -> tuple[int, int]:
    if "width" in case.facts:
        width, height = int(case.facts["width"]), int(case.facts["height"])
        if given is not None and given != [width, height]:
            raise ToolError(f"image_size {given} is not the video's size [{width}, {height}]: leave it out")
        return width, height
    if given is None:
        raise ToolError(f"case {case.id!r} has no video: give image_size=[width, height]")
    return given[0], given[1]
