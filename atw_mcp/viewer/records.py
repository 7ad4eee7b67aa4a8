"""Read the records of a case that a document is made of; what cannot be read is left out and said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from atw_mcp.observation.observing import image_observation
from atw_mcp.observation.recording_records import KIND as RECORDING
from atw_mcp.observation.recording_records import recording_of
from atw_mcp.observation.track_records import KIND as TRACKS
from atw_mcp.observation.track_records import TrackRecord, at_rate
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.viewer.document import EditWords
from atw_mcp.viewer.edits import branch_label, edit_words
from atw_mcp.viewer.effects import standard_name
from atw_mcp.worlds.rollouts import rollout_from
from evidence_store import Case, Descent, Evidence, EvidenceStore, StoreError, UnknownRecord
from polyworld.data.recording import Recording
from polyworld.data.tracks import ObservedTracks
from polyworld.trajectory import Rollout
from polyworld.world import Effect, World

MOST_ROLLOUTS = 16  # as many as a list shows at once; those used last
MOST_WORLDS = 40  # likewise of worlds that no rollout shown is of
UNREADABLE = (StoreError, ValueError, KeyError, TypeError)  # raised for records that are damaged, or not of this form
LABELS = {"built": "as built", "given": "as given", "fitted": "as fitted"}
BRANCH = "intervention"


@dataclass
class CaseRecords:
    """Records of a case by id, oldest first, and sentences about those that are missing.

    origins: how the case came by each world. modelled: the track record that each models, if any. descents: what
    worlds were made from. bases: of rollouts of branches, the rollout of the unedited world that is nearest in length;
    None of others.
    """

    store: EvidenceStore
    case: Case
    evidence: list[Evidence] = field(default_factory=list)
    seen: tuple[str, ImageObservation] | None = None
    tracks: dict[str, TrackRecord] = field(default_factory=dict)
    recordings: dict[str, Recording] = field(default_factory=dict)
    worlds: dict[str, World] = field(default_factory=dict)
    origins: dict[str, str] = field(default_factory=dict)
    modelled: dict[str, str | None] = field(default_factory=dict)
    descents: dict[str, Descent] = field(default_factory=dict)
    rollouts: dict[str, Rollout] = field(default_factory=dict)
    bases: dict[str, str | None] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)

    def edits(self, world: str) -> list[EditWords]:
        """Return the edits that made a branch; empty where a world is none."""
        descent = self.descents.get(world)
        if descent is None or descent.how != BRANCH:
            return []
        return [edit_words(edit) for edit in descent.detail.get("edits", [])]

    def world_labels(self) -> dict[str, str]:
        """Return what each world is, in a few words; the second that is the same with its number."""
        found: dict[str, str] = {}
        for world in self.worlds:
            label = self._label(world)
            same = sum(other == label or other.startswith(f"{label} (") for other in found.values())
            found[world] = f"{label} ({same + 1})" if same else label
        return found

    def rollout_labels(self) -> dict[str, str]:
        """Return of which world each rollout is, and how far it runs where others are of the same."""
        worlds = self.world_labels()
        runs = [result.world_id for result in self.rollouts.values()]
        return {
            rollout: worlds[result.world_id]
            + (f", to {result.horizon:.4g} s" if runs.count(result.world_id) > 1 else "")
            for rollout, result in self.rollouts.items()
        }

    def _label(self, world: str) -> str:
        edits = self.edits(world)
        if edits:
            return branch_label(edits)
        origin = self.origins.get(world) or "given"
        descent = self.descents.get(world)
        if origin == "effect_added" and descent is not None and descent.parent in self.worlds:
            before = {effect.name for effect in self.worlds[descent.parent].effects}
            added = [_effect_words(effect) for effect in self.worlds[world].effects if effect.name not in before]
            return f"with {', '.join(added)}" if added else "with effects fitted again"
        return LABELS.get(origin, origin.replace("_", " "))

    def tracks_of(self, world: str) -> ObservedTracks | None:
        """Return the tracks that a world models, in its time base; None of a branch, which is meant to differ."""
        descent = self.descents.get(world)
        if world not in self.worlds or not self.tracks or (descent is not None and descent.how == BRANCH):
            return None
        record = self.tracks.get(self.modelled.get(world) or "") or next(reversed(self.tracks.values()))
        return at_rate(record.tracks, self.worlds[world].time.seconds_per_frame)

    def modelled_by(self, observation: str) -> World | None:
        """Return the world that models a track record: the committed one where it does, else the latest."""
        models = [w for w in self.worlds if self.modelled.get(w) == observation] or list(self.worlds)
        if not models:
            return None
        committed = self.case.committed_world
        return self.worlds[committed if committed in models else models[-1]]


def read_case(store: EvidenceStore, identifier: str, first: Sequence[str] = ()) -> CaseRecords:
    """Read a case; first: rollouts that are to be among those read.

    Raises UnknownRecord for a case or a rollout of `first` that is not there, naming those that are, and RecordDamaged
    where the record of the case itself is not intact.
    """
    case = store.cases.get(identifier)
    read = CaseRecords(store, case)
    rows = store.evidence.of_case(case.id)
    # Work of a process that ended is not running.
    read.evidence = [replace(store.read_evidence(r.id), payload={}) if r.status == "running" else r for r in rows]
    read.missing += [_sentence(f"{name} is damaged and left out") for name in store.evidence.damaged(case.id)]
    _read_observations(read)
    _read_rollouts(read, first)
    _read_worlds(read)
    for rollout in read.rollouts:
        read.bases[rollout] = _base_of(read, rollout)
    if not read.worlds:
        read.missing.append("The case has no world yet.")
    elif not read.rollouts:
        read.missing.append(
            "No rollout of this case's world is stored yet: the tool Rollout makes one. It is shown at its start."
        )
    return read


def _read_observations(read: CaseRecords) -> None:
    """Read the latest observation of the video, all tracks, and the latest recording."""
    try:
        listed = read.store.cases.observations(read.case.id)
    except StoreError as error:
        read.missing.append(_sentence(f"Observations cannot be shown: {error}"))
        return
    for kind, identifier in reversed(listed):
        try:
            if kind == "objects":
                read.seen = identifier, image_observation(read.store.observations.get(identifier))
            elif kind == TRACKS:
                record = TrackRecord.of(read.store.observations.get(identifier))
                read.tracks[identifier] = record
                measured = list(dict.fromkeys(series.object for series in record.tracks.shapes))
                if measured:
                    read.missing.append(f"Measured shapes of {', '.join(measured)} are not shown, only positions.")
            elif kind == RECORDING:
                document = read.store.observations.get(identifier).document
                read.recordings = {identifier: recording_of(document)}
        except UNREADABLE as error:
            read.missing.append(_sentence(f"Observation {identifier} cannot be shown: {error}"))


def _read_rollouts(read: CaseRecords, first: Sequence[str]) -> None:
    """Read the rollouts that evidence is about: those asked for, then those used last."""
    used = list(dict.fromkeys(row.rollout for row in reversed(read.evidence) if row.rollout is not None))
    for rollout in first:
        if rollout not in used and not _of_this_file(read, rollout):
            raise UnknownRecord(f"case {read.case.id!r} has no rollout {rollout!r}; its rollouts, latest first: {used}")
    wanted = list(dict.fromkeys([*first, *used]))
    if len(wanted) > MOST_ROLLOUTS:
        read.missing.append(
            f"{len(wanted) - MOST_ROLLOUTS} of {len(wanted)} rollouts are not shown, those used longest ago; "
            "`atw-mcp report --rollout ID` shows one."
        )
    shown = set(wanted[:MOST_ROLLOUTS])
    for identifier in dict.fromkeys((*(r for r in reversed(used) if r in shown), *first)):
        try:
            content = read.store.rollouts.get(identifier)
            result = rollout_from(content.document, content.arrays)
        except UNREADABLE as error:
            read.missing.append(_sentence(f"Rollout {identifier} cannot be shown: {error}"))
            continue
        if not len(result.trajectory.times):
            read.missing.append(f"Rollout {identifier} has no sample: it {result.why_ended()}.")
            continue
        read.rollouts[identifier] = result


def _of_this_file(read: CaseRecords, rollout: str) -> bool:
    """Return whether a rollout that no evidence of the case is about is of a world of this case, or of another case of
    the same file, with which it may be compared."""
    cases = read.store.cases
    try:
        world = str(read.store.rollouts.get(rollout).document["world"])
        return any(cases.has_world(c.id, world) for c in cases.all() if c.content == read.case.content)
    except UNREADABLE:
        return False


def _read_worlds(read: CaseRecords) -> None:
    """Read the worlds of the case and those of its rollouts, and what each was made from."""
    cases, case = read.store.cases, read.case.id
    try:
        listed = dict(cases.worlds(case))
        read.modelled = {world: cases.modelled_observation(case, world) for world in listed}
    except StoreError as error:
        read.missing.append(_sentence(f"The case's list of worlds cannot be read: {error}"))
        listed = {}
    needed = {result.world_id for result in read.rollouts.values()}
    others = [world for world in listed if world not in needed and world != read.case.committed_world]
    if len(others) > MOST_WORLDS:
        read.missing.append(
            f"{len(others) - MOST_WORLDS} of {len(listed)} worlds are not shown, the oldest without one."
        )
    left_out = set(others[:-MOST_WORLDS])
    for identifier in [*(world for world in listed if world not in left_out), *sorted(needed - listed.keys())]:
        try:
            world = World.model_validate_json(read.store.worlds.document(identifier))
            parents = read.store.worlds.parents(identifier)
        except UNREADABLE as error:
            read.missing.append(_sentence(f"World {identifier} cannot be shown: {error}"))
            continue
        read.worlds[identifier], read.origins[identifier] = world, listed.get(identifier, "")
        if parents:
            read.descents[identifier] = parents[-1]
    for rollout in [r for r, result in read.rollouts.items() if result.world_id not in read.worlds]:
        read.missing.append(f"Rollout {rollout} is not shown, because its world is not.")
        del read.rollouts[rollout]


def _base_of(read: CaseRecords, rollout: str) -> str | None:
    result = read.rollouts[rollout]
    descent = read.descents.get(result.world_id)
    if descent is None or descent.how != BRANCH:
        return None
    others = [k for k, other in read.rollouts.items() if other.world_id == descent.parent]
    return min(others, key=lambda k: abs(read.rollouts[k].horizon - result.horizon), default=None)


def _effect_words(effect: Effect) -> str:
    """Return an effect's name, with its standard name where that is another and its own does not say it."""
    standard = standard_name(effect)
    return f"{effect.name} ({standard.replace('_', ' ')})" if standard and standard not in effect.name else effect.name


def _sentence(text: str) -> str:
    text = " ".join(text.split())
    return text if text.endswith(".") else text + "."
