"""Posterior samples in the store, and the rollouts of their members: the ensemble of a world and its branches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter

from atw_mcp.calls.app import App
from atw_mcp.cases.origins import SAMPLE as SAMPLE
from atw_mcp.fitting.fitting import Sample
from atw_mcp.fitting.verdict import chance_of_wrong, verdict_of
from atw_mcp.worlds.rollout_cost import MAX_POINT_SAMPLES, cost
from atw_mcp.worlds.rollouts import ENGINE, content_of, rollout_from
from evidence_store import Case, Content
from polyworld.edits.interventions import Intervention
from polyworld.probing.ensemble import member_worlds, roll_out_members
from polyworld.trajectory import Rollout
from polyworld.world import World
from polyworld.world.parameters import parameter_paths, read_parameter

Array = NDArray[np.float64]

KIND = "ensemble"
MEMBERS = 64  # kept of every fit
LEAST = 5
EDITS: TypeAdapter[Any] = TypeAdapter(list[Intervention])

EnsembleSize = Annotated[
    int | None,
    Field(
        description=f"posterior samples to run too, {LEAST} to {MEMBERS} (40 is usual). Each has parameter values and "
        "initial states that the data allow, and the same edits. Default: none, the best fit alone",
        ge=LEAST,
        le=MEMBERS,
    ),
]


@dataclass(frozen=True)
class Lineage:
    """Where the members of a world come from: the sample of a fitted world, by its id, and the edits made since."""

    sample: Content
    edits: tuple[Any, ...]
    fitted: str


@dataclass(frozen=True)
class Ensemble:
    """The members of a world rolled out with the same edits.

    parameters: name -> values (N,): constants as fitted, and what of a single object was sampled, after any edit.
    wrong: probability that the fitted world, whose parameters alone the members vary, answers as chance would; why:
    what speaks for that. fitted_until [s]: time of the last sample that the fit used.
    """

    worlds: tuple[World, ...]
    rollouts: tuple[Rollout, ...]
    parameters: dict[str, Array]
    units: dict[str, str]
    wrong: float = 0.0
    why: str = ""
    fitted_until: float = np.inf

    @property
    def size(self) -> int:
        """Number of members."""
        return len(self.worlds)


def keep_sample(app: App, fitted: World, sample: Sample) -> None:
    """Store the posterior sample of a fitted world; its values are relative to the world that the fit started from."""
    document = {"start": sample.start.id, **sample.to_dict()}
    draws = {f"constants/{c.unknown.name}": c.draws for c in sample.constants}
    app.store.fits.put(SAMPLE, {"world": fitted.id}, document, {"values": sample.values, **draws})


def stored_sample(app: App, world: str) -> Content | None:
    """The posterior sample kept with a fitted world, or None."""
    return app.store.fits.find(SAMPLE, {"world": world})


def sample_in_words(sample: Content) -> dict[str, Any]:
    """Summarize a posterior sample for an agent: its size, and what it is worth."""
    document = sample.document
    return {
        "members": len(sample.arrays["values"]),
        "seed": document["seed"],
        "effective": document["effective"],
    }


def lineage(app: App, case: Case, world: World) -> Lineage:
    """The sample that a world inherits, with the edits since; raises ToolError where no ancestor has one."""
    waiting: list[tuple[str, tuple[Any, ...]]] = [(world.id, ())]
    seen: set[str] = set()
    while waiting:
        identifier, edits = waiting.pop(0)
        if identifier in seen:
            continue
        seen.add(identifier)
        sample = stored_sample(app, identifier)
        if sample is not None:
            return Lineage(sample, edits, identifier)
        for descent in app.store.worlds.parents(identifier):
            if descent.how == "intervention":
                waiting.append((descent.parent, (*descent.detail["edits"], *edits)))
    raise ToolError(
        f"{world.id} has no posterior sample, because it does not come from a completed fit: "
        f"FitWorld(case={case.id!r}, world=...) makes a world that has one; CommitWorld then chooses it"
    )


def most_members(app: App, case: Case, world: World) -> int:
    """Return how many members the posterior sample of a world has; raises ToolError where there is none."""
    return len(lineage(app, case, world).sample.arrays["values"])


def compute_ensemble(
    app: App,
    case: Case,
    world: World,
    horizon: float,
    sample_seconds: float | None,
    count: int,
    progress: Callable[[float], None] | None = None,
) -> Ensemble:
    """Roll out the first `count` members of a world's posterior sample in one batch, or find them rolled out before.

    Raises ToolError where there is no sample or there are too many points to keep, ValueError where an edit cannot be
    made in a member.
    """
    descent = lineage(app, case, world)
    kept = most_members(app, case, world)
    if kept < count:
        raise ToolError(
            f"ensemble={count}: the fit kept {kept} members, its rollouts being costly: ask for {kept} at most"
        )
    most = int(MAX_POINT_SAMPLES // max(cost(world, horizon).point_samples, 1)) if world.deformables else count
    if most < count:
        raise ToolError(
            f"ensemble={count} keeps too many points of deformable objects at this horizon: "
            + (f"ask for at most {most}, or a shorter horizon" if most >= LEAST else "ask for a shorter horizon")
        )

    def compute() -> tuple[dict[str, Any], dict[str, Array]]:
        members = _members(app, descent, count)
        paths = [path for unknown in descent.sample.document["unknowns"] for path in unknown["paths"]]
        try:
            found = roll_out_members(
                world,
                members,
                paths,
                horizon,
                sample_interval=sample_seconds,
                progress=progress,
                patience=app.limits.rollout_seconds,
            )
        except RuntimeError as error:  # more contacts at once than there is room for
            raise ValueError(f"the ensemble could not be finished: {error}") from error
        documents: list[dict[str, Any]] = []
        arrays: dict[str, Array] = {}
        for i, rollout in enumerate(found):
            document, own = content_of(rollout)
            documents.append(document)
            arrays |= {f"{i}/{name}": values for name, values in own.items()}
        return {"members": documents}, arrays

    content, _ = app.store.rollouts.get_or_compute(
        KIND, _inputs(descent, world, horizon, sample_seconds, count), compute
    )
    return _ensemble(app, descent, count, content)


def _inputs(descent: Lineage, world: World, horizon: float, sample_seconds: float | None, count: int) -> dict[str, Any]:
    inputs = {"world": world.id, "sample": descent.sample.id, "edits": list(descent.edits), "members": count}
    inputs |= {"horizon": horizon, "engine": ENGINE}
    if sample_seconds is None or sample_seconds == world.time.seconds_per_frame:
        return inputs
    return {**inputs, "sample_seconds": sample_seconds}


def _members(app: App, descent: Lineage, count: int) -> tuple[World, ...]:
    document = descent.sample.document
    start = World.model_validate_json(app.store.worlds.document(document["start"]))
    values = descent.sample.arrays["values"][:count]
    by_path = {path: values[:, i] for i, u in enumerate(document["unknowns"]) for path in u["paths"]}
    return member_worlds(start, by_path, EDITS.validate_python(list(descent.edits)))


def _ensemble(app: App, descent: Lineage, count: int, content: Content) -> Ensemble:
    unknowns = descent.sample.document["unknowns"]
    values = descent.sample.arrays["values"][:count]
    worlds = _members(app, descent, count)
    parameters, units = _constants(descent.sample, worlds, count)
    known = parameter_paths(worlds[0])
    tied = {path for name in parameters for path in descent.sample.document["constants"][name]["paths"]}
    for i, u in enumerate(unknowns):
        path = next((path for path in u["paths"] if path in known), None)
        if path is not None and path not in tied:
            parameters[_short(u["name"])], units[_short(u["name"])] = _values(worlds, path, values[:, i]), u["unit"]
    wrong, why = chance_of_wrong(verdict_of(app, descent.fitted))
    return Ensemble(
        wrong=wrong,
        why=why,
        fitted_until=float(descent.sample.document["until"]),
        worlds=worlds,
        rollouts=members_of(content),
        parameters=parameters,
        units=units,
    )


def members_of(content: Content) -> tuple[Rollout, ...]:
    """Return the rollouts of a stored ensemble's members."""
    return tuple(
        rollout_from(document, {k.partition("/")[2]: v for k, v in content.arrays.items() if k.startswith(f"{i}/")})
        for i, document in enumerate(content.document["members"])
    )


def _constants(sample: Content, worlds: tuple[World, ...], count: int) -> tuple[dict[str, Array], dict[str, str]]:
    """Return values (N,) and units of the fitted constants that every member has and the edits leave, by name.

    An object's friction is the square of what it has on the surface over the surface's own: the constants alone bear
    the names of the fit.
    """
    found: dict[str, Array] = {}
    units: dict[str, str] = {}
    size = len(sample.arrays["values"])
    for name, about in sample.document["constants"].items():
        draws = sample.arrays[f"constants/{name}"]
        whole = not about["paths"][0].endswith(".restitution")  # in which every collision has an error of its own
        if len(draws) == size - 1 and whole and any(_differs(worlds, path) for path in about["paths"]):
            found[name], units[name] = np.concatenate([[about["value"]], draws])[:count], about["unit"]
    return found, units


def _differs(worlds: tuple[World, ...], path: str) -> bool:
    """Whether members differ in the value at a path."""
    if path not in parameter_paths(worlds[0]):
        return False
    return len({read_parameter(world, path) for world in worlds}) > 1


def _values(worlds: tuple[World, ...], path: str, sampled: Array) -> Array:
    """Values (N,) of a parameter in the members; of rotations and shifts, which a world does not keep, as sampled."""
    if ".rotation." in path or ".shift." in path:
        return sampled
    found = [read_parameter(world, path) for world in worlds]
    return np.array([np.nan if value is None else value for value in found], dtype=np.float64)


def _short(name: str) -> str:
    return name.removeprefix("objects.")
