"""One line an event, whatever is in it, and no secret."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from fieldlink.daemon.reporting.logs import hide_secrets
from tests.cli.typed import run_typed

PROGRAM = textwrap.dedent(
    r"""
    import logging
    import structlog
    from fieldlink.daemon import configure_logging
    configure_logging()
    log = structlog.get_logger()
    log.info("a", message="two\nlines\r\nand a \x1b[31mcolour", url="postgresql://u:hunter2@db/x")
    log.warning("b", error="Authorization: Bearer 0123456789abcdef0123")
    log.error("c", error="token=0123456789abcdef0123; password: hunter2hunter2")
    logging.getLogger("any").warning("cannot reach %s", "amqp://me:hunter2@broker/")
    """
)


def test_lines_and_secrets() -> None:
    result = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True
    )
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == 4
    assert [part for line in lines for part in line.split() if part.startswith("event=")][:3] == [
        "event=a",
        "event=b",
        "event=c",
    ]
    assert "two lines and a" in lines[0]
    for secret in ("hunter2", "0123456789abcdef", "\x1b"):
        assert secret not in result.stderr


FULL = textwrap.dedent(
    r"""
    import os
    import structlog
    from fieldlink.daemon import configure_logging
    configure_logging()
    log = structlog.get_logger()
    kept = os.dup(2)
    full = os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, 2)
    for n in range(500):
        log.info("lost", n=n, filling="x" * 100)
    os.dup2(kept, 2)
    log.info("room_again")
    print("went on")
    """
)


def test_a_log_on_a_full_disk_ends_nothing_and_says_what_is_missing() -> None:
    result = subprocess.run([sys.executable, "-c", FULL], capture_output=True, text=True)
    assert (result.returncode, result.stdout) == (0, "went on\n")
    lines = result.stderr.splitlines()
    (told,) = [line for line in lines if "event=log.lost" in line]
    missing = int(told.split("lines=")[1].split()[0])
    assert 490 <= missing <= 500
    assert 'error="No space left on device"' in told
    assert "event=room_again" in lines[-1]


@pytest.mark.parametrize(
    "text",
    [
        "password: hunter2hunter2",
        "Password = hunter2hunter2",
        "db_password=hunter2hunter2",
        "operator-token: hunter2hunter2",
        "{'token': 'hunter2hunter2'}",
        "http://host/page?token=hunter2hunter2",
        "/api/page?access_token=hunter2hunter2&since=0",
        "/data/operator-token: token=hunter2hunter2",
        "Authorization: Bearer hunter2hunter2",
    ],
)
def test_secrets_are_hidden(text: str) -> None:
    assert "hunter2" not in hide_secrets(text)


@pytest.mark.parametrize(
    "text",
    [
        "the token cannot be kept in /data/operator-token: Read-only file system; make it writable",
        "/etc/fieldlink/mqtt.password: Permission denied",
    ],
)
def test_what_happened_to_a_file_of_secrets_is_said(text: str) -> None:
    assert hide_secrets(text) == text


def test_the_password_of_the_store_is_never_said(tmp_path: Path) -> None:
    (tmp_path / "map.csv").write_text(
        "tag,table,address,type\nOP,holding,0,float32\nPV,holding,2,float32\n"
    )
    (tmp_path / "site.toml").write_text(
        textwrap.dedent(
            """
            [site]
            name = "secret"
            [historian]
            url = "postgresql://keeper:hunter2hunter2@127.0.0.1:9/history"
            [web]
            enabled = false
            [devices.plc]
            link = "modbus-tcp"
            host = "127.0.0.1"
            port = 9
            register_map = "map.csv"
            [loops.FC101]
            device = "plc"
            op = "OP"
            pv = "PV"
            period = 1.0
            """
        )
    )
    file = str(tmp_path / "site.toml")
    ran = subprocess.run(
        [sys.executable, "-m", "fieldlink.cli", "run", file, "--duration", "1"],
        capture_output=True,
        text=True,
        check=False,
    )
    checked = run_typed(tmp_path, "check", file)
    for result in (ran, checked):
        assert "keeper" in result.stdout + result.stderr
        assert "hunter2" not in result.stdout + result.stderr
    assert checked.returncode == 0
