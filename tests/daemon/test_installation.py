"""One daemon a data directory; what it does is seen, and one thing asked, from outside."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from fieldlink.cli.app import app
from fieldlink.daemon import Daemon
from fieldlink.daemon.installation import (
    InUseError,
    is_in_use,
    only_daemon,
    writer_identity,
)
from fieldlink.daemon.loop import WritebackOffError
from fieldlink.registers import Fallback
from fieldlink.store import (
    EventRecord,
    Historian,
    StoreError,
    read_events,
    read_writebacks,
)
from tests.daemon.live import PATIENCE, POOL, STORE, plant_on, running, site_for, until

WRITEBACK = """
[loops.LOOP.writeback]
enabled = true
loop_id = 101
base = 100
min_windows = 1
min_interval = 0.0
max_age = 86400.0
"""


def command(*arguments: str) -> str:
    """Run a command in this process, while no daemon runs in it: their words would mix."""
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == 0, result.output + repr(result.exception)
    return result.stdout


async def begun(*arguments: str, stderr: int | None = None) -> asyncio.subprocess.Process:
    """Begin a command in a process of its own, whose stdout is read here."""
    return await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "fieldlink.cli", *arguments),
        stdout=asyncio.subprocess.PIPE,
        stderr=stderr,
    )


async def command_beside(*arguments: str) -> str:
    """Run a command as a user does beside the daemon: a process with an output of its own."""
    process = await begun(*arguments, stderr=asyncio.subprocess.PIPE)
    said, failed = await asyncio.wait_for(process.communicate(), PATIENCE)
    assert process.returncode == 0, failed.decode() or said.decode()
    return said.decode()


async def next_event(following: asyncio.subprocess.Process) -> str:
    assert following.stdout is not None
    line = await asyncio.wait_for(following.stdout.readline(), PATIENCE)
    return str(json.loads(line)["event"])


async def test_a_second_daemon_on_a_data_directory_is_refused(device: Any, tmp_path: Path) -> None:
    site = site_for(tmp_path, {"plc": device.port})
    async with plant_on(device), running(site) as daemon:
        await until(lambda: daemon.status().loops["PLC"].counts.read >= 5, "samples")
        with pytest.raises(InUseError, match="in use by process"):
            await Daemon(site, store=STORE, pool=POOL).run(duration=1.0)
        assert is_in_use(site.data_dir)
    assert not is_in_use(site.data_dir)
    events = read_events(site.historian_url)["kind"].tolist()
    assert events.count("daemon.start") == 1


async def test_a_second_daemon_on_a_historian_is_refused(device: Any, tmp_path: Path) -> None:
    site = site_for(tmp_path, {"plc": device.port})
    # Another data directory, and the address of the same historian.
    table = site.historian.model_copy(update={"url": site.historian_url})
    file = site.file.model_copy(update={"historian": table})
    other = replace(site, file=file).with_data_dir(tmp_path / "other")
    assert other.historian_url == site.historian_url
    async with plant_on(device), running(site) as daemon:
        await until(lambda: daemon.status().loops["PLC"].counts.read >= 5, "samples")
        with pytest.raises(StoreError, match="gets loop PLC from another daemon") as refused:
            await Daemon(other, store=STORE, pool=POOL).run(duration=1.0)
        assert f"data_dir {site.data_dir.absolute()}" in str(refused.value)
    events = read_events(site.historian_url)["kind"].tolist()
    assert events.count("daemon.start") == 1


def test_an_installation_keeps_its_identity(tmp_path: Path) -> None:
    identity = writer_identity(tmp_path)
    assert 1 <= identity <= 65535
    assert writer_identity(tmp_path) == identity


async def test_status_events_and_withdraw_of_a_running_daemon_and_without_one(
    device: Any, plc: Any, tmp_path: Path
) -> None:
    site = site_for(tmp_path, {"plc": device.port}, WRITEBACK, window=160, estimate_every=40.0)
    file = str(site.path)
    async with plant_on(device, plc):
        async with running(site) as daemon:

            def accepted_a_model(*, there: bool) -> bool:
                last = daemon.status().loops["PLC"].last_accepted
                block = None if last is None else last.block
                return block is not None and (block.model is not None) == there

            await until(lambda: accepted_a_model(there=True), "a valid block on record")
            following = await begun("events", file, "--follow", "--json")
            followed = [await next_event(following)]
            found = json.loads(await command_beside("status", file, "--json", "--must-run"))
            await command_beside("withdraw", file, "PLC", "--reason", "the valve is repaired")
            await until(lambda: plc.state.fallback is Fallback.WITHDRAWN, "the withdrawal")
            # the last attempt may be a later one already: estimates go on
            await until(lambda: accepted_a_model(there=False), "its acknowledgement")
            while followed[-1] != "writeback.withdrawal_asked":
                followed.append(await next_event(following))
        while followed[-1] != "daemon.stop":
            # The daemon is gone: the store tells.
            followed.append(await next_event(following))
        following.send_signal(signal.SIGINT)
        assert await asyncio.wait_for(following.wait(), PATIENCE) == 130
        assert found["daemon"]["alive"] is True
        (one,) = found["devices"]
        assert {"name", "state", "requests", "exceptions", "late", "missed", "reason"} <= set(one)
        (loop,) = found["loops"]
        assert (loop["name"], loop["device"], loop["verdict"]) == ("PLC", "plc", "stiction")
        assert loop["block"]["status"] == "valid"
        assert loop["block"]["acknowledged"] is True

        stored = json.loads(command("status", file, "--json"))
        assert stored["daemon"]["alive"] is False
        assert "None" not in command("status", file)
        with pytest.raises(AssertionError, match="no daemon runs for this site"):
            command("status", file, "--must-run")
        assert stored["loops"][0]["block"]["status"] == "withdrawn"
        assert stored["loops"][0]["read"] >= loop["read"]
        lines = [json.loads(line) for line in command("events", file, "--json").split("\n") if line]
        kinds = [line["event"] for line in lines]
        assert kinds == followed
        assert kinds[0] == "daemon.start"
        assert kinds[-1] == "daemon.stop"
        assert "writeback.withdrawal_asked" in kinds
        rows = read_writebacks(site.historian_url, "PLC")
        assert "the valve is repaired" in rows[rows["status"] == "withdrawn"]["reason"].iloc[-1]

        # Without a daemon the command writes the block itself, by the same rules.
        said = await command_beside("withdraw", file, "PLC", "--reason", "still repaired")
        assert "acknowledged by the PLC" in said


async def test_the_heartbeat_has_a_beat_of_its_own(device: Any, plc: Any, tmp_path: Path) -> None:
    site = site_for(tmp_path, {"plc": device.port}, WRITEBACK, period=20.0, estimate_every=2000.0)

    def count(address: int) -> int:
        return sum(a == address for _, a, _ in device.requests)

    async with plant_on(device, plc), running(site):
        await until(lambda: sum(a == 106 for _, a, _ in device.writes) >= 40, "heartbeats")
    # Two scans a period of 20 s, a heartbeat every two seconds or a little more.
    assert sum(a == 106 for _, a, _ in device.writes) > 1.5 * count(0)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")
def test_files_that_root_has_left_are_named_with_the_remedy() -> None:
    """A daemon that was run by hand with sudo, and then as the service's account."""
    account = 60_001
    url = "sqlite:///{}/history.sqlite"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        historian = Historian(url.format(folder))
        historian.start(EventRecord(0, "start", "daemon", ""))
        historian.stop()
        with only_daemon(folder):
            pass
        for file in folder.iterdir():
            file.chmod(0o600)
        os.chown(folder, account, -1)
        for left in ("daemon.lock", "writer-id", "history.sqlite"):
            said = rf"{left} belongs to root, .*: chown -R {account} {folder}$"
            os.seteuid(account)
            try:
                with pytest.raises(StoreError, match=said), only_daemon(folder):
                    Historian(url.format(folder)).start(EventRecord(0, "start", "daemon", ""))
            finally:
                os.seteuid(0)
            os.chown(folder / left, account, -1)


def test_a_withdrawal_that_may_not_be_written_makes_no_store(tmp_path: Path) -> None:
    """As root beside a service it would be root's, and the daemon could not begin with it."""
    (tmp_path / "map.csv").write_text("tag,address,type\nOP,0,float32\nPV,2,float32\n")
    site = tmp_path / "site.toml"
    site.write_text(
        '[site]\nname = "off"\n[devices.plc]\nlink = "modbus-tcp"\nhost = "127.0.0.1"\n'
        'port = 1\nregister_map = "map.csv"\n[loops.FC1]\ndevice = "plc"\nop = "OP"\n'
        'pv = "PV"\nperiod = 1.0\n'
    )
    result = CliRunner().invoke(app, ["withdraw", str(site), "FC1", "--reason", "test"])
    assert isinstance(result.exception, WritebackOffError)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.csv", "site.toml"]
