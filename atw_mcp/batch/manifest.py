"""Manifests: one case a line, a JSON object whose fields are arguments of the tools that model and ask it.

A case is a video (`ModelVideo`'s arguments beside its own fields), a file of tracks (`ImportObservation`'s in `read`,
`BuildWorld`'s beside, `FitWorld`'s in `fit`), or neither: a world described by `BuildWorld`'s arguments. A question has
the arguments of `Rollout` and `QueryWorld`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from atw_mcp.calls.deferred import DeferredTool
from atw_mcp.calls.forms import read_form, tagged
from atw_mcp.calls.results import validation_text
from atw_mcp.calls.spelling import did_you_mean
from atw_mcp.cases.cases import path_hash
from atw_mcp.tools import manifest as tools

IDS = 1000
"""Evidence ids of a case. Modelling takes about ten, a question three, so that there is room for 300 questions."""

Kind = Literal["video", "tracks", "described"]
Identifier = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_\-]{0,63}$")]
MODELLED_BY: dict[Kind, str] = {"video": "ModelVideo", "tracks": "BuildWorld", "described": "BuildWorld"}
ASKED_BY = ("Rollout", "QueryWorld")
ASKS = {"any": "whether", "first": "when", "count": "how_often"}  # what Ask calls an aggregation
# Arguments that a batch gives itself, or that name results of earlier calls, of which a manifest knows none.
OWN = {
    "ModelVideo": {"case", "video", "name", "patience_seconds"},
    "BuildWorld": {"case", "tracks", "observation", "patience_seconds"},
    "FitWorld": {"case", "world", "seed", "patience_seconds"},
    "ImportObservation": {"case", "kind", "path"},
    "Rollout": {"case", "world", "ensemble"},
    "QueryWorld": {"rollout", "predicates"},
}
STEPS = {"observe": "ObserveObjects", "calibrate": "CalibrateCamera", "build": "BuildWorld", "fit": "FitWorld"}
EXAMPLES: dict[str, Mapping[str, Any]] = {
    "predicate": {"predicate": "collides", "a": "red", "b": "blue"},
    "edits": {"action": "remove", "object": "red"},
}


class ManifestError(Exception):
    """A manifest that cannot be run; `findings` are sentences, each with its line."""

    def __init__(self, findings: Iterable[str]) -> None:
        self.findings = tuple(findings)
        super().__init__("\n".join(self.findings))


class Question(BaseModel):
    """One question of a case; the fields beside these are arguments of Rollout and QueryWorld.

    how_sure: whether the worlds that the data allow are asked too, by Ask.
    """

    model_config = ConfigDict(extra="allow", frozen=True)

    id: Identifier = Field(description="names the question within its case")
    text: str = Field(min_length=1, max_length=4000, description="the question in words, recorded with its answer")
    how_sure: bool = Field(
        default=False, description="ask 64 worlds that the data allow too, by Ask: a probability, or an 80% interval"
    )

    def arguments(self, tool: str) -> dict[str, Any]:
        """Return what it gives a tool."""
        return {key: value for key, value in (self.model_extra or {}).items() if key in taken(tool)}


class Entry(BaseModel):
    """One case; the fields beside these are arguments of the tool that models it."""

    model_config = ConfigDict(extra="allow", frozen=True)

    id: Identifier = Field(description="names the case in the store and its answers")
    video: str | None = Field(default=None, description="path of a video, relative to the manifest")
    tracks: str | None = Field(
        default=None,
        description="path of tracks instead, as ImportObservation takes; with neither a world is described",
    )
    camera: str | None = Field(default=None, description="path of a camera file, as ImportObservation takes")
    read: dict[str, Any] = Field(default={}, description="tracks: further arguments of ImportObservation")
    fit: dict[str, Any] = Field(default={}, description="arguments of FitWorld")
    even_if_poor: bool = Field(default=False, description="ask a world whose fit is poor all the same")
    seed: int = Field(default=0, ge=0, le=2**31 - 1, description="random seed of the fit")
    questions: list[Question] = Field(default=[], max_length=300, description="asked of the fitted world, in order")

    @property
    def kind(self) -> Kind:
        """Which tools model it."""
        return "video" if self.video is not None else "tracks" if self.tracks is not None else "described"

    @property
    def modelling(self) -> dict[str, Any]:
        """Arguments of the tool that models it."""
        return self.model_extra or {}

    def files(self, folder: Path) -> dict[str, Path]:
        """Return the files and folders it names, by field; paths are relative to the manifest's folder."""
        build = self.modelling.get("build")
        world = self.modelling.get("world", build.get("world") if isinstance(build, dict) else None)
        named = {"video": self.video, "tracks": self.tracks, "camera": self.camera, "world": world}
        return {field: folder / path for field, path in named.items() if isinstance(path, str)}


@dataclass(frozen=True)
class ManifestCase:
    """A case of a manifest. line, place: from 1; place counts cases alone and fixes the ids of its evidence."""

    entry: Entry
    line: int
    place: int
    folder: Path

    @property
    def first_evidence(self) -> int:
        """Number of its first record of evidence."""
        return (self.place - 1) * IDS + 1

    def digest(self, limits: Mapping[str, Any]) -> str:
        """SHA-256 of all that determines its results: entry, place, content of its files, limits."""
        files = {
            field: path_hash(path) if path.exists() else None for field, path in self.entry.files(self.folder).items()
        }
        whole = {"entry": self.entry.model_dump(), "place": self.place, "files": files, "limits": dict(limits)}
        return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()


THERE_ARE = (
    f"fields of every case: {', '.join(Entry.model_fields)}; of every question: {', '.join(Question.model_fields)}, "
    "predicate"
)


def read_manifest(path: Path, *, look_for_files: bool = False) -> list[ManifestCase]:
    """Return the cases of a manifest; empty lines and lines that begin with # are left out.

    Raises ManifestError with everything that is wrong, and OSError or UnicodeDecodeError. look_for_files: that a file
    is missing is wrong too, instead of a failure of its case.
    """
    folder = path.absolute().parent
    cases: list[ManifestCase] = []
    findings: list[str] = []
    lines: dict[str, int] = {}
    for line, text in enumerate(path.read_text(encoding="utf-8-sig").splitlines(), start=1):
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        try:
            given = json.loads(text)
        except json.JSONDecodeError as error:
            findings.append(f"line {line}, column {error.colno}: no JSON object ({error.msg})")
            continue
        if not isinstance(given, dict):
            findings.append(f"line {line}: a {type(given).__name__}; give one JSON object a line")
            continue
        name = given.get("id")
        where = f"line {line}" + (f" ({name})" if isinstance(name, str) else "")
        try:
            entry = Entry.model_validate(given)
        except ValidationError as error:
            findings.append(f"{where}: {validation_text(error)}; {THERE_ARE}")
            continue
        found = list(_findings(entry))
        if entry.id in lines:
            found.append(f"id: line {lines[entry.id]} has the case {entry.id!r} already")
        if look_for_files:
            found += [f"{f}: there is no file {p}" for f, p in entry.files(folder).items() if not p.exists()]
        lines.setdefault(entry.id, line)
        findings += [f"{where}: {text}" for text in found]
        cases.append(ManifestCase(entry, line, len(cases) + 1, folder))
    if not findings and not cases:
        findings.append("the manifest has no case: give one JSON object a line, as `atw-mcp schema manifest` says")
    if findings:
        raise ManifestError(findings)
    return cases


def manifest_schema() -> dict[str, Any]:
    """Return the JSON schema of a line of a manifest, made of those of the tools."""
    listed = tools.schemas()

    def arguments(*names: str) -> dict[str, Any]:
        return {key: listed[name]["properties"][key] for name in names for key in taken(name)}

    own = Entry.model_json_schema()
    asked = Question.model_json_schema()
    question = {
        "type": "object",
        "properties": {**asked["properties"], **arguments(*ASKED_BY)},
        "required": [*asked["required"], "predicate"],
        "additionalProperties": False,
    }
    forms = []
    for kind, tool in MODELLED_BY.items():
        fields = {key: own["properties"][key] for key in _own_fields(kind)}
        fields |= {"questions": {**own["properties"]["questions"], "items": question}}
        for key, step in (("fit", "FitWorld"), ("read", "ImportObservation")):
            if key in fields:
                closed = {"type": "object", "properties": arguments(step), "additionalProperties": False}
                fields[key] = {**closed, "description": fields[key]["description"]}
        forms.append(
            {
                "title": f"{kind}: with arguments of {tool}",
                "type": "object",
                "properties": {**arguments(tool), **fields},
                "required": ["id", *([kind] if kind != "described" else [])],
                "additionalProperties": False,
            }
        )
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A line of a manifest of `atw-mcp batch`",
        "description": "One case. Paths are relative to the manifest.",
        "oneOf": forms,
    }


def taken(tool: str) -> list[str]:
    """Return the arguments of a tool that a manifest may give."""
    return [key for key in _tool(tool).parameters["properties"] if key not in OWN.get(tool, ())]


def _tool(name: str) -> DeferredTool:
    if not _TOOLS:
        _TOOLS.update({entry["name"]: DeferredTool.from_entry(entry) for entry in tools.entries()})
    return _TOOLS[name]


_TOOLS: dict[str, DeferredTool] = {}


def _own_fields(kind: Kind) -> list[str]:
    left_out = {"video": {"tracks", "read"}, "tracks": {"video"}, "described": {"video", "tracks", "read", "fit"}}[kind]
    return [key for key in Entry.model_fields if key not in left_out]


def _findings(entry: Entry) -> Iterator[str]:
    """Yield what is wrong with an entry, as far as that shows before anything is observed."""
    kind, modelled_by = entry.kind, MODELLED_BY[entry.kind]
    if entry.video is not None and entry.tracks is not None:
        yield "video, tracks: give one of them"
        return
    unused = [key for key in Entry.model_fields if key in entry.model_fields_set and key not in _own_fields(kind)]
    if unused:
        about = "case without video or tracks, whose world is described" if kind == "described" else f"{kind} case"
        yield f"{', '.join(unused)}: not of a {about}; its fields: {', '.join(_fields(kind))}"
    yield from _unknown("", entry.modelling, _fields(kind))
    given = {key: value for key, value in entry.modelling.items() if key in taken(modelled_by)}
    yield from _refusal("", modelled_by, given)
    if "seed" in entry.fit:
        yield "fit.seed: give it as the seed of the case"
    yield from _unknown("fit", {k: v for k, v in entry.fit.items() if k != "seed"}, taken("FitWorld"))
    yield from _unknown("read", entry.read, taken("ImportObservation"))
    yield from _refusal("read", "ImportObservation", {"kind": "tracks", "path": "p", **_known("read", entry.read)})
    for key, tool in STEPS.items():
        step = entry.fit if key == "fit" else entry.modelling.get(key)
        if isinstance(step, dict) and (kind == "video" or key == "fit"):
            yield from _refusal(key, tool, _known(key, step))
    names = [question.id for question in entry.questions]
    for number, question in enumerate(entry.questions):
        where = f"questions.{number}"
        if question.id in names[:number]:
            yield f"{where}.id: question {names.index(question.id)} has the id {question.id!r} already"
        extra = question.model_extra or {}
        fields = [*Question.model_fields, *dict.fromkeys(key for tool in ASKED_BY for key in taken(tool))]
        yield from _unknown(where, extra, fields)
        if kind == "described":
            yield from _without_data(where, question)
        yield from _refusal(where, "Rollout", question.arguments("Rollout"))
        if "predicate" not in extra:
            yield f"{where}.predicate: is required, for example {json.dumps(EXAMPLES['predicate'])}"
        else:
            yield from _refusal(where, "QueryWorld", {"rollout": "rollout-0", **question.arguments("QueryWorld")})
            yield from _forms(where, extra)
        if question.how_sure and extra.get("aggregation", "any") not in ASKS:
            yield f"{where}.how_sure: is known of the aggregations {', '.join(ASKS)}, not {extra['aggregation']!r}"


def _without_data(where: str, question: Question) -> Iterator[str]:
    """Yield what a question needs, or cannot have, where nothing was observed."""
    if not {"horizon_seconds", "horizon_frames"} & (question.model_extra or {}).keys():
        yield f"{where}.horizon_seconds: is required, as no frames were observed whose length would be taken"
    if question.how_sure:
        yield f"{where}.how_sure: a described world is not fitted, so that there is no sample to ask"


def _fields(kind: Kind) -> list[str]:
    return list(dict.fromkeys([*_own_fields(kind), *taken(MODELLED_BY[kind])]))


def _known(key: str, given: dict[str, Any]) -> dict[str, Any]:
    """Leave out what another finding names already."""
    if key not in ("fit", "read"):
        return given
    fields = taken("FitWorld" if key == "fit" else "ImportObservation")
    return {name: value for name, value in given.items() if name in fields}


def _unknown(where: str, given: Mapping[str, Any], fields: list[str]) -> Iterator[str]:
    for key in given:
        if key not in fields:
            place = f"{where}.{key}" if where else key
            yield f"{place}: no such field{did_you_mean(key, fields)}; there are {', '.join(fields)}"


def _refusal(where: str, tool: str, given: dict[str, Any]) -> Iterator[str]:
    """Yield what a tool says of arguments it does not take."""
    needed = {"case": "case"} if "case" in _tool(tool).parameters["properties"] else {}
    try:
        _tool(tool).checked({**needed, **given})
    except ToolError as error:
        said = str(error).partition(". DescribeTool(")[0]
        yield f"{where + ': ' if where else ''}{said} (`atw-mcp tools {tool}` lists its arguments)"


def _forms(where: str, given: Mapping[str, Any]) -> Iterator[str]:
    """Yield what is wrong with a predicate and edits, whose forms the tools check only beside a world."""
    from polyworld.edits.interventions import Intervention
    from polyworld.probing.predicates import Predicate

    edits = given.get("edits")
    asked = [("predicate", given["predicate"], Predicate, "predicate")]
    if isinstance(edits, list):
        asked += [(f"edits.{number}", edit, Intervention, "action") for number, edit in enumerate(edits)]
    for place, value, union, tag in asked:
        what = f"{where}.{place}"
        example = EXAMPLES[place.partition(".")[0]]
        try:
            read_form(tagged(value, union, tag, what=what, example=example), union, tag, what=what)
        except ToolError as error:
            yield str(error)
