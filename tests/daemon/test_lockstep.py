"""The lockstep run: the same parts without a clock, and the same result every time."""

from __future__ import annotations

import asyncio
from pathlib import Path

import numpy as np
import pytest

from fieldlink.daemon import Daemon, LockstepRun, PoolSettings
from fieldlink.daemon.estimation.estimating import EstimateOutcome
from fieldlink.errors import FieldlinkError
from fieldlink.registers import decode_block
from fieldlink.site import Site, load_site
from fieldlink.store import (
    EstimateRecord,
    Record,
    SampleRecord,
    WritebackRecord,
    read_events,
    read_samples,
)
from loop_model import ProcessModel, ValveModel

SITE = """
[site]
name = "archive"

[devices.archive]
link = "recording"

[loops.FC101]
device = "archive"
op = "FC101.OP"
pv = "FC101.PV"
period = 2.0
window = 200
estimate_every = 200.0
[loops.FC101.plant]
recording = "rows.csv"
"""


@pytest.fixture
def site(tmp_path: Path) -> Site:
    rng = np.random.default_rng(5)
    op = 50.0 + 6.0 * np.abs((np.arange(500.0) / 40.0) % 2.0 - 1.0)
    stem = ValveModel(stick_band=4.0, slip_jump=1.0).simulate(op, 50.0)
    process = ProcessModel(a=(-0.7,), b=(0.3,), dead_time=1, offset=0.0, period=2.0)
    pv = process.simulate(stem) + 0.02 * rng.standard_normal(op.size)
    rows = "\n".join(f"{a:.6f},{b:.6f}" for a, b in zip(op, pv, strict=True))
    (tmp_path / "rows.csv").write_text(f"op,pv\n{rows}\n")
    (tmp_path / "site.toml").write_text(SITE)
    return load_site(tmp_path / "site.toml")


async def test_a_recording_is_judged_window_by_window_until_it_ends(site: Site) -> None:
    records: list[Record] = []
    status = await LockstepRun(site, on_record=records.append).run(1e9)
    assert status.loops["FC101"].counts.read == 500
    assert status.loops["FC101"].counts.missed == 0
    estimates = [record for record in records if isinstance(record, EstimateRecord)]
    assert [(e.first_slot, e.last_slot) for e in estimates] == [
        (0, 199),
        (100, 299),
        (200, 399),
        (300, 499),
    ]
    assert {e.verdict for e in estimates} == {"stiction"}
    assert [e.window_end_ms for e in estimates] == [398_000, 598_000, 798_000, 998_000]
    last = status.loops["FC101"].last_estimate
    assert last is not None
    assert last.outcome is EstimateOutcome.ESTIMATED


async def test_two_runs_are_the_same(site: Site) -> None:
    runs: list[list[object]] = []
    for _ in range(2):
        records: list[Record] = []
        await LockstepRun(site, on_record=records.append).run(900.0)
        runs.append(
            [
                (record.verdict, record.stick_band, record.slip_jump, record.score)
                if isinstance(record, EstimateRecord)
                else record
                for record in records
            ]
        )
    assert runs[0] == runs[1]


async def test_the_duration_is_plant_time(site: Site) -> None:
    records: list[Record] = []
    seen: list[float] = []
    await LockstepRun(site, on_record=records.append, start_utc=1000.0).run(10.0, seen.append)
    assert seen == [0.0, 2.0, 4.0, 6.0, 8.0]
    samples = [record for record in records if isinstance(record, SampleRecord)]
    assert [sample.utc_ms for sample in samples] == [1_000_000 + 2000 * k for k in range(5)]


async def test_a_run_ends_early_when_asked(site: Site) -> None:
    stop = asyncio.Event()

    def look(now: float) -> None:
        if now >= 20.0:
            stop.set()

    status = await LockstepRun(site).run(1e9, look, stop)
    assert status.loops["FC101"].counts.read == 11


async def test_the_historian_keeps_a_lockstep_run_too(site: Site) -> None:
    await LockstepRun(site, store=True).run(100.0)
    assert len(read_samples(site.historian_url, "FC101")) == 50
    assert read_events(site.historian_url)["kind"].tolist()[0] == "lockstep.start"


async def test_a_real_device_cannot_run_in_lockstep(tmp_path: Path) -> None:
    (tmp_path / "map.csv").write_text(
        "tag,table,address,type\nFC101.OP,holding,0,int16\nFC101.PV,holding,1,int16\n"
    )
    loop = SITE.split("[loops.FC101.plant]")[0]
    real = loop.replace('"recording"', '"modbus-tcp"\nhost = "127.0.0.1"\nregister_map = "map.csv"')
    (tmp_path / "real.toml").write_text(real)
    with pytest.raises(FieldlinkError, match="cannot run in lockstep"):
        await LockstepRun(load_site(tmp_path / "real.toml")).run(10.0)


ROOT = Path(__file__).resolve().parents[2]


RUN = 850
"""Plant seconds: the first window of the demo is full after 800, and its block goes out at once."""


@pytest.mark.slow
async def test_a_simulated_plc_gets_its_block_the_same_way_every_time() -> None:
    # Importing the simulated PLC makes link = "fmu" known.
    from fieldlink.lab.plc import LockstepLink

    site = load_site(ROOT / "site_configs" / "demo.toml").with_device("plc", link="fmu")
    runs = []
    for _ in range(2):
        records: list[Record] = []
        run = LockstepRun(site, on_record=records.append)
        status = await run.run(RUN)
        assert isinstance(run.link("plc"), LockstepLink)
        accepted = status.loops["FC101"].last_accepted
        assert accepted is not None
        assert accepted.words is not None
        block = decode_block(accepted.words)
        assert block.seq == sum(
            isinstance(r, WritebackRecord) and r.outcome == "accepted" for r in records
        )
        samples = [record for record in records if isinstance(record, SampleRecord)]
        assert len(samples) == RUN
        runs.append((samples, block))
    assert runs[0] == runs[1]


async def test_a_live_daemon_plays_a_recording_a_row_a_period(site: Site) -> None:
    live = site.with_device("archive", speed=100.0)
    status = await Daemon(live, pool=PoolSettings(workers=1)).run(duration=0.5)
    counts = status.loops["FC101"].counts
    assert counts.read == status.devices["archive"].polls
    assert counts.duplicates == 0
