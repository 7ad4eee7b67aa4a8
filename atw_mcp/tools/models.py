"""World construction, with learned models: which there are, and running one of them on a case."""

from __future__ import annotations

from typing import Annotated, Literal

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.results import Answer, explained
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.models import Limits, Prompt, available, find_model
from atw_mcp.models.folders import how_to_add
from atw_mcp.observation.model_runs import prepare
from atw_mcp.observation.observing import shown_times
from atw_mcp.observation.run_requests import KnownObject, RunRequest
from atw_mcp.results.models import ModelDepth, ModelList, ModelMasks, ModelMeshes, ModelPoints, ModelPoses
from atw_mcp.tools.world_arguments import Argument, Patience, Pixel

GROUP = ToolGroup("world construction")
NAME = r"^[A-Za-z0-9][A-Za-z0-9_\-]{0,63}$"


class PromptArgument(Argument):
    """Where an object is in a frame: box, points, or both. Several frames of one object refine each other."""

    object: str = Field(pattern=NAME, description="its name from now on")
    frame: int = Field(ge=0, description="frame number")
    box: Annotated[list[float], Field(min_length=4, max_length=4)] | None = Field(
        default=None, description="left, top, width, height [px]"
    )
    positive: list[Pixel] | None = Field(default=None, max_length=50, description="pixels u, v on the object")
    negative: list[Pixel] | None = Field(default=None, max_length=50, description="pixels u, v beside it")

    def to_prompt(self) -> Prompt:
        """The same for the model; its row is the frame's number."""
        box = None if self.box is None else (self.box[0], self.box[1], self.box[2], self.box[3])
        positive = tuple((p[0], p[1]) for p in self.positive or [])
        return Prompt(self.object, self.frame, box, positive, tuple((p[0], p[1]) for p in self.negative or []))


class ModelledObject(Argument):
    """An observed object the model is asked about."""

    name: str = Field(min_length=1, max_length=64, description="name of the observed object")
    size: float | None = Field(default=None, gt=0, le=1e4, description="mesh: greatest extent [m]")
    mesh: str | None = Field(default=None, max_length=64, description="pose: id of its mesh")


@GROUP.tool(
    "RunModel",
    title="Run a learned model",
    read_only=False,
    returns=ModelList | ModelMasks | ModelPoints | ModelDepth | ModelPoses | ModelMeshes,
)
def run_model(
    app: App,
    model: Annotated[str | None, Field(max_length=200, description="its name; without it, models are listed")] = None,
    case: Annotated[str | None, Field(description="case id")] = None,
    prompts: Annotated[
        list[PromptArgument] | None,
        Field(
            min_length=1,
            max_length=200,
            description="segmentation: the objects to follow; default: those observed, by their boxes",
            examples=[[{"object": "red_ball", "frame": 0, "positive": [[120, 80]]}]],
        ),
    ] = None,
    objects: Annotated[
        list[ModelledObject] | None,
        Field(min_length=1, max_length=64, description="which observed objects; default: all"),
    ] = None,
    use: Annotated[
        Literal["model", "agreement", "report"],
        Field(
            description="what becomes the case's latest observation. model: the result. agreement (masks): each object "
            "from whichever of model and latest observation is steadier and stands out more. report: compare only"
        ),
    ] = "model",
    stride: Annotated[int, Field(ge=1, le=100, description="look at every n-th frame")] = 1,
    patience_seconds: Patience = 40.0,
) -> Answer | LongWork:
    """Let a learned model observe the video, where ObserveObjects fails or to check it: masks of objects you point at
    (segmentation), rotations from points on bodies (points), depth, focal length and camera (depth), poses of bodies of
    known shape (pose), meshes (mesh). Without a model it lists those whose weights are here, with licences. Masks are
    compared with the latest observation. Next: InspectFrames, then CalibrateCamera or BuildWorld."""
    if model is None:
        return _listed()
    if case is None:
        raise ToolError(f"RunModel needs a case to run {model!r} on. Next: OpenCase(video=PATH)")
    found = app.case(case)
    with explained():
        chosen = find_model(model)
        request = RunRequest(
            chosen,
            Limits.from_environment(),
            tuple(item.to_prompt() for item in prompts or []),
            tuple(KnownObject(item.name, item.size, item.mesh) for item in objects or []),
            stride * shown_times(found),
            use,
        )
        prepared = prepare(app, found, request)

    def work(progress: Progress) -> Answer:
        with explained():
            done = prepared.work(progress)
        return Answer(
            summary=f"{done.summary} (licence: {chosen.licence})",
            data=done.data,
            case=found.id,
            observation=done.id,
            objects=done.objects,
        )

    return LongWork(
        key=app.store.observations.key(prepared.kind, {**prepared.inputs, "use": use}) + found.id,
        work=work,
        draft=Answer(summary=f"running {chosen.name}", data={}, case=found.id),
        patience=patience_seconds,
    )


def _listed() -> Answer:
    with explained():
        limits = Limits.from_environment()
    found, refused = available()
    listed = ", ".join(f"{m.name} ({m.task}, licence: {m.licence})" for m in found)
    return Answer(
        summary=f"{len(found)} models: {listed}" if found else f"no models; to add one, {how_to_add()}",
        data={
            "models": [m.to_dict() for m in found],
            "not_usable": list(refused),
            "limits": {"device": limits.device, "batch": limits.batch, "memory_gb": limits.memory_gb},
            "to_add": how_to_add(),
        },
    )
