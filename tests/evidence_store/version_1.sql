-- A store of version 1 as the last program of that version wrote it.
PRAGMA application_id = 1096046385;
PRAGMA user_version = 1;
BEGIN TRANSACTION;
CREATE TABLE answers (
    seq INTEGER PRIMARY KEY,
    case_id TEXT NOT NULL REFERENCES cases(id),
    question TEXT NOT NULL,
    answer TEXT,                       -- NULL: unresolved
    confidence REAL,
    evidence TEXT NOT NULL,            -- JSON list of evidence ids
    missing TEXT NOT NULL
);
INSERT INTO "answers" VALUES(1,'ball','will it bounce?','yes',0.9,'["ev-1"]','');
CREATE TABLE bindings (
    seq INTEGER PRIMARY KEY,
    case_id TEXT NOT NULL REFERENCES cases(id),
    name TEXT NOT NULL,                -- as the question says it
    track TEXT,
    object TEXT,
    reason TEXT NOT NULL
);
INSERT INTO "bindings" VALUES(1,'ball','the ball','track-1','ball','only one');
CREATE TABLE case_observations (
    seq INTEGER PRIMARY KEY,
    case_id TEXT NOT NULL REFERENCES cases(id),
    kind TEXT NOT NULL,
    observation_id TEXT NOT NULL REFERENCES observations(id)
);
INSERT INTO "case_observations" VALUES(1,'ball','tracks','obs-2667a78069e83630');
CREATE TABLE case_worlds (
    seq INTEGER PRIMARY KEY,
    case_id TEXT NOT NULL REFERENCES cases(id),
    world_id TEXT NOT NULL REFERENCES worlds(id),
    origin TEXT NOT NULL,
    observation_id TEXT REFERENCES observations(id),   -- the tracks it models
    UNIQUE (case_id, world_id)
);
INSERT INTO "case_worlds" VALUES(1,'ball','world-a','built','obs-2667a78069e83630');
INSERT INTO "case_worlds" VALUES(2,'ball','world-b','fitted','obs-2667a78069e83630');
CREATE TABLE cases (
    id TEXT PRIMARY KEY,
    content TEXT NOT NULL,             -- hash of the video or data file
    kind TEXT NOT NULL,                -- video | data
    path TEXT NOT NULL,                -- where the content was last seen
    facts TEXT NOT NULL,               -- JSON
    committed_world TEXT REFERENCES worlds(id),
    seq INTEGER NOT NULL UNIQUE
);
INSERT INTO "cases" VALUES('ball','abc','video','/ball.mp4','{"frames":3}','world-b',1);
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
    attachments BLOB                   -- npz of byte arrays: pictures
);
INSERT INTO "evidence" VALUES(1,'ball','Rollout','{"horizon":2.0}','world-b','rollout-36320c74044d0d88',NULL,'["ball"]','[0.0,2.0]','completed','fällt','{"data":{"x":[1,null]}}',X'504B03042D000000080000002100923B8C88FFFFFFFFFFFFFFFF09001400612E706E672E6E707901001000840000000000000048000000000000009BEC17EA1B10C9C850C650AD9E925A9C5CA46EA5A05E536AA8AEA3A09E965F54529498179F5F94920A12774BCC294E058A17672416A402F91A263A9A3A0AB50A1400AECE003F7700504B01022D032D000000080000002100923B8C884800000084000000090000000000000000000000800100000000612E706E672E6E7079504B0506000000000100010037000000830000000000');
INSERT INTO "evidence" VALUES(2,NULL,'OpenCase','{}',NULL,NULL,NULL,'[]',NULL,'completed','','{}',NULL);
INSERT INTO "evidence" VALUES(3,'ball','FitWorld','{}',NULL,NULL,NULL,'[]',NULL,'running','','{}',NULL);
CREATE TABLE fits (
    id TEXT PRIMARY KEY,
    kind TEXT NOT NULL,
    inputs TEXT NOT NULL,
    document TEXT NOT NULL,
    arrays BLOB
);
INSERT INTO "fits" VALUES('fit-c067c3ab398eba3c','fit','{"world":"world-b"}','{"loss":0.5}',NULL);
CREATE TABLE jobs (
    evidence_seq INTEGER PRIMARY KEY REFERENCES evidence(seq),
    key TEXT NOT NULL,                 -- what is being computed: equal work is joined, not repeated
    host TEXT NOT NULL,
    pid INTEGER NOT NULL,
    heartbeat REAL NOT NULL,           -- Unix time [s]
    done REAL NOT NULL DEFAULT 0,
    total REAL,
    message TEXT NOT NULL DEFAULT '',
    cancel_requested INTEGER NOT NULL DEFAULT 0
);
INSERT INTO "jobs" VALUES(3,'key','former-host',4242,1790000000.0,0.0,NULL,'',0);
CREATE TABLE observations (
    id TEXT PRIMARY KEY,
    kind TEXT NOT NULL,
    inputs TEXT NOT NULL,              -- JSON: everything that determined the content
    document TEXT NOT NULL,            -- JSON
    arrays BLOB                        -- npz
);
INSERT INTO "observations" VALUES('obs-2667a78069e83630','tracks','{"video":"abc"}','{"names":["ball"]}',X'504B03042D0000000800000021002421E12BFFFFFFFFFFFFFFFF05001400782E6E70790100100098000000000000004C000000000000009BEC17EA1B10C9C850C650AD9E925A9C5CA46EA5A06E9366A1AEA3A09E965F54529498179F5F94920A12774BCC294E058A17672416A402F91AC63A9A3A0AB50A14002E0614F0C11ECA700000504B01022D032D0000000800000021002421E12B4C00000098000000050000000000000000000000800100000000782E6E7079504B0506000000000100010033000000830000000000');
CREATE TABLE questions (
    seq INTEGER PRIMARY KEY,
    case_id TEXT NOT NULL REFERENCES cases(id),
    text TEXT NOT NULL,
    UNIQUE (case_id, text)
);
INSERT INTO "questions" VALUES(1,'ball','will it bounce?');
CREATE TABLE rollouts (
    id TEXT PRIMARY KEY,
    kind TEXT NOT NULL,
    inputs TEXT NOT NULL,
    document TEXT NOT NULL,
    arrays BLOB
);
INSERT INTO "rollouts" VALUES('rollout-36320c74044d0d88','rollout','{"world":"world-b"}','{"n":2}',X'504B03042D000000080000002100EC1DA9D5FFFFFFFFFFFFFFFF05001400782E6E70790100100090000000000000004D000000000000009BEC17EA1B10C9C850C650AD9E925A9C5CA46EA5A06E9366A1AEA3A09E965F54529498179F5F94920A12774BCC294E058A17672416A402F91A463A9A3A0AB50A14002E0630F8600FA17FD40300504B01022D032D000000080000002100EC1DA9D54D00000090000000050000000000000000000000800100000000782E6E7079504B0506000000000100010033000000840000000000');
CREATE TABLE world_parents (
    child TEXT NOT NULL REFERENCES worlds(id),
    parent TEXT NOT NULL REFERENCES worlds(id),
    how TEXT NOT NULL,                 -- built | fitted | intervention | effect | committed ...
    detail TEXT NOT NULL,              -- JSON
    PRIMARY KEY (child, parent, how, detail)
);
INSERT INTO "world_parents" VALUES('world-b','world-a','fitted','{"loss":0.5}');
CREATE TABLE worlds (
    id TEXT PRIMARY KEY,
    document TEXT NOT NULL             -- canonical JSON
);
INSERT INTO "worlds" VALUES('world-a','{"a":1}');
INSERT INTO "worlds" VALUES('world-b','{"b":1}');
CREATE INDEX case_observations_by_case ON case_observations (case_id, kind, seq);
CREATE INDEX evidence_by_case ON evidence (case_id, seq);
DELETE FROM "sqlite_sequence";
INSERT INTO "sqlite_sequence" VALUES('evidence',3);
COMMIT;
