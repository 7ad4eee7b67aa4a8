"""Build the document of a case from its store: read every record, and say what of it cannot be shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from atw_mcp.calls.version import installed_version
from atw_mcp.observation.observing import image_observation
from atw_mcp.observation.track_records import KIND as TRACKS
from atw_mcp.observation.track_records import TrackRecord
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.viewer import document as view
from atw_mcp.viewer.colors import distinct_colors
from atw_mcp.viewer.edits import branch_label, edit_words
from atw_mcp.viewer.fits import fit_views
from atw_mcp.viewer.gaps import gap_views
from atw_mcp.viewer.lineage import provenance
from atw_mcp.viewer.observed import observed_view, tracks_view
from atw_mcp.viewer.packing import Blocks
from atw_mcp.viewer.rollouts import rollout_view
from atw_mcp.viewer.sampling import numbers_per_sample, shares
from atw_mcp.viewer.worlds import world_view
from atw_mcp.worlds.rollouts import rollout_from
from evidence_store import Case, Descent, Evidence, EvidenceStore, StoreError
from polyworld.trajectory import Rollout
from polyworld.world import World

MOST_ROLLOUTS = 16  # more cannot be overseen; those used last are shown
LABELS = {"built": "as built", "given": "as given", "fitted": "as fitted", "effect_added": "with an effect added"}


def case_document(
    store: EvidenceStore, identifier: str, *, first: Sequence[str] = ()
) -> tuple[view.ViewDocument, Blocks]:
    """Return everything that the viewer shows of a case, but its film.

    first: rollouts to open with. Raises UnknownRecord for a case or a rollout that is not there, other StoreErrors
    where the store cannot be read; records that are damaged are left out and named in `missing`.
    """
    case = store.cases.get(identifier)
    read = _Records(store, case)
    read.evidence = store.evidence.of_case(case.id)
    read.missing += [f"{name} is damaged and left out." for name in store.evidence.damaged(case.id)]
    read.read_observations()
    read.read_rollouts(first)
    read.read_worlds()
    return _document(read, list(first))


@dataclass
class _Records:
    """Records of a case as they are read; missing: sentences about those that could not be."""

    store: EvidenceStore
    case: Case
    missing: list[str] = field(default_factory=list)
    evidence: list[Evidence] = field(default_factory=list)
    seen: tuple[str, ImageObservation] | None = None
    tracks: list[TrackRecord] = field(default_factory=list)
    worlds: dict[str, World] = field(default_factory=dict)
    origins: dict[str, str] = field(default_factory=dict)
    descents: dict[str, Descent] = field(default_factory=dict)
    rollouts: dict[str, Rollout] = field(default_factory=dict)

    def read_observations(self) -> None:
        """Read the latest observation of the video and all tracks."""
        for kind, identifier in self.store.cases.observations(self.case.id):
            try:
                if kind == "objects" and self.seen is None:
                    self.seen = identifier, image_observation(self.store.observations.get(identifier))
                elif kind == TRACKS:
                    self.tracks.append(TrackRecord.of(self.store.observations.get(identifier)))
            except (StoreError, ValueError, KeyError) as error:
                self.missing.append(_sentence(f"Observation {identifier} cannot be shown: {error}"))

    def read_rollouts(self, first: Sequence[str]) -> None:
        """Read the rollouts that evidence is about: those asked for, then those used last."""
        used = list(dict.fromkeys(row.rollout for row in reversed(self.evidence) if row.rollout is not None))
        for rollout in first:
            if rollout not in used:
                self.store.rollouts.get(rollout)  # raises UnknownRecord
        wanted = list(dict.fromkeys([*first, *used]))
        if len(wanted) > MOST_ROLLOUTS:
            self.missing.append(
                f"{len(wanted) - MOST_ROLLOUTS} of {len(wanted)} rollouts are not shown, those used longest ago; "
                "--rollout ID shows one."
            )
        shown = set(wanted[:MOST_ROLLOUTS])
        order = [*(r for r in reversed(used) if r in shown), *(r for r in first if r not in used)]
        for identifier in order:
            try:
                content = self.store.rollouts.get(identifier)
                self.rollouts[identifier] = rollout_from(content.document, content.arrays)
            except (StoreError, ValueError, KeyError) as error:
                self.missing.append(_sentence(f"Rollout {identifier} cannot be shown: {error}"))

    def read_worlds(self) -> None:
        """Read the worlds of the case and those of its rollouts, and what each was made from."""
        listed = dict(self.store.cases.worlds(self.case.id))
        for rollout in self.rollouts.values():
            listed.setdefault(rollout.world_id, "")
        for identifier, origin in listed.items():
            try:
                world = World.model_validate_json(self.store.worlds.document(identifier))
                parents = self.store.worlds.parents(identifier)
            except (StoreError, ValueError) as error:
                self.missing.append(_sentence(f"World {identifier} cannot be shown: {error}"))
                continue
            self.worlds[identifier], self.origins[identifier] = world, origin
            if parents:
                self.descents[identifier] = parents[-1]
        for identifier in [r for r, rollout in self.rollouts.items() if rollout.world_id not in self.worlds]:
            self.missing.append(f"Rollout {identifier} is not shown, because its world is not.")
            del self.rollouts[identifier]

    def edits(self, world: str) -> list[view.EditWords]:
        """Return the edits that made a branch; empty where a world is none."""
        descent = self.descents.get(world)
        if descent is None or descent.how != "intervention":
            return []
        return [edit_words(edit) for edit in descent.detail.get("edits", [])]

    def label(self, world: str) -> str:
        """Return what a world is, in a few words."""
        edits = self.edits(world)
        if edits:
            return branch_label(edits)
        origin = self.origins[world] or "given"
        return LABELS.get(origin, origin.replace("_", " "))

    def base_of(self, identifier: str) -> str | None:
        """Return the rollout of the unedited world that a branch is to be compared with: of the nearest horizon."""
        rollout = self.rollouts[identifier]
        descent = self.descents.get(rollout.world_id)
        if descent is None or descent.how != "intervention":
            return None
        others = [
            (abs(r.horizon - rollout.horizon), k) for k, r in self.rollouts.items() if r.world_id == descent.parent
        ]
        return min(others)[1] if others else None


def _document(read: _Records, first: list[str]) -> tuple[view.ViewDocument, Blocks]:
    blocks = Blocks()
    colors = _colors(read)
    gaps, unshown = gap_views(read.store, read.case, blocks)
    read.missing += unshown
    budget = shares([len(r.trajectory.times) * numbers_per_sample(r.trajectory) for r in read.rollouts.values()])
    shown = view.ViewDocument(
        made_by=f"atw-mcp {installed_version()}",
        case=_case_view(read),
        missing=[],
        film=None,
        observed=None if read.seen is None else observed_view(read.seen[0], read.seen[1], blocks, colors),
        tracks=[_tracks(read, record, blocks) for record in read.tracks],
        worlds=[
            world_view(
                world,
                blocks,
                colors,
                label=read.label(identifier),
                origin=read.origins[identifier] or "given",
                parent=read.descents[identifier].parent if identifier in read.descents else None,
                committed=identifier == read.case.committed_world,
            )
            for identifier, world in read.worlds.items()
        ],
        rollouts=[
            rollout_view(
                identifier,
                read.worlds[rollout.world_id],
                rollout,
                blocks,
                label=read.label(rollout.world_id),
                base=read.base_of(identifier),
                edits=read.edits(rollout.world_id),
                most_numbers=most,
            )
            for (identifier, rollout), most in zip(read.rollouts.items(), budget, strict=True)
        ],
        comparisons=[],
        fits=fit_views(read.store, read.case.id, blocks, read.missing),
        gaps=gaps,
        evidence=[evidence_row(row) for row in read.evidence],
        provenance=provenance(read.store, read.case.id, read.missing),
        running=[],
        shown=[rollout for rollout in first if rollout in read.rollouts],
    )
    shown.missing = list(dict.fromkeys(read.missing))  # the same damage may be met twice
    return shown, blocks


def _case_view(read: _Records) -> view.CaseView:
    case, cases = read.case, read.store.cases
    return view.CaseView(
        id=case.id,
        kind="video" if case.kind == "video" else "data" if case.path else "none",
        file=case.path.replace("\\", "/").rsplit("/", 1)[-1],
        questions=cases.questions(case.id),
        answers=[
            view.Answer(
                question=a.question,
                answer=a.answer,
                confidence=a.confidence,
                evidence=list(a.evidence),
                missing=a.missing,
            )
            for a in cases.answers(case.id)
        ],
        bindings=[view.Binding(name=b.name, track=b.track, object=b.object) for b in cases.bindings(case.id).values()],
        committed_world=case.committed_world,
    )


def evidence_row(record: Evidence) -> view.EvidenceRow:
    """Return a record without what it holds."""
    return view.EvidenceRow(
        id=record.id,
        tool=record.tool,
        status=record.status,
        summary=record.summary,
        world=record.world,
        rollout=record.rollout,
        observation=record.observation,
        objects=list(record.objects),
        interval=None if record.interval is None else list(record.interval),
    )


def _tracks(read: _Records, record: TrackRecord, blocks: Blocks) -> view.Tracks:
    """Return tracks in the time base of the latest world that models them; the committed one where it does."""
    cases, case = read.store.cases, read.case
    models = [w for w in read.worlds if cases.modelled_observation(case.id, w) == record.id] or list(read.worlds)
    chosen = case.committed_world if case.committed_world in models else (models[-1] if models else None)
    step = None if chosen is None else read.worlds[chosen].time.seconds_per_frame
    frames = [
        r.arguments.get("holdout_from") for r in read.evidence if r.tool == "FitWorld" and r.status == "completed"
    ]
    held_out = frames[-1] if frames else None
    seconds = step or record.tracks.seconds_per_frame
    return tracks_view(
        record,
        blocks,
        seconds_per_frame=step,
        held_out_from=float(held_out) * seconds if isinstance(held_out, int | float) else None,
    )


def _colors(read: _Records) -> dict[str, str]:
    """Return a colour for each object that moves or was seen; worlds that were built say what it looks like."""
    wanted: dict[str, str | None] = {}
    for world in read.worlds.values():
        for item in (*world.objects, *world.deformables):
            wanted[item.name] = wanted.get(item.name) or item.appearance.color
    for seen in () if read.seen is None else read.seen[1].objects:
        wanted[seen.name] = wanted.get(seen.name) or (None if seen.colour.name == "unknown" else seen.colour.name)
    return distinct_colors(wanted)


def _sentence(text: str) -> str:
    return text if text.endswith(".") else text + "."
