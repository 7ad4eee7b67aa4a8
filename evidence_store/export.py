"""A case as one zip file, with everything it rests on, from one store to another.

`manifest.json` names the case and the SHA-256 and size of every other file; `records/TABLE.jsonl` holds the rows with
their checksums; `arrays/SHA256` are the packed arrays and pictures of rows; `provenance.json` is W3C PROV-JSON.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlite_utils import Database

from evidence_store.checksums import COLUMNS, PARTS, intact
from evidence_store.errors import BadArchive, StoreError
from evidence_store.merge import insert_rows
from evidence_store.migrations import PACKED_COLUMNS, readable
from evidence_store.provenance import prov_json
from evidence_store.references import Referred, referred
from evidence_store.renumbering import Renumbering
from evidence_store.schema import RECORDS
from evidence_store.store import EvidenceStore

FORMAT = "atw-case"
MANIFEST = "manifest.json"
PROVENANCE = "provenance.json"
DATE = (1980, 1, 1, 0, 0, 0)  # of every file: equal cases give equal archives
_NAME = re.compile(rf"records/(?:{'|'.join(COLUMNS)})\.jsonl|arrays/[0-9a-f]{{64}}|{re.escape(PROVENANCE)}")


@dataclass(frozen=True)
class ArchiveLimits:
    """How much an archive may hold: a case of a hundred long rollouts has some GB in some hundred files.

    total: bytes of all files, unpacked. arrays: bytes of the arrays of one record, unpacked. files: their number.
    """

    total: int = 4 << 30
    arrays: int = 1 << 30
    files: int = 100_000


def export_case(store: EvidenceStore, case: str, target: Path) -> dict[str, int]:
    """Write a case to a zip file; returns the number of records of each table.

    Raises UnknownRecord, RecordDamaged, or StoreError where `target` exists or work on the case is still running.
    """
    if target.exists():
        raise StoreError(f"{target} exists already: choose another name, or move it away first")
    store.cases.get(case)
    for record in store.evidence.of_case(case):
        if record.status == "running" and store.read_evidence(record.id).status == "running":
            raise StoreError(f"{record.id} ({record.tool}) is still running: wait until it is done, or cancel it")
    part = target.with_name(target.name + ".part")
    try:
        with store.connection.snapshot(), zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
            counts = _write(store, case, archive)
        part.replace(target)
    except OSError as error:
        raise StoreError(f"{target} cannot be written ({error.strerror}): choose another place") from error
    finally:
        part.unlink(missing_ok=True)
    return counts


def import_case(
    store: EvidenceStore, file: Path, limits: ArchiveLimits | None = None
) -> tuple[Renumbering, dict[str, int]]:
    """Store a case that `export_case` wrote; returns its ids here and the number of its records of each table.

    Evidence keeps its ids where they are free; else all of it is renumbered, and each record keeps its old id.
    All of it is stored, or nothing. Raises BadArchive where the file is not as it was written or exceeds the limits.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            content = _Archive(archive, limits or ArchiveLimits())
            rows = {table: content.rows(table) for table in COLUMNS}
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError, RuntimeError, EOFError) as error:
        # RuntimeError: encrypted, or packed in an unknown way
        raise BadArchive(f"{file} is no case that `atw-mcp export` wrote ({error}); nothing was imported") from error
    except (zipfile.BadZipFile, zlib.error) as error:
        raise BadArchive(f"{file} is damaged or no zip file ({error}); nothing was imported") from error
    _refuse_strangers(file, content.case, rows)
    with store.connection.write() as database:
        ids = Renumbering.of(database, rows)
        insert_rows(store, ids.rows(rows))
    return ids, {table: len(found) for table, found in rows.items()}


def _write(store: EvidenceStore, case: str, archive: zipfile.ZipFile) -> dict[str, int]:
    files: dict[str, dict[str, Any]] = {}
    counts: dict[str, int] = {}

    def add(name: str, data: bytes, packing: int = zipfile.ZIP_DEFLATED) -> None:
        if name in files:  # equal arrays of two records
            return
        files[name] = {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}
        archive.writestr(zipfile.ZipInfo(name, DATE), data, packing)

    with store.connection.read() as database:
        used = referred(database.conn, case)
        for table in COLUMNS:
            lines = []
            for row in _rows_of(database, table, case, used):
                (whole,) = store.connection.verified(table, [row])
                for column in PACKED_COLUMNS:
                    if whole.get(column) is not None:
                        digest = hashlib.sha256(whole[column]).hexdigest()
                        add(f"arrays/{digest}", whole[column], zipfile.ZIP_STORED)  # compressed already
                        whole[column] = {"sha256": digest}
                lines.append(json.dumps(whole) + "\n")
            add(f"records/{table}.jsonl", "".join(lines).encode())
            counts[table] = len(lines)
    add(PROVENANCE, prov_json(store, case).encode())
    manifest = {"format": FORMAT, "version": RECORDS, "case": case, "records": counts, "files": files}
    archive.writestr(zipfile.ZipInfo(MANIFEST, DATE), json.dumps(manifest, indent=1), zipfile.ZIP_DEFLATED)
    return counts


def _rows_of(database: Database, table: str, case: str, used: Referred) -> Any:
    if table in ("cases", "evidence") or "case_id" in COLUMNS[table]:
        key = "id" if table == "cases" else "case_id"
        yield from database.query(f"SELECT * FROM {table} WHERE {key} = ? ORDER BY seq", [case])
        return
    key = "child" if table == "world_parents" else "id"
    wanted = used.worlds if table in ("worlds", "world_parents") else used.contents
    for rowid, identifier in database.conn.execute(
        f"SELECT rowid, {key} FROM {table} ORDER BY {key}, rowid"
    ).fetchall():
        if identifier in wanted:
            yield from database.query(f"SELECT * FROM {table} WHERE rowid = ?", [rowid])


class _Archive:
    """The files of an archive, each read only after its name, its size and its sum were checked.

    Nothing is unpacked to the disk. Raises ValueError for what is not as `export_case` writes it.
    """

    def __init__(self, archive: zipfile.ZipFile, limits: ArchiveLimits) -> None:
        self._archive, self._limits = archive, limits
        entries = archive.infolist()
        self._sizes = {entry.filename: entry.file_size for entry in entries}
        if len(self._sizes) != len(entries):
            raise ValueError("two of its files have the same name")
        if len(entries) > limits.files:
            raise ValueError(f"it has {len(entries)} files, at most {limits.files} are read")
        if sum(self._sizes.values()) > limits.total:
            raise ValueError(f"it unpacks to {sum(self._sizes.values())} bytes, at most {limits.total} are read")
        for name in self._sizes:
            if name != MANIFEST and not _NAME.fullmatch(name):
                raise ValueError(f"it has a file {name[:80]!r}, which no export writes")
        manifest = json.loads(self._bytes(MANIFEST))
        if manifest["format"] != FORMAT or manifest["version"] != RECORDS:
            raise ValueError(
                f"it has format {str(manifest['format'])[:40]} {str(manifest['version'])[:40]}, this program reads "
                f"{FORMAT} {RECORDS}"
            )
        self.case = str(manifest["case"])
        self._sums = {str(name): str(facts["sha256"]) for name, facts in manifest["files"].items()}
        if self._sums.keys() != self._sizes.keys() - {MANIFEST}:
            raise ValueError("its manifest does not name the files it has")

    def rows(self, table: str) -> list[dict[str, Any]]:
        """The rows of a table, each verified."""
        expected = {*COLUMNS[table], "checksum", *(PARTS if table == "evidence" else ())}
        found = []
        for line in self.read(f"records/{table}.jsonl").decode().splitlines():
            row = json.loads(line)
            if set(row) != expected:
                raise ValueError(f"a record of {table} has other fields than it should")
            for column in PACKED_COLUMNS:
                if row.get(column) is not None:
                    row[column] = self._packed(row[column]["sha256"])
            if not intact(table, row) or not readable(row):
                raise ValueError(f"a record of {table} does not fit its checksum or cannot be read")
            found.append(row)
        return found

    def read(self, name: str) -> bytes:
        """A file whose SHA-256 is the manifest's."""
        data = self._bytes(name)
        if hashlib.sha256(data).hexdigest() != self._sums[name]:
            raise ValueError(f"{name} does not fit its SHA-256")
        return data

    def _bytes(self, name: str) -> bytes:
        with self._archive.open(name) as file:
            data = file.read(self._sizes[name] + 1)
        if len(data) != self._sizes[name]:
            raise ValueError(f"{name} has another size than it says")
        return data

    def _packed(self, digest: str) -> bytes:
        data = self.read(f"arrays/{digest}")
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            size = sum(entry.file_size for entry in packed.infolist())
        if size > self._limits.arrays:
            raise ValueError(f"arrays of one record unpack to {size} bytes, at most {self._limits.arrays} are read")
        return data


def _refuse_strangers(file: Path, case: str, rows: dict[str, list[dict[str, Any]]]) -> None:
    """Raise BadArchive where a record belongs to another case than the one of the manifest."""
    owners = {row["case_id"] for found in rows.values() for row in found if "case_id" in row}
    if [row["id"] for row in rows["cases"]] != [case] or owners - {case}:
        raise BadArchive(f"{file} does not hold exactly the case {case!r}; nothing was imported")
