"""The live daemon over real sockets: devices that come and go, a store that fills, a clean end."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from fieldlink.daemon import Daemon, WritebackOutcome
from fieldlink.daemon.reporting.status_documents import live_status
from fieldlink.daemon.sampling.silence import SilenceWatch
from fieldlink.links import LinkState
from fieldlink.registers import decode_block
from fieldlink.site import load_site
from fieldlink.store import (
    StoreError,
    read_estimates,
    read_events,
    read_samples,
    read_writebacks,
)
from tests.daemon.live import POOL, STORE, Plant, plant_on, running, site_for, until

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
async def test_samples_estimates_and_their_ends_are_stored(device: Any, tmp_path: Path) -> None:
    site = site_for(tmp_path, {"plc": device.port}, window=160, estimate_every=40.0)
    async with plant_on(device), running(site) as daemon:

        def last() -> Any:
            return daemon.status().loops["PLC"].last_estimate

        # A window in which a busy machine left too many gaps has no verdict.
        await until(lambda: last() and last().record(0.0).verdict == "stiction", "a verdict")
        sticky = last()
        await until(lambda: daemon.status().loops["PLC"].estimates >= 2, "two estimates")
    status = daemon.status()
    counts = status.loops["PLC"].counts
    assert counts.expected == counts.read + counts.missed + counts.bad
    samples = read_samples(site.historian_url, "PLC")
    assert len(samples) == counts.read + counts.bad
    assert samples["slot"].is_monotonic_increasing
    estimates = read_estimates(site.historian_url)
    found = estimates[estimates["last_slot"] == sticky.record(0.0).last_slot].iloc[0]
    assert found["stick_band"] == sticky.findings.stick_band.value
    assert found["document"] == sticky.findings.document
    assert (estimates["last_slot"] - estimates["first_slot"] == 159).all()
    events = read_events(site.historian_url)["kind"].tolist()
    assert events[0] == "daemon.start"
    assert events[-1] == "daemon.stop"
    assert status.store.dropped == 0
    assert status.store.waiting == 0


async def test_polling_by_the_counter_takes_every_cycle_once(device: Any, tmp_path: Path) -> None:
    site = site_for(tmp_path, {"plc": device.port})
    async with plant_on(device) as plant, running(site) as daemon:
        await until(lambda: daemon.status().loops["PLC"].counts.read >= 100, "100 samples")
        assert daemon.status().loops["PLC"].counts.read <= plant.cycle
    samples = read_samples(site.historian_url)
    assert samples["slot"].is_unique
    op = [50.0 + 6.0 * abs((k / 40.0) % 2.0 - 1.0) for k in range(10_000)]
    # The plant counts after each cycle: what it shows beside count n is cycle n - 1.
    expected = [op[slot - 1] for slot in samples["slot"]]
    assert samples["op"].to_numpy() == pytest.approx(expected, abs=1e-4)


async def test_a_device_absent_at_the_start_and_lost_later_comes_back(
    new_device: Callable[..., Any], tmp_path: Path
) -> None:
    device = new_device()
    await device.start()
    await device.stop()
    site = site_for(tmp_path, {"plc": device.port})

    def state() -> LinkState:
        return daemon.status().devices["plc"].state

    async with plant_on(device), running(site) as daemon:
        await until(lambda: state() is LinkState.DEMOTED, "demoted while absent")
        await device.start()
        await until(lambda: daemon.status().loops["PLC"].counts.read >= 5, "samples")
        await device.stop()
        await until(lambda: state() is LinkState.DEMOTED, "demoted while away")
        before = daemon.status().loops["PLC"].counts.read
        await device.start()
        await until(lambda: daemon.status().loops["PLC"].counts.read >= before + 5, "samples again")
        assert daemon.status().loops["PLC"].counts.missed > 0
    kinds = [k for k in read_events(site.historian_url)["kind"] if k.startswith("device.")]
    assert kinds == ["device.demoted", "device.good", "device.demoted", "device.good"]


async def test_a_silent_device_does_not_slow_another(
    new_device: Callable[..., Any], tmp_path: Path
) -> None:
    good, silent = new_device(), new_device(mute=True)
    await good.start()
    await silent.start()
    site = site_for(tmp_path, {"good": good.port, "silent": silent.port}, timeout=0.15)
    async with plant_on(good), running(site) as daemon:
        await until(lambda: daemon.status().loops["GOOD"].counts.read >= 150, "150 samples")
        status = daemon.status()
    assert status.loops["SILENT"].counts.read == 0
    assert status.devices["silent"].state is LinkState.DEMOTED
    # Were the good one asked only between two of the silent one's time-outs, they would be as many.
    assert 5 * status.devices["silent"].requests < status.devices["good"].requests


async def test_a_controller_that_stands_still_is_said_once(device: Any, tmp_path: Path) -> None:
    site = site_for(tmp_path, {"plc": device.port})
    plant = Plant(device)
    plant.step()
    async with running(site) as daemon:
        await until(lambda: daemon.status().devices["plc"].plant_time > 60.0, "a plant minute")
        assert daemon.status().loops["PLC"].counts.read == 1
        plant.step()
        await until(lambda: daemon.status().loops["PLC"].counts.read == 2, "a new sample")
    events = read_events(site.historian_url)
    of_loop = events[events["source"] == "PLC"]["kind"].tolist()
    assert of_loop[:2] == ["loop.silent", "loop.sampled"]


async def test_values_outside_their_range_are_named_with_tag_and_remedy(
    device: Any, tmp_path: Path
) -> None:
    site = site_for(tmp_path, {"plc": device.port})
    (tmp_path / "map.csv").write_text(
        "tag,table,address,type,low,high\n"
        "OP,holding,0,float32,0,100\nPV,holding,2,float32,0,10\nSCAN,holding,4,uint16,,\n"
    )
    site = load_site(tmp_path / "site.toml")
    async with plant_on(device), running(site) as daemon:
        await until(lambda: daemon.status().loops["PLC"].counts.bad >= 40, "40 bad samples")
        (loop,) = live_status(daemon.status(), 0.0)["loops"]
    events = read_events(site.historian_url)
    said = events[events["kind"] == "loop.silent"]
    assert len(said) == 1
    assert "PV: above the map's high: check" in said["message"].iloc[0]
    assert loop["fault"].startswith("PV: above the map's high: check")
    assert loop["bad"] >= 40


def test_a_scan_between_two_bad_samples_does_not_hide_why() -> None:
    told: list[str] = []
    journal = Mock(event=lambda kind, _, message, **__: told.append(f"{kind} {message}"))
    watch = SilenceWatch("FC101", 1.0, journal)
    for half in range(60):
        watch.look(
            0.5 * half, sampled=half % 2 == 0, answers=True, fault="PV: NaN" * (1 - half % 2)
        )
    watch.look(30.0, sampled=True, answers=True)
    for half in range(61, 140):
        watch.look(0.5 * half, sampled=False, answers=True)
        assert len(told) == (2 if half <= 100 else 3)
    assert [line.split()[0] for line in told] == ["loop.silent", "loop.sampled", "loop.silent"]
    assert "PV: NaN" in told[0]
    assert "counter stands still" in told[2]


WRITEBACK = """
[loops.LOOP.writeback]
enabled = true
loop_id = 101
base = 100
min_windows = 1
min_interval = 0.0
max_age = 86400.0
"""
# A finding must not grow too old in the seconds that a busy machine takes to judge a window: fifty
# plant seconds go by in each.


async def test_findings_reach_the_plcs_block(device: Any, plc: Any, tmp_path: Path) -> None:
    site = site_for(tmp_path, {"plc": device.port}, WRITEBACK, window=160, estimate_every=40.0)
    async with plant_on(device, plc), running(site) as daemon:

        def recorded() -> int:
            last = daemon.status().loops["PLC"].last_accepted
            return 0 if last is None or last.words is None else decode_block(last.words).seq

        # A window in which a busy machine left too many gaps makes a block that says nothing.
        await until(lambda: plc.state.accepted is not None, "a block with a verdict")
        block = plc.state.accepted
        await until(lambda: recorded() >= block.seq, "its acknowledgement on record")
    stored = read_writebacks(site.historian_url, "PLC")
    rows = stored[stored["seq"] == block.seq]
    assert rows["outcome"].tolist() == ["begun", "committed", "accepted"]
    assert [decode_block(words) for words in rows["words"]] == [block] * 3


async def test_read_only_overrides_the_site_file(device: Any, plc: Any, tmp_path: Path) -> None:
    site = site_for(tmp_path, {"plc": device.port}, WRITEBACK, window=100, estimate_every=100.0)
    async with plant_on(device, plc), running(site, read_only=True) as daemon:
        await until(lambda: daemon.status().loops["PLC"].last_attempt is not None, "a decision")
        attempt = daemon.status().loops["PLC"].last_attempt
    assert attempt is not None
    assert attempt.outcome is WritebackOutcome.READ_ONLY
    # What is stored, printed and shown says the same.
    stored = read_writebacks(site.historian_url, "PLC")["reason"].iloc[0]
    (loop,) = live_status(daemon.status(), 0.0)["loops"]
    assert loop["block"]["reason"] == stored == attempt.why
    assert device.writes == []


async def test_writing_is_off_by_default(device: Any, plc: Any, tmp_path: Path) -> None:
    area = "[loops.LOOP.writeback]\nloop_id = 101\nbase = 100\n"
    site = site_for(tmp_path, {"plc": device.port}, area, window=100, estimate_every=100.0)
    async with plant_on(device, plc), running(site) as daemon:
        await until(lambda: daemon.status().loops["PLC"].estimates >= 1, "an estimate")
    assert device.writes == []
    assert read_writebacks(site.historian_url).empty


async def test_a_killed_estimator_process_is_replaced(device: Any, tmp_path: Path) -> None:
    site = site_for(tmp_path, {"plc": device.port})
    async with plant_on(device), running(site) as daemon:
        await until(lambda: daemon.status().loops["PLC"].estimates >= 1, "an estimate")
        assert daemon._judging.worker_ids()
        for process in daemon._judging.worker_ids():
            os.kill(process, signal.SIGKILL)
        before = daemon.status().loops["PLC"].estimates
        await until(lambda: daemon.status().loops["PLC"].estimates >= before + 2, "estimates again")
        assert daemon.status().pool_rebuilt >= 1


async def test_the_duration_ends_the_run(device: Any, tmp_path: Path) -> None:
    site = site_for(tmp_path, {"plc": device.port})
    async with plant_on(device):
        status = await Daemon(site, store=STORE, pool=POOL).run(duration=0.3)
    assert status.loops["PLC"].counts.read > 0


async def test_a_data_directory_that_cannot_be_used_ends_the_start(
    device: Any, tmp_path: Path
) -> None:
    site = site_for(tmp_path, {"plc": device.port})
    (tmp_path / "occupied").write_text("")
    with pytest.raises(StoreError, match="data_dir"):
        await Daemon(site.with_data_dir(tmp_path / "occupied")).run(duration=1.0)
    assert device.requests == []


async def test_a_slow_loop_beside_a_fast_one_is_asked_for_at_its_own_period(
    device: Any, tmp_path: Path
) -> None:
    site_for(tmp_path, {"plc": device.port})
    with (tmp_path / "map.csv").open("a") as rows:
        rows.write("OP2,holding,200,float32\nPV2,holding,202,float32\n")
    with (tmp_path / "site.toml").open("a") as text:
        text.write(
            '[loops.SLOW]\ndevice = "plc"\nop = "OP2"\npv = "PV2"\nperiod = 5.0\nwindow = 100\n'
        )
    site = load_site(tmp_path / "site.toml")
    async with plant_on(device), running(site) as daemon:
        await until(lambda: daemon.status().loops["SLOW"].counts.read >= 8, "slow samples")
        counts = daemon.status().loops["SLOW"].counts
        elapsed = daemon.status().devices["plc"].plant_time
        asked = [address for function, address, _ in device.requests if function == 3]
    # The fast loop is polled twice a second unless the machine is busy, the slow one once in five.
    assert asked.count(0) > asked.count(200)
    assert asked.count(200) <= elapsed / 5.0 + 2.0
    assert asked.count(200) >= counts.read
