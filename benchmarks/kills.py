"""The daemon is killed again and again: nothing that was stored is lost, no block is ever half new.

    python -m benchmarks.kills --runs 50
    python -m benchmarks.kills --runs 50 --slice 10 --so-far FILE      # five times: 50 in slices

Every run starts ``fieldlink run`` on the same store and the same PLC and ends it with SIGKILL: at a
random moment, or in the middle of handing over a block (after the bank, after the commit). Before
the kill the store is read as any other program may read it; what was there has to be there after.
At the end the daemon runs once more and is stopped in order: then every block that the PLC took has
to be on record, from its begin to the PLC's acknowledgement.

In slices, each has a PLC and a store of its own, and is ended in order like a whole run; their
figures are added up in FILE.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import random
import sqlite3
import sys
import tempfile
from collections import defaultdict
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.kill_plc import CYCLE, LOOP_ID, WatchedPlc
from benchmarks.report import heading, keep, machine, table

__all__ = ["Tally", "main", "run_kills"]

SITE = """[site]
name = "kills"
[web]
enabled = false
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
port = {port}
register_map = "map.csv"
speed = {speed}
[loops.FC101]
device = "plc"
op = "OP"
pv = "PV"
scan = "SCAN"
period = 1.0
window = 160
estimate_every = 10.0
[loops.FC101.writeback]
enabled = true
loop_id = {loop_id}
base = 100
min_windows = 1
min_interval = 0.0
deadband = 0.0
valid_for = 40
max_age = 86400.0
"""
"""A finding may wait: a hundred plant seconds go by while a busy machine judges a window."""
MAP = "tag,table,address,type\nOP,holding,0,float32\nPV,holding,2,float32\nSCAN,holding,4,uint16\n"
TABLES = ("samples", "estimates", "writebacks", "events")
FC16, FC6 = 16, 6
PATIENCE = 60.0
LONGEST = 6.0
"""Seconds after the first new sample within which a random kill comes."""

Rows = dict[str, list[tuple[Any, ...]]]


@dataclass
class Tally:
    """What happened in all runs.

    Attributes:
        runs: kills.
        slices: PLCs with a store that they were made on.
        at_random, after_bank, after_commit: when they came.
        no_moment: kills after a minute in which the moment waited for did not come.
        rows: rows that were in the store before the kills; lost: those that were not after.
        damaged: times the store did not pass its integrity check.
        accepted: blocks that the PLC took over.
        unrecorded: of these, blocks without the row that is stored before they are written.
        incomplete: of these, blocks without the rows that say they were committed and accepted.
        interrupted: blocks that were begun and never committed, and are recorded so.
        faults: what the PLC saw and must never be.
    """

    runs: int = 0
    slices: int = 0
    at_random: int = 0
    after_bank: int = 0
    after_commit: int = 0
    no_moment: int = 0
    rows: int = 0
    lost: int = 0
    damaged: int = 0
    accepted: int = 0
    unrecorded: int = 0
    incomplete: int = 0
    interrupted: int = 0
    faults: list[str] = field(default_factory=list)


async def run_kills(runs: int, seed: int, folder: Path, tally: Tally | None = None) -> Tally:
    """Kill the daemon ``runs`` times and add what happened to ``tally``, or to a new one.

    When a kill comes hangs on the seed and its number among all kills.
    """
    tally = tally or Tally()
    plc = WatchedPlc()
    await plc.start()
    text = SITE.format(port=plc.port, speed=1.0 / CYCLE, loop_id=LOOP_ID)
    (folder / "site.toml").write_text(text)
    (folder / "map.csv").write_text(MAP)
    store = folder / "data" / "history.sqlite"
    try:
        for _ in range(runs):
            chance = random.Random(f"{seed} {tally.runs}")
            before = await _live_and_die(plc, store, folder, chance, tally)
            after = _rows(store, tally)
            tally.runs += 1
            for name in TABLES:
                there = set(after[name])
                tally.rows += len(before[name])
                tally.lost += sum(row not in there for row in before[name])
        await _finish_in_order(plc, store, folder, tally)
    finally:
        await plc.stop()
    by_outcome = _blocks(store, tally)
    taken = set(plc.accepted)
    tally.slices += 1
    tally.accepted += len(plc.accepted)
    tally.unrecorded += len(taken - by_outcome["begun"])
    tally.incomplete += len(taken - (by_outcome["committed"] & by_outcome["accepted"]))
    tally.interrupted += len(by_outcome["interrupted"])
    tally.faults += plc.faults
    return tally


async def _finish_in_order(plc: WatchedPlc, store: Path, folder: Path, tally: Tally) -> None:
    """Run the daemon until the last block is on record, and stop it as a service is stopped."""
    process = await _start(folder)
    try:
        async with asyncio.timeout(PATIENCE):
            while True:
                recorded = _blocks(store, tally)["accepted"]
                last = plc.accepted[-1:]
                if set(last) <= recorded and _count(store) > 0:
                    break
                await asyncio.sleep(0.1)
        process.terminate()
        await asyncio.wait_for(process.wait(), PATIENCE)
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()


async def _start(folder: Path) -> asyncio.subprocess.Process:
    command = [sys.executable, "-m", "fieldlink.cli", "run", str(folder / "site.toml")]
    with (folder / "daemon.log").open("ab") as log:
        return await asyncio.create_subprocess_exec(*command, stdout=log, stderr=log)


async def _live_and_die(
    plc: WatchedPlc, store: Path, folder: Path, chance: random.Random, tally: Tally
) -> Rows:
    """Run the daemon until its end; return what was in the store just before."""
    process = await _start(folder)
    moment = asyncio.Event()
    wanted = chance.choice([None, FC16, FC6])

    def on_write(function: int) -> None:
        # Heartbeats are written with FC6 as well: the commit is the FC6 after a bank.
        nonlocal bank_written
        commit = function == FC6 and bank_written
        bank_written = function == FC16
        if (wanted == FC16 and function == FC16) or (wanted == FC6 and commit):
            plc.on_write = None
            process.kill()
            moment.set()

    bank_written = False
    before: Rows = {name: [] for name in TABLES}
    try:
        async with asyncio.timeout(PATIENCE):
            known = _count(store)
            while _count(store) < known + 20:
                if process.returncode is not None:
                    raise RuntimeError((folder / "daemon.log").read_text()[-2000:])
                await asyncio.sleep(0.05)
            if wanted is None:
                await asyncio.sleep(chance.uniform(0.0, LONGEST))
                before = _rows(store, tally)
                process.kill()
            else:
                plc.on_write = on_write
                before = _rows(store, tally)
                while not moment.is_set():
                    before = _rows(store, tally)
                    await asyncio.sleep(0.1)
        tally.at_random += wanted is None
        tally.after_bank += wanted == FC16
        tally.after_commit += wanted == FC6
    except TimeoutError:
        tally.no_moment += 1
    finally:
        plc.on_write = None
        if process.returncode is None:
            process.kill()
        await process.wait()
    return before


def _count(store: Path) -> int:
    if not store.exists():
        return 0
    try:
        with closing(sqlite3.connect(f"{store.absolute().as_uri()}?mode=ro", uri=True)) as db:
            return int(db.execute("SELECT count(*) FROM samples").fetchone()[0])
    except sqlite3.OperationalError:
        # The daemon has made the file and not yet the table.
        return 0


def _rows(store: Path, tally: Tally) -> Rows:
    """Everything in the store, as another program reads it."""
    with closing(sqlite3.connect(store, timeout=10.0)) as db:
        if db.execute("PRAGMA quick_check").fetchone() != ("ok",):
            tally.damaged += 1
        return {name: db.execute(f"SELECT * FROM {name}").fetchall() for name in TABLES}


def _blocks(store: Path, tally: Tally) -> dict[str, set[int]]:
    """The sequence numbers in the store by the outcome of their rows."""
    found: dict[str, set[int]] = defaultdict(set)
    for row in _rows(store, tally)["writebacks"]:
        if row[5] is not None:
            found[row[3]].add(row[5])
    return found


def main() -> None:
    """Run, print, keep."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--slice", type=int, default=None, help="kills in this run; all by default")
    parser.add_argument("--so-far", type=Path, default=None, help="FILE with the slices before")
    parser.add_argument("--out", type=Path, default=None, help="folder for Markdown and JSON")
    options = parser.parse_args()
    so_far: Path | None = options.so_far
    tally = Tally()
    if so_far is not None and so_far.exists():
        tally = Tally(**json.loads(so_far.read_text()))
    runs = min(options.runs - tally.runs, options.slice or options.runs)
    if runs > 0:
        with tempfile.TemporaryDirectory() as folder:
            asyncio.run(run_kills(runs, options.seed, Path(folder), tally))
        if so_far is not None:
            so_far.write_text(json.dumps(asdict(tally)) + "\n")
    figures = {key: value for key, value in vars(tally).items() if key != "faults"}
    figures |= {"faults_in_the_plc": len(tally.faults)}
    text = table(
        ("what", "number"), [(key.replace("_", " "), value) for key, value in figures.items()]
    )
    print(text)
    for fault in tally.faults[:10]:
        print(fault)
    page = heading("kills", __doc__, None) + "\n\n" + text
    keep(options.out, "kills", page, figures | {"machine": machine()})
    if tally.lost or tally.damaged or tally.faults or tally.unrecorded or tally.incomplete:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
