"""A daemon that is stopped while its first worker still imports the estimator ends at once."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.seeds import in_suite

ROOT = Path(__file__).parents[2]

SLOW_SERVER = """
import pathlib, sys, time

class Slow:
    def find_spec(self, name, *_):
        if name == "estimator":
            pathlib.Path(__file__).with_name("importing").touch()
            time.sleep(300)

if any("forkserver" in word for word in sys.orig_argv):
    sys.meta_path.insert(0, Slow())
"""
"""What a slow machine's disk does to the fork server, for longer than the test waits."""

SITE = """
[site]
name = "early"
[web]
enabled = false
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
port = 1
register_map = "map.csv"
[loops.FC101]
device = "plc"
op = "OP"
pv = "PV"
period = 1.0
"""


@pytest.mark.parametrize("name", in_suite(1, ["SIGTERM", "SIGINT"]))
def test_a_daemon_does_not_wait_for_the_first_import(name: str, tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(SLOW_SERVER)
    (tmp_path / "site.toml").write_text(SITE)
    (tmp_path / "map.csv").write_text(
        "tag,table,address,type\nOP,holding,0,float32\nPV,holding,2,float32\n"
    )
    daemon = subprocess.Popen(
        [sys.executable, "-m", "fieldlink.cli", "run", str(tmp_path / "site.toml")],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        until = time.monotonic() + 120.0
        while not (tmp_path / "importing").exists():
            assert time.monotonic() < until, "the fork server was never started"
            time.sleep(0.05)
        if name == "SIGINT":  # from a terminal it reaches every process of the group
            os.killpg(daemon.pid, signal.SIGINT)
        else:
            daemon.terminate()
        _, complaints = daemon.communicate(timeout=60.0)
    finally:
        if daemon.poll() is None:
            os.killpg(daemon.pid, signal.SIGKILL)
            daemon.communicate()
    assert daemon.returncode == 0, complaints
    assert "stopped as asked" in complaints
    assert "warm_up_failed" not in complaints
    assert "Traceback" not in complaints
