"""The live daemon: rounds in its worker processes, findings to the store, notices to a receiver."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fieldlink.daemon.reporting.status_documents import live_status
from fieldlink.site import load_site
from fieldlink.store import open_findings, read_events
from fieldlink.web.metrics import render_metrics
from tests.daemon import live
from tests.links.fake_device import FakeDevice
from tests.notices.receiving import HookServer


async def test_a_live_daemon_confirms_a_finding_and_tells_of_it_and_of_a_lost_device(
    tmp_path: Path,
) -> None:
    device: Any = FakeDevice()
    await device.start()
    async with HookServer().running() as hook, live.plant_on(device):
        live.site_for(tmp_path, {"plc": device.port}, window=160, estimate_every=1e6)
        with (tmp_path / "site.toml").open("a") as file:
            file.write(
                '[findings]\nevery = 20.0\n[notify]\npage = "http://127.0.0.1:9480"\n'
                f'lost_after = 0.0\n[notify.web_hook]\nurl = "http://127.0.0.1:{hook.port}"\n'
            )
        site = load_site(tmp_path / "site.toml")
        async with live.running(site) as daemon:
            await live.until(lambda: hook.posts, "the notice of a finding")
            found = live_status(daemon.status(), daemon.since)
            text = render_metrics(daemon.status()).decode()
            await device.stop()
            await live.until(
                lambda: any(one["state"] == "lost" for _, one in hook.posts), "the lost device"
            )
    notice = hook.posts[0][1]
    assert notice["link"] == "http://127.0.0.1:9480/loops/PLC"
    assert notice["detail"]["loop"] == "PLC"
    (stored,) = [
        one
        for one in open_findings(site.historian_url)
        if one.finding == notice["detail"]["finding"]
    ]
    assert stored.state == "confirmed"
    assert stored.finding in {one["finding"] for one in found["findings"]}
    assert found["loops"][0]["cause"] is not None
    assert 'fieldlink_notices_total{outcome="delivered",receiver="web_hook"}' in text
    assert 'state="confirmed"' in text
    kinds = set(read_events(site.historian_url)["kind"])
    assert {"finding.watch", "finding.confirmed", "device.demoted", "notice.delivered"} <= kinds
    assert "defect" not in kinds
