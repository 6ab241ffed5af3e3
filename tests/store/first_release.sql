-- The tables of the first release (schema 1), as its SQLAlchemy made them in SQLite, and some rows.
PRAGMA journal_mode = WAL;
CREATE TABLE meta ("key" VARCHAR(40) NOT NULL, value VARCHAR(200) NOT NULL, PRIMARY KEY ("key"));
CREATE TABLE samples (
    id INTEGER NOT NULL, loop VARCHAR(80) NOT NULL, utc_ms BIGINT NOT NULL, slot BIGINT NOT NULL,
    op FLOAT, pv FLOAT, sp FLOAT, auto BOOLEAN, quality INTEGER NOT NULL, PRIMARY KEY (id)
);
CREATE INDEX samples_by_loop ON samples (loop, utc_ms);
CREATE TABLE estimates (
    id INTEGER NOT NULL, loop VARCHAR(80) NOT NULL, utc_ms BIGINT NOT NULL,
    window_end_ms BIGINT NOT NULL, first_slot BIGINT NOT NULL, last_slot BIGINT NOT NULL,
    outcome VARCHAR(40) NOT NULL, verdict VARCHAR(40), score FLOAT,
    stick_band FLOAT, stick_band_low FLOAT, stick_band_high FLOAT,
    slip_jump FLOAT, slip_jump_low FLOAT, slip_jump_high FLOAT,
    confidence FLOAT, r2 FLOAT, criterion VARCHAR(40), seconds FLOAT, message TEXT NOT NULL,
    document JSON, PRIMARY KEY (id)
);
CREATE INDEX estimates_by_loop ON estimates (loop, utc_ms);
CREATE TABLE writebacks (
    id INTEGER NOT NULL, loop VARCHAR(80) NOT NULL, utc_ms BIGINT NOT NULL,
    outcome VARCHAR(40) NOT NULL, reason TEXT NOT NULL, seq INTEGER, bank VARCHAR(1),
    status VARCHAR(40), stick_band FLOAT, slip_jump FLOAT, words JSON, bank_before JSON,
    active_before JSON, PRIMARY KEY (id)
);
CREATE INDEX writebacks_by_loop ON writebacks (loop, utc_ms);
CREATE TABLE events (
    id INTEGER NOT NULL, utc_ms BIGINT NOT NULL, kind VARCHAR(60) NOT NULL,
    source VARCHAR(80) NOT NULL, message TEXT NOT NULL, detail JSON, PRIMARY KEY (id)
);
CREATE INDEX events_by_time ON events (utc_ms);
INSERT INTO meta VALUES ('schema', '1');
INSERT INTO samples VALUES
    (1, 'FC101', 1767268800000, 0, 40.5, 51.25, 50.0, 1, 0),
    (2, 'FC101', 1767268801000, 1, NULL, NULL, NULL, NULL, 3),
    (3, 'FC101', 1767268802000, 2, 41.5, 52.25, 50.0, 1, 0);
INSERT INTO estimates VALUES
    (1, 'FC101', 1767268802000, 1767268802000, 0, 2, 'estimated', 'stiction', 12.5,
     7.0, 6.5, 7.5, 2.0, 1.5, 2.5, 0.9, 0.8, 'arx', 0.4, '', '{"verdict": "stiction"}');
INSERT INTO writebacks VALUES
    (1, 'FC101', 1767268803000, 'accepted', '', 41, 'A', 'valid', 7.0, 2.0, '[1, 2]', NULL, NULL);
INSERT INTO events VALUES (1, 1767268800000, 'daemon.start', 'daemon', 'plant1', NULL);
