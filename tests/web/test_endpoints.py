"""The endpoints over real HTTP: what they tell, and whom."""

from __future__ import annotations

import asyncio
import socket
import ssl
import subprocess
from pathlib import Path
from typing import Any

import httpx
import pytest
import structlog
import trustme
from prometheus_client.parser import text_string_to_metric_families

from fieldlink.daemon import Daemon
from fieldlink.site import Site, load_site
from fieldlink.web import WebError, certificate, web_server

TOKEN = "0123456789abcdef0123456789abcdef"


def with_web(site: Site, text: str) -> Site:
    site.path.write_text(f"{site.path.read_text()}\n[web]\nport = 0\n{text}")
    return load_site(site.path)


def figures(text: str) -> dict[tuple[str, str], float]:
    """Metrics by name and by the label values in order of the labels."""
    return {
        (sample.name, " ".join(value for _, value in sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


@pytest.fixture
def token_file(tmp_path: Path) -> Path:
    file = tmp_path / "token"
    file.write_text(TOKEN + "\n")
    file.chmod(0o600)
    return file


async def test_health_and_metrics_of_a_running_daemon(
    device: Any, tmp_path: Path, live: Any
) -> None:
    site = with_web(
        live.site_for(tmp_path, {"plc": device.port}, window=240, estimate_every=40.0), ""
    )
    async with live.plant_on(device), live.running(site) as daemon, web_server(site, daemon) as at:
        base = f"http://127.0.0.1:{at}"
        async with httpx.AsyncClient(base_url=base, timeout=60.0) as client:
            await live.until(lambda: daemon.status().loops["PLC"].estimates >= 1, "an estimate")
            assert (await client.get("/healthz")).json() == {"status": "ok", "stuck": []}
            ready = await client.get("/readyz")
            assert (ready.status_code, ready.json()["ready"]) == (200, True)
            answer = await client.get("/metrics")
            found = figures(answer.text)
            status = daemon.status()
            await device.stop()
            await live.until(
                lambda: daemon.status().devices["plc"].state.name == "DEMOTED", "demoted"
            )
            ready = await client.get("/readyz")
            assert ready.status_code == 503
            reason = ready.json()["reasons"][0]
            assert "device plc is demoted" in reason
            assert reason.count("plc") == reason.count("127.0.0.1") == 1
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    counts = status.loops["PLC"].counts
    read = found["fieldlink_loop_slots_total", "plc PLC read"]
    assert 0 < read <= counts.read
    assert found["fieldlink_loop_slots_total", "plc PLC expected"] >= read
    assert found["fieldlink_loop_verdict", "plc PLC stiction"] == 1.0
    estimate = status.loops["PLC"].last_estimate
    assert estimate is not None
    assert estimate.findings is not None
    bounds = [
        found["fieldlink_loop_stick_band", f"{bound} plc PLC"] for bound in ("low", "value", "high")
    ]
    assert bounds == sorted(bounds)
    assert bounds[1] == pytest.approx(estimate.findings.stick_band.value, rel=0.2)
    assert found["fieldlink_device_state", "plc good"] == 1.0
    assert found["fieldlink_reply_lateness_seconds_count", "plc"] == read
    assert found["fieldlink_estimator_windows_total", "estimated"] >= 1
    assert found["fieldlink_store_lost_total", ""] == 0
    assert found["process_resident_memory_bytes", ""] > 1e6


async def test_what_a_device_refuses_and_how_often_it_was_opened_is_reported(
    device: Any, tmp_path: Path, live: Any
) -> None:
    site = with_web(live.site_for(tmp_path, {"plc": device.port}), "")
    with (tmp_path / "map.csv").open("a") as rows:
        rows.write("NONE,holding,300,uint16\n")
    device.illegal = {300}
    site = load_site(site.path)
    async with live.plant_on(device), live.running(site) as daemon, web_server(site, daemon) as at:
        await live.until(lambda: daemon.status().devices["plc"].quarantined != (), "quarantined")
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{at}", timeout=60.0) as client:
            found = figures((await client.get("/metrics")).text)
            ready = (await client.get("/readyz")).json()
    assert found["fieldlink_device_quarantined_tags", "plc"] == 1
    assert found["fieldlink_device_connects_total", "plc"] == 1
    assert found["fieldlink_device_late_replies_total", "plc"] == 0
    assert "device plc refuses NONE" in ready["reasons"]


async def test_a_part_that_hangs_is_a_503(tmp_path: Path, live: Any) -> None:
    site = with_web(live.site_for(tmp_path, {"plc": 9}), "")
    daemon = Daemon(site)
    async with web_server(site, daemon) as port, httpx.AsyncClient(timeout=60.0) as client:
        before = await client.get(f"http://127.0.0.1:{port}/readyz")
        assert before.status_code == 503
        assert before.json()["reasons"][0] == "the daemon is starting"
        daemon.stuck = lambda: ("device plc",)  # type: ignore[method-assign]
        answer = await client.get(f"http://127.0.0.1:{port}/healthz")
    assert (answer.status_code, answer.json()["stuck"]) == (503, ["device plc"])


async def test_a_token_is_asked_for_at_every_endpoint(
    token_file: Path, tmp_path: Path, live: Any
) -> None:
    text = f'token_file = "{token_file.name}"\n'
    site = with_web(live.site_for(tmp_path, {"plc": 9}), text)
    async with web_server(site, Daemon(site)) as port, httpx.AsyncClient(timeout=60.0) as client:
        for name in ("healthz", "readyz", "metrics"):
            url = f"http://127.0.0.1:{port}/{name}"
            for wrong in ({}, {"Authorization": f"Bearer {TOKEN[:-1]}"}, {"Authorization": TOKEN}):
                answer = await client.get(url, headers=wrong)
                assert answer.status_code == 401
                assert "fieldlink_" not in answer.text
            right = await client.get(url, headers={"Authorization": f"Bearer {TOKEN}"})
            assert right.status_code in (200, 503)
        answer = await client.post(f"http://127.0.0.1:{port}/healthz")
        assert answer.status_code == 405


async def test_a_foreign_name_for_this_machine_gets_no_figures(
    token_file: Path, tmp_path: Path, live: Any
) -> None:
    """A page of others may bind its own name to loopback, but has no token."""
    foreign = {"Host": "attacker.example"}
    bearer = {"Authorization": f"Bearer {TOKEN}"}
    plain = live.site_for(tmp_path, {"plc": 9})
    async with httpx.AsyncClient(timeout=60.0) as client:
        site = with_web(plain, "")
        async with web_server(site, Daemon(site)) as port:
            for name, status in (("healthz", 200), ("readyz", 421), ("metrics", 421)):
                answer = await client.get(f"http://127.0.0.1:{port}/{name}", headers=foreign)
                assert answer.status_code == status
                assert "fieldlink_" not in answer.text
            for host in ("attacker.example:", "attacker.example:99999", "127.0.0.1@x", "[::1"):
                answer = await client.get(
                    f"http://127.0.0.1:{port}/metrics", headers={"Host": host}
                )
                assert answer.status_code == 421
            for host in (f"localhost:{port}", "LOCALHOST", f"[::1]:{port}", "127.0.0.2"):
                near = {"Host": host}
                answer = await client.get(f"http://127.0.0.1:{port}/metrics", headers=near)
                assert answer.status_code == 200
        site = with_web(live.site_for(tmp_path, {"plc": 9}), f'token_file = "{token_file.name}"\n')
        async with web_server(site, Daemon(site)) as port:
            url = f"http://127.0.0.1:{port}/metrics"
            assert (await client.get(url, headers=foreign)).status_code == 421
            assert (await client.get(url, headers=foreign | bearer)).status_code == 200


@pytest.mark.parametrize(
    ("content", "mode", "message"),
    [("short", 0o600, "at least 20"), (TOKEN, 0o644, "chmod 640"), (None, 0, "cannot be read")],
)
async def test_a_token_that_is_no_secret_is_refused(
    token_file: Path, tmp_path: Path, live: Any, content: str | None, mode: int, message: str
) -> None:
    if content is None:
        token_file.unlink()
    else:
        token_file.write_text(content)
        token_file.chmod(mode)
    site = with_web(live.site_for(tmp_path, {"plc": 9}), f'token_file = "{token_file.name}"\n')
    with pytest.raises(WebError, match=message) as caught:
        async with web_server(site, Daemon(site)):
            pytest.fail("it must not listen")
    assert TOKEN not in str(caught.value)


async def test_tls(token_file: Path, tmp_path: Path, live: Any) -> None:
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1",
         "-nodes", "-keyout", tmp_path / "key.pem", "-out", tmp_path / "cert.pem", "-days", "2",
         "-subj", "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1"],
        check=True, capture_output=True,
    )  # fmt: skip
    text = (
        f'host = "0.0.0.0"\ntoken_file = "{token_file.name}"\n'
        'tls_certificate = "cert.pem"\ntls_key = "key.pem"\n'
    )
    site = with_web(live.site_for(tmp_path, {"plc": 9}), text)
    trusted = ssl.create_default_context(cafile=tmp_path / "cert.pem")
    async with (
        web_server(site, Daemon(site)) as port,
        httpx.AsyncClient(verify=trusted, timeout=60.0) as client,
    ):
        url = f"https://127.0.0.1:{port}/healthz"
        assert (await client.get(url)).status_code == 401
        right = {"Authorization": f"Bearer {TOKEN}"}
        assert (await client.get(url, headers=right)).status_code == 200
        with pytest.raises(httpx.TransportError):
            await client.get(f"http://127.0.0.1:{port}/healthz")


async def test_a_renewed_certificate_is_used_without_a_restart(
    token_file: Path, tmp_path: Path, live: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(certificate, "LOOK_EVERY", 0.02)
    first, second = trustme.CA(), trustme.CA()

    def write(authority: trustme.CA, *, key: bool = True) -> None:
        issued = authority.issue_cert("127.0.0.1")
        issued.cert_chain_pems[0].write_to_path(tmp_path / "cert.pem")
        if key:
            issued.private_key_pem.write_to_path(tmp_path / "key.pem")

    async def answers(port: int, authority: trustme.CA) -> bool:
        trusted = ssl.create_default_context()
        authority.configure_trust(trusted)
        async with httpx.AsyncClient(verify=trusted, timeout=60.0) as client:
            try:
                await client.get(f"https://127.0.0.1:{port}/healthz")
            except httpx.ConnectError:
                return False
        return True

    write(first)
    text = f'token_file = "{token_file.name}"\ntls_certificate = "cert.pem"\ntls_key = "key.pem"\n'
    site = with_web(live.site_for(tmp_path, {"plc": 9}), text)
    async with web_server(site, Daemon(site)) as port:
        assert port is not None
        assert await answers(port, first)
        write(second, key=False)
        with structlog.testing.capture_logs() as logs:
            await live.until(lambda: bool(logs), "the log line")
        assert logs[0]["event"] == "web.certificate_refused"
        assert "does not belong" in logs[0]["error"]
        assert await answers(port, first)
        write(second)
        for _ in range(1000):
            if await answers(port, second):
                break
            await asyncio.sleep(0.02)
        assert not await answers(port, first)


async def test_a_certificate_that_is_none_is_reported(tmp_path: Path, live: Any) -> None:
    (tmp_path / "cert.pem").write_text("nothing")
    text = 'tls_certificate = "cert.pem"\ntls_key = "cert.pem"\n'
    site = with_web(live.site_for(tmp_path, {"plc": 9}), text)
    with pytest.raises(WebError, match="PEM files"):
        async with web_server(site, Daemon(site)):
            pytest.fail("it must not listen")
    # A key with a password must not ask for it at a terminal that nobody watches.
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-passout", "pass:word", "-keyout",
         tmp_path / "cert.pem", "-out", tmp_path / "own.pem", "-days", "2", "-subj", "/CN=x"],
        check=True, capture_output=True,
    )  # fmt: skip
    with (tmp_path / "cert.pem").open("ab") as file:
        file.write((tmp_path / "own.pem").read_bytes())
    with pytest.raises(WebError, match="the key has a password"):
        async with web_server(site, Daemon(site)):
            pytest.fail("it must not listen")


async def test_a_port_that_is_taken_costs_the_endpoints_only(tmp_path: Path, live: Any) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        site = live.site_for(tmp_path, {"plc": 9})
        site = with_web(site, "").with_data_dir(tmp_path)
        text = site.path.read_text().replace("port = 0", f"port = {taken.getsockname()[1]}")
        site.path.write_text(text)
        site = load_site(site.path)
        async with web_server(site, Daemon(site)) as port:
            assert port is None


async def test_it_listens_on_loopback_unless_told(tmp_path: Path, live: Any) -> None:
    site = with_web(live.site_for(tmp_path, {"plc": 9}), "")
    async with web_server(site, Daemon(site)) as port:
        assert port is not None
        listening = Path("/proc/net/tcp").read_text().splitlines()[1:]
        local = [line.split()[1] for line in listening if line.split()[3] == "0A"]
        assert f"0100007F:{port:04X}" in local
        assert f"00000000:{port:04X}" not in local


@pytest.mark.parametrize(
    "bytes_sent",
    [b"\x00" * 4000, b"GET " + b"/" * 100_000, b"GET / HTTP/9.9\r\n\r\n", b"\xff\xfe\r\n\r\n"],
)
async def test_bytes_that_are_no_request_do_no_harm(
    tmp_path: Path, live: Any, bytes_sent: bytes
) -> None:
    site = with_web(live.site_for(tmp_path, {"plc": 9}), "")
    async with web_server(site, Daemon(site)) as port, httpx.AsyncClient(timeout=60.0) as client:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(bytes_sent)
        writer.write_eof()
        await reader.read()
        writer.close()
        assert (await client.get(f"http://127.0.0.1:{port}/healthz")).status_code == 200
