"""The same schema in PostgreSQL: a real server, begun for these tests."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from fieldlink.store import (
    EstimateRecord,
    EventRecord,
    Historian,
    HistorianSettings,
    Retention,
    SampleRecord,
    StoreError,
    WritebackRecord,
    back_up,
    export,
    read_averages,
    read_estimates,
    read_events,
    read_samples,
    read_writebacks,
)
from fieldlink.store.postgresql import connection_patience
from tests.store.writers import killed_is_replaced, second_is_refused, sleeper_waits
from tests.web.test_newest_rows import check_newest, fill_windows

pytest.importorskip("psycopg", reason="the driver is an extra: pip install 'fieldlink[postgresql]'")

OPENED = EventRecord(1_795_262_400_000, "start", "daemon", "started")
QUICK = HistorianSettings(linger=0.01, retry=0.05, busy_timeout=2.0, flush=60.0)
DAY_MS = 86_400_000


def binaries() -> Path:
    places = [*sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)]
    if (found := shutil.which("pg_ctl")) is not None:
        places.append(Path(found).resolve().parent)
    for place in places:
        if (place / "initdb").exists():
            return place
    pytest.skip("there is no PostgreSQL server here: apt-get install postgresql")


@dataclass
class Server:
    """A server of our own that can be reached through a socket in its folder only."""

    bin: Path
    data: Path
    user: str | None

    @property
    def url(self) -> str:
        return f"postgresql://keeper:hunter2@/postgres?host={self.data.parent}"

    def call(self, program: str, *arguments: str) -> None:
        before = [] if self.user is None else ["runuser", "-u", self.user, "--"]
        subprocess.run(
            [*before, str(self.bin / program), *arguments],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd=self.data.parent,
        )

    def start(self) -> None:
        options = f"-c listen_addresses= -c unix_socket_directories={self.data.parent} -c fsync=off"
        self.call("pg_ctl", "-D", str(self.data), "-w", "-o", options, "start")

    def stop(self) -> None:
        self.call("pg_ctl", "-D", str(self.data), "-m", "immediate", "-w", "stop")


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    place = binaries()
    user = None
    # Short: a socket's path has at most 107 characters.
    folder = Path(tempfile.mkdtemp(prefix="fl-pg-"))
    try:
        if os.geteuid() == 0:
            user = "postgres"
            shutil.chown(folder, user)
        made = Server(place, folder / "data", user)
        made.call("initdb", "-D", str(made.data), "-U", "keeper", "-A", "trust", "-N")
        made.start()
        try:
            yield made
        finally:
            made.stop()
    finally:
        shutil.rmtree(folder)


@pytest.fixture
def url(server: Server) -> Iterator[str]:
    yield server.url
    import sqlalchemy

    engine = sqlalchemy.create_engine(server.url.replace("postgresql:", "postgresql+psycopg:"))
    with engine.begin() as connection:
        connection.execute(sqlalchemy.text("DROP SCHEMA public CASCADE; CREATE SCHEMA public"))
    engine.dispose()


def sample(slot: int, utc_ms: int = 0) -> SampleRecord:
    stamp = utc_ms or 1_795_262_400_000 + 1000 * slot
    return SampleRecord("FC101", stamp, slot, 50.0 + slot, float("nan"), None, True, 1, 3, 0)


def test_rows_come_back_as_they_went_in(url: str, tmp_path: Path) -> None:
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    for slot in range(3000):
        historian.put(sample(slot))
    document = {"fit": {"r2": None}, "reasons": ["a"]}
    historian.put(
        EstimateRecord("FC101", 1, 1, 0, 9, "estimated", "", "stiction", document=document)
    )
    historian.put(WritebackRecord("FC101", 1, "committed", "", seq=3, words=(1, 2)))
    report = historian.stop()
    assert (report.written, report.dropped, report.last_error) == (3003, 0, "")
    frame = read_samples(url, "FC101")
    assert frame["slot"].tolist() == list(range(3000))
    assert frame["pv"].isna().all()
    assert frame["op"].iloc[-1] == 3049.0
    assert read_estimates(url).iloc[0]["document"] == document
    assert read_writebacks(url).iloc[0]["words"] == [1, 2]
    assert export(url, tmp_path / "a.csv", loop="FC101").rows == 3000


def test_retention_makes_the_same_averages(url: str) -> None:
    begin = (round(1000.0 * time.time()) - 3 * DAY_MS) // 600_000 * 600_000
    historian = Historian(
        url, QUICK, retention=Retention(samples_days=2.0, average_minutes=10.0, max_bytes=10)
    )
    historian.start(OPENED)
    for k in range(600):
        historian.put(SampleRecord("FC101", begin + 1000 * k, k, float(k % 2), 1.0, None, True, 0))
    while historian.report().waiting:
        time.sleep(0.005)
    historian.tidy()
    while historian.report().removed < 600:
        time.sleep(0.005)
    assert historian.stop().last_error == ""
    (row,) = read_averages(url).to_dict("records")
    assert (row["samples"], row["op_mean"], row["op_std"], row["pv_std"]) == (600, 0.5, 0.5, 0.0)


def test_a_server_that_is_restarted_loses_nothing(server: Server, url: str) -> None:
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    historian.put(sample(0))
    while historian.report().written < 2:
        time.sleep(0.005)
    server.stop()
    for slot in range(1, 100):
        historian.put(sample(slot))
    while historian.report().retries == 0:
        time.sleep(0.005)
    assert historian.report().failing
    server.start()
    while historian.report().waiting:
        time.sleep(0.005)
    report = historian.stop()
    assert (report.dropped, report.failing) == (0, False)
    assert read_samples(url)["slot"].tolist() == list(range(100))
    assert read_events(url)["kind"].tolist() == [
        "start", "store.cannot_write", "store.writable_again"
    ]  # fmt: skip


def statements(url: str, *texts: str) -> None:
    import sqlalchemy

    address = url.replace("postgresql:", "postgresql+psycopg:")
    engine = sqlalchemy.create_engine(address, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        for text in texts:
            connection.execute(sqlalchemy.text(text))
    engine.dispose()


def test_records_wait_while_the_server_is_read_only_or_a_table_is_locked(url: str) -> None:
    """A stand-by after a switch-over, a disk that is nearly full; VACUUM FULL, ALTER TABLE."""
    import sqlalchemy

    historian = Historian(url, replace(QUICK, busy_timeout=0.1))
    historian.start(OPENED)
    others = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid()"
    statements(url, "ALTER DATABASE postgres SET default_transaction_read_only = on", others)
    historian.put(sample(0))
    while historian.report().retries < 2:
        time.sleep(0.005)
    assert historian.report().failing
    assert "read-only transaction" in historian.report().last_error
    statements(
        url,
        "SET default_transaction_read_only = off",
        "ALTER DATABASE postgres RESET default_transaction_read_only",
        others,
    )
    while historian.report().waiting:
        time.sleep(0.005)
    engine = sqlalchemy.create_engine(url.replace("postgresql:", "postgresql+psycopg:"))
    with engine.begin() as connection:
        connection.execute(sqlalchemy.text("LOCK TABLE samples IN ACCESS EXCLUSIVE MODE"))
        historian.put(sample(1))
        while not historian.report().failing:
            time.sleep(0.005)
        assert "lock timeout" in historian.report().last_error
    engine.dispose()
    report = historian.stop()
    assert (report.dropped, report.failing) == (0, False)
    assert read_samples(url)["slot"].tolist() == [0, 1]


def test_a_server_that_falls_silent_is_not_waited_for_without_end() -> None:
    """Linux tries for a quarter of an hour; what the site file says itself stays as it says."""
    from sqlalchemy.engine import make_url

    bounds = connection_patience(make_url("postgresql://db/history?connect_timeout=60"), 5.0)
    assert "connect_timeout" not in bounds
    assert bounds["tcp_user_timeout"] <= 30_000
    probes = bounds["keepalives_interval"] * bounds["keepalives_count"]
    assert bounds["keepalives_idle"] + probes <= 30


def test_a_server_that_is_not_there_is_named_without_the_password(tmp_path: Path) -> None:
    url = f"postgresql://keeper:hunter2@/postgres?host={tmp_path}"
    with pytest.raises(StoreError, match=r"cannot be written.* check that the server") as caught:
        Historian(url, QUICK).start(OPENED)
    assert "keeper" in str(caught.value)
    assert "hunter2" not in str(caught.value)


def test_backup_is_left_to_the_servers_own_tool(url: str, tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="pg_dump") as caught:
        back_up(url, tmp_path / "copy")
    assert "hunter2" not in str(caught.value)


def test_another_programs_database_is_refused_untouched(url: str) -> None:
    import sqlalchemy

    engine = sqlalchemy.create_engine(url.replace("postgresql:", "postgresql+psycopg:"))
    with engine.begin() as connection:
        connection.execute(sqlalchemy.text("CREATE TABLE orders (number INTEGER)"))
        connection.execute(sqlalchemy.text("CREATE TABLE events (at TEXT, what TEXT)"))
    with pytest.raises(StoreError, match=r"another program \(tables events, orders\)"):
        Historian(url, QUICK).start(OPENED)
    assert sorted(sqlalchemy.inspect(engine).get_table_names()) == ["events", "orders"]
    with engine.begin() as connection:
        connection.execute(sqlalchemy.text("DROP TABLE events"))
        connection.execute(sqlalchemy.text("CREATE TABLE meta (key TEXT, value TEXT)"))
        connection.execute(sqlalchemy.text("INSERT INTO meta VALUES ('schema', '99')"))
    with pytest.raises(StoreError, match="has schema 99"):
        Historian(url, QUICK).start(OPENED)
    assert sorted(sqlalchemy.inspect(engine).get_table_names()) == ["meta", "orders"]
    engine.dispose()


def test_a_row_that_the_server_cannot_hold_costs_itself_only(url: str) -> None:
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    for slot in (0, 2**63, 2**70, 1):
        historian.put(sample(slot, utc_ms=1))
    while historian.report().dropped < 2:
        time.sleep(0.005)
    assert historian.stop().dropped == 2
    assert read_samples(url)["slot"].tolist() == [0, 1]


def test_a_fleet_is_read_from_the_historian_and_from_a_table_of_another(
    url: str, tmp_path: Path
) -> None:
    import sqlalchemy

    from fieldlink.assess import Cut, Job, Piece
    from fieldlink.assess.places import place_of
    from fieldlink.assess.readers.registry import reader_of

    begin = 1_767_225_600
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    for k in range(120):
        historian.put(SampleRecord("FC101", 1000 * (begin + k), k, 1.0 * k, 2.0 * k, None, None, 0))
    historian.stop()
    engine = sqlalchemy.create_engine(url.replace("postgresql:", "postgresql+psycopg:"))
    with engine.begin() as connection:
        for statement in (
            "CREATE SCHEMA plant",
            "CREATE TABLE plant.hist (ts timestamptz, name text, out numeric, value real)",
            "INSERT INTO plant.hist SELECT to_timestamp(1767225600 + k), 'FC101', k, 2 * k "
            "FROM generate_series(0, 119) AS k",
        ):
            connection.execute(sqlalchemy.text(statement))
    try:
        (tmp_path / "x.toml").write_text(
            f'[sql]\nurl = "{url}"\ntable = "plant.hist"\ntime = "ts"\nloop = "name"\n'
            'op = "out"\npv = "value"\n'
        )
        for place in (place_of(url), place_of(str(tmp_path / "x.toml"))):
            job = Job((place,), cut=Cut(since=begin + 60.0, every=3600.0))
            reader = reader_of(place.kind)
            (piece,) = reader.pieces(job, 0, "")
            assert isinstance(piece, Piece)
            assert "hunter2" not in piece.file
            ((loop, window),) = reader.windows(job, piece)
            assert (loop, window.time[0], window.period) == ("FC101", begin + 60.0, 1.0)
            assert window.op.tolist() == [1.0 * k for k in range(60, 120)]
            assert window.pv.tolist() == [2.0 * k for k in range(60, 120)]
    finally:
        with engine.begin() as connection:
            connection.execute(sqlalchemy.text("DROP SCHEMA plant CASCADE"))
        engine.dispose()


def test_the_pages_find_the_newest_rows_there_as_well(url: str) -> None:
    fill_windows(url)
    check_newest(url)


@pytest.mark.parametrize("check", [second_is_refused, sleeper_waits, killed_is_replaced])
def test_no_loop_has_two_writers(
    check: Callable[[str, Path], None], url: str, tmp_path: Path
) -> None:
    check(url, tmp_path)
