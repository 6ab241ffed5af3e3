"""A site of recorded loops, run by the daemon in virtual time: its store has findings."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pytest

from fieldlink.daemon import DaemonStatus, LockstepRun
from fieldlink.site import Site, load_site
from tests.closed_loop import Loop, run

SAMPLES = 860
BEGIN = 1_795_262_400.0

HEAD = """[site]
name = "mill"
[devices.archive]
link = "recording"
[findings]
every = 410.0
"""
LOOP = """[loops.{name}]
device = "archive"
op = "{name}.OP"
pv = "{name}.PV"
sp = "{name}.SP"
period = 1.0
window = 400
estimate_every = 1e6
[loops.{name}.plant]
recording = "{name}.csv"
"""


@dataclass(frozen=True)
class RecordedSite:
    """The site and the status at the end of its run."""

    site: Site
    status: DaemonStatus


def write_site(folder: Path, loops: dict[str, Loop]) -> Site:
    parts = [HEAD]
    for name, loop in loops.items():
        frame = pd.DataFrame({"op": loop.op, "pv": loop.pv, "sp": loop.sp})
        frame.to_csv(folder / f"{name}.csv", index=False)
        parts.append(LOOP.format(name=name))
    (folder / "site.toml").write_text("".join(parts))
    return load_site(folder / "site.toml")


@pytest.fixture(scope="session")
def mill(tmp_path_factory: pytest.TempPathFactory) -> RecordedSite:
    """A sticky valve FC101, TC2 that swings with it, and PC3 that is quiet."""
    fast = {"lag": 4.0, "dead": 1, "integral_time": 5.0, "n": SAMPLES}
    source = run(band=6.0, jump=4.0, seed=1, **fast)  # type: ignore[arg-type]
    push = 1.5 * (source.op - source.op.mean())
    loops = {
        "FC101": source,
        "TC2": run(load=push, seed=11, **fast),  # type: ignore[arg-type]
        "PC3": run(seed=21, **fast),  # type: ignore[arg-type]
    }
    site = write_site(tmp_path_factory.mktemp("mill"), loops)
    status = asyncio.run(LockstepRun(site, store=True, start_utc=BEGIN).run(1e9))
    return RecordedSite(site, status)
