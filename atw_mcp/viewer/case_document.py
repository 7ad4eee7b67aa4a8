"""Build the document of a case from its store."""

from __future__ import annotations

from collections.abc import Sequence

from atw_mcp.calls.version import installed_version
from atw_mcp.observation.track_records import TrackRecord, at_rate
from atw_mcp.viewer import document as view
from atw_mcp.viewer import world_parts
from atw_mcp.viewer.colors import distinct_colors
from atw_mcp.viewer.comparisons import comparisons_view
from atw_mcp.viewer.effects import without_push
from atw_mcp.viewer.fits import fit_views
from atw_mcp.viewer.following import chances, followings
from atw_mcp.viewer.gaps import gap_views
from atw_mcp.viewer.lineage import provenance
from atw_mcp.viewer.observed import observed_view, run_view, tracks_view
from atw_mcp.viewer.packing import Blocks
from atw_mcp.viewer.paths import without_folders
from atw_mcp.viewer.records import UNREADABLE, CaseRecords, read_case
from atw_mcp.viewer.rollouts import rollout_view
from atw_mcp.viewer.running import running_views
from atw_mcp.viewer.sampling import numbers_per_sample, shares
from atw_mcp.viewer.spread import spread_view
from atw_mcp.viewer.worlds import world_view
from evidence_store import Evidence, EvidenceStore, StoreError
from polyworld.trajectory import Rollout


def case_document(
    store: EvidenceStore, identifier: str, *, first: Sequence[str] = ()
) -> tuple[view.ViewDocument, Blocks]:
    """Return everything that the viewer shows of a case, but its film. Equal stores give equal documents.

    first: rollouts to open with. Raises as `read_case`; other records that cannot be shown are left out and named in
    `missing`.
    """
    read, blocks = read_case(store, identifier, first), Blocks()
    colors = _colors(read)
    comparisons, not_compared = comparisons_view(read.worlds, read.rollouts, read.bases, read.evidence)
    gaps, gaps_missing = gap_views(store, read.case, blocks)
    run = {result.world_id for result in read.rollouts.values()}
    unpushed = [sentence for world in run for sentence in without_push(read.worlds[world])]
    read.missing += [*not_compared, *gaps_missing, *sorted(unpushed)]
    document = view.ViewDocument(
        made_by=f"atw-mcp {installed_version()}",
        case=_case_view(read),
        missing=[],
        film=None,
        observed=None if read.seen is None else observed_view(read.seen[0], read.seen[1], blocks, colors),
        tracks=_tracks(read, blocks),
        worlds=_worlds(read, blocks, colors),
        rollouts=_rollouts(read, blocks),
        comparisons=comparisons,
        fits=fit_views(store, read.case.id, blocks, read.missing),
        gaps=gaps,
        evidence=[evidence_row(row, read.case.path) for row in read.evidence],
        provenance=provenance(store, read.case.id, read.missing),
        running=running_views(store, read.case.id),
        shown=[rollout for rollout in first if rollout in read.rollouts][:2],
    )
    said = [without_folders(sentence, [read.case.path]) for sentence in read.missing]
    document.missing = list(dict.fromkeys(said))  # the same damage may be met twice
    return document, blocks


def _case_view(read: CaseRecords) -> view.CaseView:
    case, cases = read.case, read.store.cases
    rate = float(case.facts.get("frames_per_second") or 0.0)
    try:
        questions, answers = cases.questions(case.id), cases.answers(case.id)
        bindings = list(cases.bindings(case.id).values())
    except StoreError as error:
        read.missing.append(f"Questions and answers cannot be shown: {error}.")
        questions, answers, bindings = [], [], []
    return view.CaseView(
        id=case.id,
        kind="video" if case.kind == "video" else "data" if case.path else "none",
        file=case.path.replace("\\", "/").rsplit("/", 1)[-1],
        questions=questions,
        answers=[
            view.Answer(
                question=a.question,
                answer=a.answer,
                confidence=a.confidence,
                evidence=list(a.evidence),
                missing=a.missing,
                chances=chances(read.store, a.evidence),
            )
            for a in answers
        ],
        bindings=[view.Binding(name=b.name, track=b.track, object=b.object) for b in bindings],
        committed_world=case.committed_world,
        file_seconds_per_frame=1.0 / rate if rate > 0.0 else None,
        clock=case.facts.get("clock"),
    )


def evidence_row(record: Evidence, file: str) -> view.EvidenceRow:
    """Return a record without what it holds; file: path of the case's file."""
    paths = [file, *(value for value in record.arguments.values() if isinstance(value, str))]
    return view.EvidenceRow(
        id=record.id,
        tool=record.tool,
        status=record.status,
        summary=without_folders(record.summary, [path for path in paths if "/" in path or "\\" in path]),
        world=record.world,
        rollout=record.rollout,
        observation=record.observation,
        objects=list(record.objects),
        interval=None if record.interval is None else list(record.interval),
    )


def _tracks(read: CaseRecords, blocks: Blocks) -> list[view.Tracks]:
    """Return measured positions: of each track record, and of each run of the latest recording."""
    fits = [row for row in read.evidence if row.tool == "FitWorld" and row.status == "completed"]
    frame = fits[-1].arguments.get("holdout_from") if fits else None
    found = [_of_record(read, record, frame, blocks) for record in read.tracks.values()]
    for identifier, recording in read.recordings.items():
        found += [run_view(identifier, run, blocks) for run in recording.runs]
    return found


def _of_record(read: CaseRecords, record: TrackRecord, frame: object, blocks: Blocks) -> view.Tracks:
    """Return tracks in the time base of the world that models them; frame: from which on the fit did not see them."""
    world = read.modelled_by(record.id)
    tracks = record.tracks if world is None else at_rate(record.tracks, world.time.seconds_per_frame)
    held_out = tracks.time_of(int(frame)) if isinstance(frame, int | float) else None
    return tracks_view(record.id, tracks, blocks, held_out_from=held_out)


def _worlds(read: CaseRecords, blocks: Blocks, colors: dict[str, str]) -> list[world_parts.WorldView]:
    labels = read.world_labels()
    judged = followings(read.store, read.case.id)
    return [
        world_view(
            world,
            blocks,
            colors,
            label=labels[identifier],
            origin=read.origins[identifier] or "given",
            parent=read.descents[identifier].parent if identifier in read.descents else None,
            committed=identifier == read.case.committed_world,
            runs=[result.trajectory for result in read.rollouts.values() if result.world_id == identifier],
            follows=judged.get(identifier),
        )
        for identifier, world in read.worlds.items()
    ]


def _rollouts(read: CaseRecords, blocks: Blocks) -> list[view.RolloutView]:
    labels = read.rollout_labels()
    worlds = {rollout: read.worlds[result.world_id] for rollout, result in read.rollouts.items()}
    needs = [
        len(result.trajectory.times) * numbers_per_sample(worlds[rollout], result.trajectory)
        for rollout, result in read.rollouts.items()
    ]
    return [
        rollout_view(
            rollout,
            worlds[rollout],
            result,
            blocks,
            label=labels[rollout],
            base=read.bases[rollout],
            edits=read.edits(result.world_id),
            tracks=read.tracks_of(result.world_id),
            most_numbers=most,
            spread=_spread(read, result, blocks),
        )
        for (rollout, result), most in zip(read.rollouts.items(), shares(needs), strict=True)
    ]


def _spread(read: CaseRecords, result: Rollout, blocks: Blocks) -> view.Spread | None:
    try:
        return spread_view(read.store, result.world_id, result.trajectory.names, blocks)
    except UNREADABLE as error:
        read.missing.append(f"What the data allow of {result.world_id} is not shown: {error}.")
        return None


def _colors(read: CaseRecords) -> dict[str, str]:
    """Return a colour for each object that moves or was seen; worlds say first what it looks like."""
    wanted: dict[str, str | None] = {}
    for world in read.worlds.values():
        for item in (*world.objects, *world.deformables):
            wanted[item.name] = wanted.get(item.name) or item.appearance.color
    for seen in () if read.seen is None else read.seen[1].objects:
        wanted[seen.name] = wanted.get(seen.name) or (None if seen.colour.name == "unknown" else seen.colour.name)
    return distinct_colors(wanted)
