"""A changed site file is taken over while the daemon runs, or refused as a whole."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fieldlink.daemon import Daemon, reload_on_hangup
from fieldlink.daemon.reloading.site_change import SiteChange
from fieldlink.site import Site, load_site
from fieldlink.store import read_events


def change(site: Site, old: str, new: str) -> None:
    text = site.path.read_text()
    assert old in text
    # As an editor does it: the new file takes the place of the old one.
    part = site.path.with_suffix(".new")
    part.write_text(text.replace(old, new))
    part.replace(site.path)


def kinds(site: Site, kind: str) -> list[str]:
    events = read_events(site.historian_url)
    return events[events["kind"] == kind]["message"].tolist()


async def test_a_changed_loop_starts_again_and_the_others_keep_their_windows(
    new_device: Callable[..., Any], tmp_path: Path, live: Any
) -> None:
    first, second = new_device(), new_device()
    await first.start()
    await second.start()
    site = live.site_for(tmp_path, {"a": first.port, "b": second.port}, window=100_000)
    async with (
        live.plant_on(first),
        live.plant_on(second),
        live.running(site, watch_files=True) as daemon,
    ):
        loops = daemon.status().loops
        await live.until(
            lambda: min(loop.counts.read for loop in daemon.status().loops.values()) >= 50,
            "50 samples",
        )
        connections = first.connections
        text = site.path.read_text()
        at = text.index("[loops.B]")
        site.path.write_text(text[:at] + text[at:].replace("window = 100000", "window = 500"))
        await live.until(lambda: daemon.status().reloads == 1, "the reload")
        loops = daemon.status().loops
        assert loops["A"].counts.read >= 50
        assert loops["B"].counts.read < 50
        before = loops["A"].counts
        await live.until(lambda: daemon.status().loops["B"].counts.read >= 20, "samples of B")
        after = daemon.status().loops["A"].counts
        assert after.read > before.read
        # The unchanged device was not touched: same connection, one unbroken count of slots.
        assert first.connections == connections
        assert after.restarts == 0
    assert "changed: loop B of b" in kinds(site, "site.reloaded")[0]


async def test_settings_that_are_not_about_samples_leave_the_window(
    device: Any, tmp_path: Path, live: Any
) -> None:
    site = live.site_for(tmp_path, {"plc": device.port}, window=100_000)
    async with live.plant_on(device), live.running(site) as daemon:
        await live.until(lambda: daemon.status().loops["PLC"].counts.read >= 50, "50 samples")
        change(site, "estimate_every = 20.0", "estimate_every = 30.0")
        change(site, "timeout = 60.0", "timeout = 50.0")
        daemon.reload_soon()
        await live.until(lambda: daemon.status().reloads == 1, "the reload")
        counts = daemon.status().loops["PLC"].counts
        assert counts.read >= 50
        await live.until(
            lambda: daemon.status().loops["PLC"].counts.read >= counts.read + 20, "more samples"
        )
        # The device was started again, its loop went on: slots are counted on.
        counts = daemon.status().loops["PLC"].counts
        assert counts.expected == counts.read + counts.missed + counts.bad
        assert counts.read >= 70
    assert "windows kept: PLC" in kinds(site, "site.reloaded")[0]


async def test_a_wrong_site_is_refused_and_the_old_one_stays(
    device: Any, tmp_path: Path, live: Any
) -> None:
    site = live.site_for(tmp_path, {"plc": device.port})
    async with live.plant_on(device), live.running(site, watch_files=True) as daemon:
        await live.until(lambda: daemon.status().loops["PLC"].counts.read >= 5, "samples")
        change(site, 'pv = "PV"', 'pv = "VP"')
        await live.until(lambda: daemon.status().refused == 1, "the refusal")
        read = daemon.status().loops["PLC"].counts.read
        await live.until(
            lambda: daemon.status().loops["PLC"].counts.read >= read + 20, "samples all the same"
        )
        change(site, 'pv = "VP"', 'pv = "PV"')
        await live.until(lambda: daemon.status().reloads == 1, "the corrected file")
        site.path.unlink()
        await live.until(lambda: daemon.status().refused == 2, "a file that is gone")
    (wrong, gone) = kinds(site, "site.refused")
    assert "VP" in wrong
    assert "site.toml" in gone


async def test_loops_come_and_go(new_device: Callable[..., Any], tmp_path: Path, live: Any) -> None:
    first, second = new_device(), new_device()
    await first.start()
    await second.start()
    live.site_for(tmp_path, {"a": first.port, "b": second.port})
    both = (tmp_path / "site.toml").read_text()
    site = live.site_for(tmp_path, {"a": first.port})
    async with live.plant_on(first), live.plant_on(second), live.running(site) as daemon:
        await live.until(lambda: daemon.status().loops["A"].counts.read >= 5, "samples of A")
        alone = site.path.read_text()
        site.path.write_text(both)
        with reload_on_hangup(daemon.reload_soon):
            os.kill(os.getpid(), signal.SIGHUP)
            await live.until(lambda: daemon.status().reloads == 1, "SIGHUP")
        await live.until(lambda: daemon.status().loops["B"].estimates >= 1, "an estimate of B")
        site.path.write_text(alone)
        daemon.reload_soon()
        await live.until(lambda: list(daemon.status().loops) == ["A"], "B gone")
        asked = len(second.requests)
        read = daemon.status().loops["A"].counts.read
        await live.until(lambda: daemon.status().loops["A"].counts.read >= read + 20, "A goes on")
        assert len(second.requests) == asked


async def test_what_needs_a_start_is_reported(device: Any, tmp_path: Path, live: Any) -> None:
    site = live.site_for(tmp_path, {"plc": device.port})
    other = tmp_path / "other.toml"
    other.write_text(site.path.read_text() + "\n[historian]\nretention_days = 3.0\n")
    found = SiteChange.between(site, load_site(other))
    assert not found.touches_devices
    assert found.restart == ("historian",)
    assert "at the next start: historian" in str(found)
    notices = '\n[notify]\npage = "https://edge"\n[notify.web_hook]\nurl = "http://127.0.0.1:9/x"\n'
    other.write_text(site.path.read_text() + notices)
    assert SiteChange.between(site, load_site(other)).restart == ("notify",)


async def test_a_defect_while_reading_does_not_end_the_daemon(
    device: Any, tmp_path: Path, live: Any
) -> None:
    site = live.site_for(tmp_path, {"plc": device.port})

    def reread() -> Site:
        raise ZeroDivisionError("a defect")

    async with live.plant_on(device), live.running(site, reread=reread) as daemon:
        assert isinstance(daemon, Daemon)
        await live.until(lambda: daemon.status().loops["PLC"].counts.read >= 5, "samples")
        daemon.reload_soon()
        await live.until(lambda: daemon.status().refused == 1, "the refusal")
        await asyncio.sleep(0)
    assert "a defect" in kinds(site, "site.refused")[0]


@pytest.mark.parametrize(
    ("old", "new"), [("window = 50", "window = 60"), ("holding,2", "holding,6")]
)
def test_a_loop_whose_samples_mean_something_else_is_not_kept(
    tmp_path: Path, live: Any, old: str, new: str
) -> None:
    site = live.site_for(tmp_path, {"plc": 502})
    for name in ("site.toml", "map.csv"):
        text = (tmp_path / name).read_text()
        (tmp_path / name).write_text(text.replace(old, new))
    found = SiteChange.between(site, load_site(site.path))
    assert found.changed == ("plc",)
    assert found.kept_loops == ()


def test_loops_that_come_and_go_are_told_from_those_that_change(tmp_path: Path, live: Any) -> None:
    both = live.site_for(tmp_path, {"a": 502, "b": 503})
    text = both.path.read_text()
    on_one = [text.replace('device = "b"', 'device = "a"')]
    on_one.append(on_one[0].replace("[loops.B]", "[loops.C]"))
    one, renamed = (_site(tmp_path / f"{at}.toml", text) for at, text in enumerate(on_one))
    without = _site(tmp_path / "without.toml", on_one[0][: on_one[0].index("[loops.B]")])
    assert "changed: loop B (gone) of a" in str(SiteChange.between(one, without))
    assert "changed: loop B (new) of a" in str(SiteChange.between(without, one))
    assert "changed: loops B (gone) and C (new) of a" in str(SiteChange.between(one, renamed))
    assert "changed: loop B of a" in str(SiteChange.between(both, one))


def _site(path: Path, text: str) -> Site:
    path.write_text(text)
    return load_site(path)
