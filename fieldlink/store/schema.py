"""The historian's tables: append-only, the same for SQLite and PostgreSQL.

Times are UTC milliseconds since 1970. A value that is missing or bad is NULL, never a number.
`upgrade` brings the tables of an older release up to date.
"""

from __future__ import annotations

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    Connection,
    Float,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    Text,
    inspect,
    text,
)

__all__ = [
    "AVERAGES",
    "DIAGNOSES",
    "ESTIMATES",
    "EVENTS",
    "FINDINGS",
    "META",
    "METADATA",
    "SAMPLES",
    "SCHEMA_VERSION",
    "SLOTS",
    "WORK",
    "WRITEBACKS",
    "WRITERS",
    "upgrade",
]

SCHEMA_VERSION = 5

METADATA = MetaData()

# SQLite counts rows by itself only for a column of type INTEGER.
_ROW_ID = BigInteger().with_variant(Integer(), "sqlite")

META = Table(
    "meta",
    METADATA,
    Column("key", String(40), primary_key=True),
    Column("value", String(200), nullable=False),
)

SAMPLES = Table(
    "samples",
    METADATA,
    Column("id", _ROW_ID, primary_key=True, autoincrement=True),
    Column("loop", Text, nullable=False),
    Column("utc_ms", BigInteger, nullable=False),
    Column("slot", BigInteger, nullable=False),
    Column("op", Float(53)),
    Column("pv", Float(53)),
    Column("sp", Float(53)),
    Column("auto", Boolean),
    Column("quality", Integer, nullable=False),
    Column("late_ms", Integer),
    Column("clock_steps", Integer),
    Index("samples_by_loop", "loop", "utc_ms"),
)

AVERAGES = Table(
    "averages",
    METADATA,
    Column("id", _ROW_ID, primary_key=True, autoincrement=True),
    Column("loop", Text, nullable=False),
    Column("utc_ms", BigInteger, nullable=False),
    Column("length_ms", BigInteger, nullable=False),
    Column("samples", Integer, nullable=False),
    Column("good", Integer, nullable=False),
    Column("op_mean", Float(53)),
    Column("op_min", Float(53)),
    Column("op_max", Float(53)),
    Column("op_std", Float(53)),
    Column("pv_mean", Float(53)),
    Column("pv_min", Float(53)),
    Column("pv_max", Float(53)),
    Column("pv_std", Float(53)),
    Column("sp_mean", Float(53)),
    Column("auto_share", Float(53)),
    Index("averages_by_loop", "loop", "utc_ms"),
)

SLOTS = Table(
    "slots",
    METADATA,
    Column("id", _ROW_ID, primary_key=True, autoincrement=True),
    Column("loop", Text, nullable=False),
    Column("utc_ms", BigInteger, nullable=False),
    Column("seconds", Float(53), nullable=False),
    Column("expected", BigInteger, nullable=False),
    Column("read", BigInteger, nullable=False),
    Column("late", BigInteger, nullable=False),
    Column("missed", BigInteger, nullable=False),
    Column("bad", BigInteger, nullable=False),
    Column("duplicates", BigInteger, nullable=False),
    Column("restarts", BigInteger, nullable=False),
    Index("slots_by_loop", "loop", "utc_ms"),
)

ESTIMATES = Table(
    "estimates",
    METADATA,
    Column("id", _ROW_ID, primary_key=True, autoincrement=True),
    Column("loop", Text, nullable=False),
    Column("utc_ms", BigInteger, nullable=False),
    Column("window_end_ms", BigInteger, nullable=False),
    Column("first_slot", BigInteger, nullable=False),
    Column("last_slot", BigInteger, nullable=False),
    Column("outcome", String(40), nullable=False),
    Column("verdict", String(40)),
    Column("score", Float(53)),
    Column("stick_band", Float(53)),
    Column("stick_band_low", Float(53)),
    Column("stick_band_high", Float(53)),
    Column("slip_jump", Float(53)),
    Column("slip_jump_low", Float(53)),
    Column("slip_jump_high", Float(53)),
    Column("confidence", Float(53)),
    Column("r2", Float(53)),
    Column("criterion", String(40)),
    Column("seconds", Float(53)),
    Column("message", Text, nullable=False),
    Column("document", JSON),
    Index("estimates_by_loop", "loop", "utc_ms"),
    Index("estimates_by_stick_band", "loop", "stick_band"),
)

WRITEBACKS = Table(
    "writebacks",
    METADATA,
    Column("id", _ROW_ID, primary_key=True, autoincrement=True),
    Column("loop", Text, nullable=False),
    Column("utc_ms", BigInteger, nullable=False),
    Column("outcome", String(40), nullable=False),
    Column("reason", Text, nullable=False),
    Column("seq", Integer),
    Column("bank", String(1)),
    Column("status", String(40)),
    Column("stick_band", Float(53)),
    Column("slip_jump", Float(53)),
    Column("words", JSON),
    Column("bank_before", JSON),
    Column("active_before", JSON),
    Index("writebacks_by_loop", "loop", "utc_ms"),
    Index("writebacks_by_outcome", "loop", "outcome", "utc_ms"),
)

EVENTS = Table(
    "events",
    METADATA,
    Column("id", _ROW_ID, primary_key=True, autoincrement=True),
    Column("utc_ms", BigInteger, nullable=False),
    Column("kind", String(60), nullable=False),
    Column("source", Text, nullable=False),
    Column("message", Text, nullable=False),
    Column("detail", JSON),
    Index("events_by_time", "utc_ms"),
)

WORK = Table(
    "work",
    METADATA,
    Column("id", _ROW_ID, primary_key=True, autoincrement=True),
    Column("loop", Text, nullable=False),
    Column("utc_ms", BigInteger, nullable=False),
    Column("state", String(40), nullable=False),
    Column("owner", Text, nullable=False),
    Column("note", Text, nullable=False),
    Column("author", Text, nullable=False),
    Index("work_by_loop", "loop", "utc_ms"),
)

DIAGNOSES = Table(
    "diagnoses",
    METADATA,
    Column("id", _ROW_ID, primary_key=True, autoincrement=True),
    Column("loop", Text, nullable=False),
    Column("utc_ms", BigInteger, nullable=False),
    Column("window_begin_ms", BigInteger, nullable=False),
    Column("window_end_ms", BigInteger, nullable=False),
    Column("outcome", String(40), nullable=False),
    Column("cause", String(40)),
    Column("weight", Float(53)),
    Column("swing_period_s", Float(53)),
    Column("compensated", Boolean, nullable=False),
    Column("message", Text, nullable=False),
    Column("document", JSON),
    Index("diagnoses_by_loop", "loop", "utc_ms"),
)

FINDINGS = Table(
    "findings",
    METADATA,
    Column("id", _ROW_ID, primary_key=True, autoincrement=True),
    Column("finding", String(40), nullable=False),
    Column("utc_ms", BigInteger, nullable=False),
    Column("born_ms", BigInteger, nullable=False),
    Column("state", String(40), nullable=False),
    Column("cause", String(40), nullable=False),
    Column("loop", Text, nullable=False),
    Column("loops", JSON, nullable=False),
    Column("swing_period_s", Float(53)),
    Column("weight", Float(53)),
    Column("message", Text, nullable=False),
    Column("document", JSON),
    Index("findings_by_finding", "finding", "utc_ms"),
    Index("findings_by_time", "utc_ms"),
)

WRITERS = Table(
    "writers",
    METADATA,
    Column("session", String(40), primary_key=True),
    Column("installation", Text, nullable=False),
    Column("host", Text, nullable=False),
    Column("data_dir", Text, nullable=False),
    Column("process", Integer, nullable=False),
    Column("since_ms", BigInteger, nullable=False),
    Column("loops", JSON, nullable=False),
    Column("beat", BigInteger, nullable=False),
)
"""The one table whose rows change and go: the daemons at work, see `fieldlink.store.writers`."""


def upgrade(connection: Connection, version: int) -> None:
    """Bring the tables of schema ``version`` to `SCHEMA_VERSION`; new tables exist already."""
    if version < 2:
        # An upgrade that was cut off may have left one of them.
        present = {column["name"] for column in inspect(connection).get_columns("samples")}
        for column in ("late_ms", "clock_steps"):
            if column not in present:
                connection.execute(text(f"ALTER TABLE samples ADD COLUMN {column} INTEGER"))
    if version < 5:
        for index in ESTIMATES.indexes | WRITEBACKS.indexes:
            index.create(connection, checkfirst=True)
    connection.execute(META.update().where(META.c.key == "schema"), {"value": str(SCHEMA_VERSION)})
