"""The tables of a store and the stamp that marks an SQLite file as a store.

Records addressed by content (worlds, observations, rollouts, fits) carry no time. Order of creation is
the `seq` of the relations that tie them to a case; wall-clock times appear only in `jobs`, where they show
which worker is still alive. Every record has a checksum (`evidence_store.checksums`); jobs and tasks, which
say nothing about the world, have none.

A change of the tables needs a higher VERSION and a step in `evidence_store.migrations`.
"""

APPLICATION_ID = 0x41545731  # "ATW1"
VERSION = 4
RECORDS = 3
"""Since this version the tables of records, all but jobs and tasks, are as they are now."""

EVIDENCE_INDICES = """
CREATE INDEX evidence_by_case ON evidence (case_id, seq, status, objects, interval);
CREATE INDEX evidence_by_tool ON evidence (case_id, tool, seq);
CREATE INDEX evidence_by_rollout ON evidence (rollout_id, case_id, seq);
"""
"""What searches filter by, so that they read no rows of the table but those that they return."""

TASKS = """
CREATE TABLE tasks (
    evidence_seq INTEGER PRIMARY KEY REFERENCES evidence(seq) ON DELETE CASCADE,
    secret TEXT NOT NULL,
    created REAL NOT NULL,             -- Unix time [s]
    ended REAL,                        -- Unix time [s]
    error TEXT                         -- JSON: code, message; NULL where the tool itself answered
);
"""

TABLES = (
    """
CREATE TABLE cases (
    id TEXT PRIMARY KEY,
    content TEXT NOT NULL,             -- hash of the video or data file
    kind TEXT NOT NULL,                -- video | data
    path TEXT NOT NULL,                -- where the content was last seen
    facts TEXT NOT NULL,               -- JSON
    committed_world TEXT REFERENCES worlds(id),
    seq INTEGER NOT NULL UNIQUE,
    checksum TEXT NOT NULL DEFAULT ''
);
CREATE TABLE questions (
    seq INTEGER PRIMARY KEY,
    case_id TEXT NOT NULL REFERENCES cases(id),
    text TEXT NOT NULL,
    checksum TEXT NOT NULL DEFAULT '',
    UNIQUE (case_id, text)
);
CREATE TABLE observations (
    id TEXT PRIMARY KEY,
    kind TEXT NOT NULL,
    inputs TEXT NOT NULL,              -- JSON: everything that determined the content
    document TEXT NOT NULL,            -- JSON
    arrays BLOB,                       -- npz
    checksum TEXT NOT NULL DEFAULT ''
);
CREATE TABLE case_observations (
    seq INTEGER PRIMARY KEY,
    case_id TEXT NOT NULL REFERENCES cases(id),
    kind TEXT NOT NULL,
    observation_id TEXT NOT NULL REFERENCES observations(id),
    checksum TEXT NOT NULL DEFAULT ''
);
CREATE INDEX case_observations_by_case ON case_observations (case_id, kind, seq);
CREATE TABLE worlds (
    id TEXT PRIMARY KEY,
    document TEXT NOT NULL,            -- canonical JSON
    checksum TEXT NOT NULL DEFAULT ''
);
CREATE TABLE world_parents (
    child TEXT NOT NULL REFERENCES worlds(id),
    parent TEXT NOT NULL REFERENCES worlds(id),
    how TEXT NOT NULL,                 -- built | fitted | intervention | effect | committed ...
    detail TEXT NOT NULL,              -- JSON
    checksum TEXT NOT NULL DEFAULT '',
    PRIMARY KEY (child, parent, how, detail)
);
CREATE TABLE case_worlds (
    seq INTEGER PRIMARY KEY,
    case_id TEXT NOT NULL REFERENCES cases(id),
    world_id TEXT NOT NULL REFERENCES worlds(id),
    origin TEXT NOT NULL,
    observation_id TEXT REFERENCES observations(id),   -- the tracks it models
    checksum TEXT NOT NULL DEFAULT '',
    UNIQUE (case_id, world_id)
);
CREATE TABLE rollouts (
    id TEXT PRIMARY KEY,
    kind TEXT NOT NULL,
    inputs TEXT NOT NULL,
    document TEXT NOT NULL,
    arrays BLOB,
    checksum TEXT NOT NULL DEFAULT ''
);
CREATE TABLE fits (
    id TEXT PRIMARY KEY,
    kind TEXT NOT NULL,
    inputs TEXT NOT NULL,
    document TEXT NOT NULL,
    arrays BLOB,
    checksum TEXT NOT NULL DEFAULT ''
);
CREATE TABLE evidence (
    seq INTEGER PRIMARY KEY AUTOINCREMENT,
    case_id TEXT REFERENCES cases(id),
    tool TEXT NOT NULL,
    arguments TEXT NOT NULL,           -- JSON
    world_id TEXT,
    rollout_id TEXT,
    observation_id TEXT,
    objects TEXT NOT NULL,             -- JSON list
    interval TEXT,                     -- JSON [start, end] in seconds
    status TEXT NOT NULL CHECK (status IN ('running', 'completed', 'failed', 'cancelled', 'diverged')),
    summary TEXT NOT NULL,
    payload TEXT NOT NULL,             -- JSON
    attachments BLOB,                  -- npz of byte arrays: pictures
    payload_checksum TEXT NOT NULL DEFAULT '',
    attachments_checksum TEXT NOT NULL DEFAULT '',
    checksum TEXT NOT NULL DEFAULT ''
);
CREATE TABLE bindings (
    seq INTEGER PRIMARY KEY,
    case_id TEXT NOT NULL REFERENCES cases(id),
    name TEXT NOT NULL,                -- as the question says it
    track TEXT,
    object TEXT,
    reason TEXT NOT NULL,
    checksum TEXT NOT NULL DEFAULT ''
);
CREATE TABLE answers (
    seq INTEGER PRIMARY KEY,
    case_id TEXT NOT NULL REFERENCES cases(id),
    question TEXT NOT NULL,
    answer TEXT,                       -- NULL: unresolved
    confidence REAL,
    evidence TEXT NOT NULL,            -- JSON list of evidence ids
    missing TEXT NOT NULL,
    checksum TEXT NOT NULL DEFAULT ''
);
CREATE TABLE jobs (
    evidence_seq INTEGER PRIMARY KEY REFERENCES evidence(seq),
    key TEXT NOT NULL,                 -- what is being computed: equal work is joined, not repeated
    host TEXT NOT NULL,
    pid INTEGER NOT NULL,
    heartbeat REAL NOT NULL,           -- Unix time [s]
    done REAL NOT NULL DEFAULT 0,
    total REAL,
    message TEXT NOT NULL DEFAULT '',
    cancel_requested INTEGER NOT NULL DEFAULT 0,
    curve TEXT                         -- JSON: the error so far, as the worker reports it
);
"""
    + TASKS
    + EVIDENCE_INDICES
)
