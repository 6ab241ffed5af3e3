"""``fieldlink check``, ``schema``, ``plant`` and ``run``."""

from __future__ import annotations

import json
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from fieldlink.cli.run import TRY_AGAIN
from fieldlink.daemon import only_daemon
from fieldlink.store import read_events
from tests.cli.conftest import SCRIPT, Run
from tests.daemon.live import unrehearsed_pools

SITES = Path(__file__).resolve().parents[2] / "site_configs"


@pytest.fixture
def demo_site(tmp_path: Path) -> Path:
    for name in ("demo.toml", "demo.csv"):
        shutil.copy(SITES / name, tmp_path)
    return tmp_path / "demo.toml"


@pytest.mark.parametrize("name", sorted(path.name for path in SITES.glob("*.toml")))
def test_shipped_sites_pass_the_check(fieldlink: Run, name: str) -> None:
    result = fieldlink("check", SITES / name)
    assert result.returncode == 0, result.stderr
    assert "\nok " in result.stdout


def test_check_prints_the_read_plan(fieldlink: Run, demo_site: Path) -> None:
    result = fieldlink("check", demo_site)
    assert "FC3 holding 0-7: FC101.OP, FC101.PV, FC101.SP, FC101.MODE, FC101.SCAN" in result.stdout
    assert "OP and PV come from one request" in result.stdout


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ('op = "FC101.OP"', 'op = "FC101.XX"', ("loops.FC101.op", "FC101.XX")),
        ("window = 800", "windou = 800", ("loops.FC101.windou",)),
        ("window = 800", 'window = "many"', ("loops.FC101.window", "many")),
        ("base = 100", "base = 2", ("FC101",)),
    ],
)
def test_check_names_key_and_value(
    fieldlink: Run, demo_site: Path, before: str, after: str, said: tuple[str, ...]
) -> None:
    text = demo_site.read_text()
    assert before in text
    demo_site.write_text(text.replace(before, after))
    result = fieldlink("check", demo_site)
    assert result.returncode == 2
    assert "Traceback" not in result.stderr
    for part in ("demo.toml", *said):
        assert part in result.stderr


def test_schema_is_a_json_schema(fieldlink: Run) -> None:
    result = fieldlink("schema")
    schema = json.loads(result.stdout)
    Draft202012Validator.check_schema(schema)
    assert {"site", "devices", "loops"} <= set(schema["properties"])


def test_plant_refuses_a_port_in_use(fieldlink: Run, demo_site: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        result = fieldlink("plant", demo_site, "--port", str(port))
    assert result.returncode == 2
    assert f"127.0.0.1:{port}" in result.stderr
    assert "Traceback" not in result.stderr


def test_run_refuses_a_data_directory_that_is_a_file(fieldlink: Run, demo_site: Path) -> None:
    (demo_site.parent / "data").write_text("in the way")
    result = fieldlink("run", demo_site, "--duration", "5")
    assert result.returncode == TRY_AGAIN
    assert "data" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    ("table", "package", "extra"),
    [
        ('[mqtt]\nhost = "127.0.0.1"\n', "paho", "mqtt"),
        (
            '[notify]\npage = "http://127.0.0.1/"\nweb_hook = { url = "http://127.0.0.1/" }\n',
            "httpx",
            "notify",
        ),
        ("[opcua_server]\nport = 4855\n", "asyncua", "opcua"),
    ],
)
def test_a_package_that_is_missing_ends_the_service_for_good(
    fieldlink: Run,
    demo_site: Path,
    monkeypatch: pytest.MonkeyPatch,
    table: str,
    package: str,
    extra: str,
) -> None:
    demo_site.write_text(f"{demo_site.read_text()}\n{table}")
    monkeypatch.setitem(sys.modules, package, None)
    assert f"needs {package}, which is not installed here" in fieldlink("check", demo_site).stdout
    result = fieldlink("run", demo_site, "--duration", "5")
    assert f"needs {package}; pip install 'fieldlink[{extra}]'" in result.stderr
    assert result.returncode == 2


@pytest.mark.parametrize("data_dir", ["/proc/nowhere/data", "a-file"])
def test_check_tells_that_run_could_not_write(
    fieldlink: Run, demo_site: Path, data_dir: str
) -> None:
    (demo_site.parent / "a-file").write_text("")
    text = demo_site.read_text().replace('data_dir = "data"', f'data_dir = "{data_dir}"')
    demo_site.write_text(text)
    result = fieldlink("check", demo_site)
    assert result.returncode == 0
    assert "cannot be written" in result.stdout
    assert "run would not start" in result.stdout


def test_a_lockstep_run_says_what_it_found(fieldlink: Run, tmp_path: Path) -> None:
    folder = tmp_path / "sites"
    shutil.copytree(SITES, folder, ignore=shutil.ignore_patterns("data*"))
    # The first window is full after 800 s; that every run is the same, tests/daemon/test_lockstep.
    result = fieldlink("run", folder / "lockstep.toml", "--duration", "850")
    assert result.returncode == 0, result.stderr
    assert "stiction" in result.stdout


@pytest.mark.parametrize("beside_a_plc", [False, True])
def test_run_polls_an_opcua_server_by_the_clock(
    fieldlink: Run, tmp_path: Path, beside_a_plc: bool
) -> None:
    links = {"server": "opcua"} | ({"plc": "modbus-tcp"} if beside_a_plc else {})
    site = ['[site]\nname = "works"\n[web]\nenabled = false\n']
    for name, link in links.items():
        rows = ("i=1", "i=2") if link == "opcua" else ("0,float32", "2,float32")
        head = "node" if link == "opcua" else "address,type"
        map_file = tmp_path / f"{name}.csv"
        map_file.write_text(f"tag,{head}\nOP,{rows[0]}\nPV,{rows[1]}\n")
        # Nothing listens there: what counts is that it is asked, by the clock.
        site.append(
            f'[devices.{name}]\nlink = "{link}"\nhost = "127.0.0.1"\nport = 1\n'
            f'register_map = "{map_file.name}"\n[loops.{name}]\ndevice = "{name}"\n'
            'op = "OP"\npv = "PV"\nperiod = 0.1\n'
        )
    file = tmp_path / "site.toml"
    file.write_text("".join(site))
    with unrehearsed_pools():  # no window is judged
        result = fieldlink("run", file, "--duration", "1")
    assert result.returncode == 0, result.stderr
    for name in links:
        assert f"event=device.demoted source={name}" in result.stderr


def test_a_second_daemon_is_refused_before_it_says_anything_else(
    fieldlink: Run, demo_site: Path
) -> None:
    # Its web port would be the first one's, too.
    with only_daemon(demo_site.parent / "data"):
        result = fieldlink("run", demo_site)
    assert result.returncode == TRY_AGAIN
    (line,) = result.stderr.splitlines()
    assert "in use by process" in line


def test_sigterm_loses_nothing(demo_site: Path) -> None:
    text = demo_site.read_text()
    plant = _start("plant", demo_site, "--port", "0")
    daemon = None
    try:
        assert plant.stdout is not None
        assert plant.stderr is not None
        assert plant.stderr.readline().startswith("starting the plants")
        served = plant.stdout.readline()
        port = served.split("127.0.0.1:")[1].split()[0]
        demo_site.write_text(text.replace("port = 5020", f"port = {port}"))
        daemon = _start("run", demo_site)
        database = demo_site.parent / "data" / "history.sqlite"
        _wait_for_rows(database, 20)
        daemon.send_signal(signal.SIGTERM)
        said, complaints = daemon.communicate(timeout=300)
        assert daemon.returncode == 0, complaints
    finally:
        for process in (daemon, plant):
            if process is not None and process.poll() is None:
                process.send_signal(signal.SIGTERM)
                process.communicate(timeout=300)
    read = int(said.split("loop FC101: ")[1].split(" samples read")[0])
    with sqlite3.connect(database) as connection:
        (stored,) = connection.execute("select count(*) from samples").fetchone()
    connection.close()
    assert stored == read >= 20
    assert "lost 0" in said
    assert "event=daemon.stop" in complaints
    assert "Traceback" not in complaints
    assert read_events(f"sqlite:///{database}")["kind"].tolist()[-1] == "daemon.stop"


def _start(*arguments: str | Path) -> subprocess.Popen[str]:
    command = [str(SCRIPT), *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def _wait_for_rows(database: Path, rows: int) -> None:
    import time

    for _ in range(600):
        if database.exists():
            connection = sqlite3.connect(database)
            try:
                (count,) = connection.execute("select count(*) from samples").fetchone()
            except sqlite3.OperationalError:
                count = 0
            finally:
                connection.close()
            if count >= rows:
                return
        time.sleep(0.1)
    raise AssertionError(f"{database} did not get {rows} samples in a minute")
