"""The pages and their JSON over real HTTP: what they tell, whom, and what nobody may do."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import structlog

from benchmarks.web_store import fill_store
from fieldlink.daemon import Daemon
from fieldlink.site import load_site
from fieldlink.store import EstimateRecord, EventRecord, Historian, StoreError, read_events
from fieldlink.web import WebError, store_server, web_server
from fieldlink.web.responses import render
from fieldlink.web.view.curves import stem_of
from fieldlink.web.view.reasons import what_would_help
from fieldlink.worklist import WorkListSettings, list_loops
from fieldlink.worklist.row import Outlook

TOKEN = "0123456789abcdef0123456789abcdef"
PAGES = ("/", "/devices", "/api/loops", "/api/loops/LIC-0001", "/api/devices", "/fragments/fleet")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("store") / "history.sqlite"
    now_ms = round(time.time() * 1000.0)
    return fill_store(file, now_ms=now_ms, loops=10, days=30, samples=50, long_samples=9000)


@pytest.fixture
async def client(store: str) -> AsyncIterator[httpx.AsyncClient]:
    async with (
        store_server(store, None, "127.0.0.1", 0) as address,
        httpx.AsyncClient(base_url=address, timeout=60.0) as made,
    ):
        yield made


async def test_the_fleet_is_ranked_by_what_to_repair_first(client: httpx.AsyncClient) -> None:
    loops = (await client.get("/api/loops")).json()["loops"]
    assert [loop["rank"] for loop in loops] == list(range(1, 11))
    verdicts = [loop["verdict"] for loop in loops]
    assert verdicts == ["stiction"] * 2 + ["not_assessable"] * 2 + ["no_stiction"] * 6
    assert loops[0]["uncertain"] is False
    page = (await client.get("/")).text
    places = [page.index(f'data-name="{loop["name"]}"') for loop in loops]
    assert places == sorted(places)


async def test_the_rank_follows_from_the_figures_that_are_shown(
    tmp_path: Path, device: Any, live: Any
) -> None:
    site = live.site_for(tmp_path, {"a": device.port, "b": device.port})
    url = f"sqlite:///{tmp_path / 'history.sqlite'}"
    historian = Historian(url)
    historian.start(EventRecord(1, "start", "daemon", "started"))
    # A controller that works against the valve hides a part of its effect: more than PV's variance.
    for name, S, effect in (("A", 3.0, 4.7), ("B", 8.0, 1.3)):
        document = {"evidence": {"effect": effect}}
        historian.put(
            EstimateRecord(
                name, 2, 2, 0, 9, "estimated", "", "stiction", stick_band=S, document=document
            )
        )
    historian.stop()
    async with (
        store_server(url, site, "127.0.0.1", 0) as address,
        httpx.AsyncClient(base_url=address, timeout=60.0) as client,
    ):
        loops = (await client.get("/api/loops")).json()["loops"]
    assert [(loop["name"], loop["avoidable"]) for loop in loops] == [("B", 1.0), ("A", 1.0)]
    shown = [loop["avoidable"] + loop["stick_band"]["value"] / loop["limit"] for loop in loops]
    assert shown == sorted(shown, reverse=True)


async def test_page_and_work_list_judge_a_stick_band_by_the_same_limit(
    tmp_path: Path, device: Any, live: Any
) -> None:
    live.site_for(tmp_path, {"a": device.port, "b": device.port})
    # An OP in mA: the limit in % of its span is another number in its units.
    rows = "OP,holding,0,float32,4,20\nPV,holding,2,float32,,\nSCAN,holding,4,uint16,,\n"
    (tmp_path / "map.csv").write_text(f"tag,table,address,type,low,high\n{rows}")
    site_file = tmp_path / "site.toml"
    site_file.write_text(site_file.read_text() + "\n[report]\nstick_band_limit = 2.5\n")
    site = load_site(site_file)
    url = f"sqlite:///{tmp_path / 'history.sqlite'}"
    historian = Historian(url)
    historian.start(EventRecord(1, "start", "daemon", "started"))
    for name, S in (("A", 0.3), ("B", 11.0)):
        document = {
            "verdict": "stiction", "confidence": 0.9, "period_s": 1.0, "reasons": [],
            "stick_band": {"value": S, "low": 0.9 * S, "high": 1.1 * S},
            "slip_jump": {"value": 0.5, "low": 0.4, "high": 0.6},
        }  # fmt: skip
        historian.put(
            EstimateRecord(
                name, 2, 2, 0, 9, "estimated", "", "stiction", stick_band=S, document=document
            )
        )
    historian.stop()
    async with (
        store_server(url, site, "127.0.0.1", 0) as address,
        httpx.AsyncClient(base_url=address, timeout=60.0) as client,
    ):
        loops = {one["name"]: one for one in (await client.get("/api/loops")).json()["loops"]}
        pages = {name: (await client.get(f"/loops/{name}")).text for name in loops}
    settings = WorkListSettings(stick_band_limit=site.report.stick_band_limit)
    printed = {one.row.tag: one for one in list_loops(url, site, settings=settings)}
    for name, loop in loops.items():
        span = printed[name].op_span
        assert loop["limit"] == pytest.approx(printed[name].row.limit * span / 100.0)
        is_over = printed[name].row.outlook is Outlook.REACHED
        assert is_over == (name == "B")
        assert ("over the limit of 0.4" in pages[name]) == is_over
        assert ("below the limit of 0.4" in pages[name]) != is_over
        assert "allowed" not in pages[name]


async def test_a_loop_says_why_and_what_was_written(client: httpx.AsyncClient) -> None:
    found = (await client.get("/api/loops/LIC-0001")).json()
    assert any("93" in text and "41" in text for text in found["why"])
    assert found["written"][0]["outcome"] == "accepted"
    assert found["to_do"] == ["Check the packing at the next stop."]
    assert found["surer"] == ["Nothing more is needed; the next windows confirm it."]
    assert (await client.get("/loops/LIC-0001")).status_code == 200
    for path in ("/loops/NONE", "/api/loops/NONE", "/api/loops/NONE/samples"):
        assert (await client.get(path)).status_code == 404


async def test_thinned_samples_keep_every_extreme(client: httpx.AsyncClient) -> None:
    address = "/api/loops/LIC-0001/samples?last=20000"
    all_of_them = (await client.get(f"{address}&points=20000")).json()
    thinned = (await client.get(f"{address}&points=500")).json()
    assert (all_of_them["samples"], all_of_them["thinned"]) == (9000, False)
    assert thinned["thinned"] is True
    assert len(thinned["time"]) <= 502
    assert thinned["time"] == sorted(thinned["time"])
    for name in ("op", "pv"):
        assert min(thinned[name]) == min(all_of_them[name])
        assert max(thinned[name]) == max(all_of_them[name])
    assert all_of_them["stem"] is not None
    bad = await client.get("/api/loops/LIC-0001/samples?since=yesterday")
    assert bad.status_code == 400
    assert bad.json()["error"] == "since is 'yesterday'; give a number"


def test_after_a_gap_the_stem_is_shown_again_when_it_is_known() -> None:
    judged = {"verdict": "stiction", "stick_band": 6.0, "slip_jump": 2.0}
    swing = [50.0 + 10.0 * math.sin(k / 15.0) for k in range(400)]
    held = [*range(200), *range(210, 410)]
    after = stem_of(swing, judged, held)
    assert after is not None
    assert after[199] is not None
    assert after[200] is None
    assert None not in after[300:]
    at_rest = stem_of([*swing[:200], *[52.0] * 200], judged, held)
    assert at_rest is not None
    assert set(at_rest[200:]) == {None}


async def test_only_what_changed_is_sent_again(client: httpx.AsyncClient) -> None:
    async with asyncio.timeout(60.0):
        # The points of trends are read after the first view, and date every verdict.
        while not all(one["since"] for one in (await client.get("/api/loops")).json()["loops"]):
            await asyncio.sleep(0.1)
    first = (await client.get("/fragments/fleet")).json()
    assert len(first["rows"]) == 10
    revision = first["revision"]
    for _ in range(200):
        # Trends are computed in a process apart and change the rows of the sticky loops.
        again = (await client.get(f"/fragments/fleet?revision={revision}")).json()
        if again["rows"]:
            break
    assert set(again["rows"]) <= {"LIC-0001", "LIC-0006"}


async def test_a_page_that_was_open_over_a_restart_gets_every_row(store: str) -> None:
    revision = 0.0
    for _ in range(2):
        async with (
            store_server(store, None, "127.0.0.1", 0) as address,
            httpx.AsyncClient(base_url=address, timeout=60.0) as client,
        ):
            for known in (revision, revision + 1e6):
                found = (await client.get(f"/fragments/fleet?revision={known}")).json()
                assert len(found["rows"]) == len(found["order"]) == 10
            revision = found["revision"] + 50


async def test_no_answer_lets_a_foreign_origin_in(client: httpx.AsyncClient) -> None:
    for path in PAGES:
        answer = await client.get(path)
        assert answer.status_code == 200
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "http" not in policy
        assert "style=" not in answer.text
        assert "<script>" not in answer.text
    foreign = await client.get("/api/loops", headers={"Host": "attacker.example:80"})
    assert foreign.status_code == 421


async def test_a_store_alone_refuses_every_action(client: httpx.AsyncClient) -> None:
    asked = {"action": "hold", "who": "A", "why": "b"}
    answer = await client.post("/api/loops/LIC-0001/actions", json=asked)
    assert answer.status_code == 409
    assert "fieldlink run" in answer.json()["error"]


async def test_other_machines_and_missing_stores_are_refused(tmp_path: Path, store: str) -> None:
    with pytest.raises(WebError, match="token_file"):
        async with store_server(store, None, "0.0.0.0", 0):
            pytest.fail("it must not listen")
    with pytest.raises(StoreError, match="no historian"):
        async with store_server(f"sqlite:///{tmp_path / 'none'}", None, "127.0.0.1", 0):
            pytest.fail("it must not listen")


async def test_actions_need_the_token_in_a_header_never_a_cookie(
    device: Any, tmp_path: Path, live: Any
) -> None:
    (tmp_path / "token").write_text(TOKEN)
    (tmp_path / "token").chmod(0o600)
    site = live.site_for(tmp_path, {"plc": device.port})
    site.path.write_text(site.path.read_text() + '\n[web]\nport = 0\ntoken_file = "token"\n')
    site = load_site(site.path)
    path, asked = "/api/loops/PLC/actions", {"action": "hold", "who": "A. Meyer", "why": "leak"}
    async with live.plant_on(device), live.running(site) as daemon, web_server(site, daemon) as at:
        await live.until(lambda: daemon.started.is_set(), "started")
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{at}", timeout=60.0) as client:
            # Without the token a person is led to the login and a program is refused.
            assert (await client.get("/")).headers["location"] == "/login"
            assert (await client.get("/api/loops")).status_code == 401
            with structlog.testing.capture_logs() as logs:
                for _ in range(3):
                    wrong = await client.post("/login", data={"token": "wrong"})
                    assert wrong.status_code == 401
            assert [line["event"] for line in logs].count("web.login_refused") == 1
            entered = await client.post("/login", data={"token": TOKEN})
            cookie = entered.headers["set-cookie"].lower()
            assert "httponly" in cookie
            assert "samesite=strict" in cookie
            assert TOKEN not in cookie
            assert (await client.get("/api/loops")).status_code == 200
            # The session may look and not act, nor scrape.
            assert (await client.post(path, json=asked)).status_code == 401
            assert (await client.get("/metrics")).status_code == 401
            assert daemon.status().loops["PLC"].hold == ""
            right = {"Authorization": f"Bearer {TOKEN}"}
            assert (await client.get(path, headers=right)).status_code == 404
            for body, message in (
                ({**asked, "action": "enable"}, "there is no action 'enable'"),
                ({**asked, "who": ""}, "who is empty"),
                ({**asked, "who": 5, "why": None}, "who is not a text"),
                ({**asked, "action": "annotate", "who": {"a": 1}, "why": []}, "who is not a text"),
                ({**asked, "why": None}, "why is not a text"),
                ({"action": "hold", "who": "A"}, "why is empty"),
                ({**asked, "who": "x" * 81}, "at most 80"),
                ([], "JSON object"),
            ):
                refused = await client.post(path, json=body, headers=right)
                assert refused.status_code == 400
                assert message in refused.json()["error"]
            for content in (b"{", b"[" * 8000):
                garbled = await client.post(path, content=content, headers=right)
                said = garbled.json()["error"]
                assert (garbled.status_code, said) == (400, "the body is not JSON")
            huge = await client.post(path, content=b"x" * 20_000, headers=right)
            assert huge.status_code == 400
            done = await client.post(path, json=asked, headers=right)
            assert done.json()["action"] == "hold"
            assert daemon.status().loops["PLC"].hold == "A. Meyer: leak"
            odd = rb'{"action": "annotate", "who": "A", "why": "half \ud800, \u0000 \u001b[31m"}'
            assert (await client.post(path, content=odd, headers=right)).status_code == 200
    events = read_events(site.historian_url)
    noted = events[events["kind"] == "operator.annotate"]["message"].tolist()
    assert noted == ["A: half ?, ? ?[31m"]
    assert events[events["kind"] == "operator.hold"]["source"].tolist() == ["PLC"]


async def test_without_a_token_file_one_is_drawn_for_actions_and_kept_secret(
    tmp_path: Path, live: Any
) -> None:
    site = live.site_for(tmp_path, {"plc": 9})
    site.path.write_text(site.path.read_text() + "\n[web]\nport = 0\n")
    site = load_site(site.path)
    async with web_server(site, Daemon(site)) as port, httpx.AsyncClient(timeout=60.0) as client:
        file = site.data_dir / "operator-token"
        assert file.stat().st_mode & 0o777 == 0o600
        drawn = file.read_text()
        answer = await client.get(f"http://127.0.0.1:{port}/")
        assert drawn.strip() not in answer.text
        asked = {"action": "annotate", "who": "A", "why": "b"}
        path = f"http://127.0.0.1:{port}/api/loops/PLC/actions"
        assert (await client.post(path, json=asked)).status_code == 401
    async with web_server(site, Daemon(site)):
        assert file.read_text() == drawn


async def test_a_note_starts_the_trend_again(device: Any, tmp_path: Path, live: Any) -> None:
    site = live.site_for(tmp_path, {"plc": device.port}, window=160, estimate_every=20.0)
    site.path.write_text(site.path.read_text() + "\n[web]\nport = 0\n")
    site = load_site(site.path)
    async with live.plant_on(device), live.running(site) as daemon, web_server(site, daemon) as at:
        await live.until(lambda: daemon.status().loops["PLC"].estimates >= 3, "three estimates")
        token = (site.data_dir / "operator-token").read_text().strip()
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{at}", timeout=60.0) as client:
            course: dict[str, Any] = {"time": []}
            while len(course["time"]) < 3:
                await asyncio.sleep(0.05)
                course = (await client.get("/api/loops/PLC")).json()["course"]
            asked = {"action": "annotate", "who": "A. Meyer", "why": "packing replaced"}
            await client.post(
                "/api/loops/PLC/actions", json=asked, headers={"Authorization": f"Bearer {token}"}
            )
            noted = time.time()
            while True:
                found = (await client.get("/api/loops/PLC")).json()
                begin = found["course"]["trend_from"]
                if begin is None or begin > noted:
                    break
                await asyncio.sleep(0.05)
    assert found["orders"][0]["why"] == "packing replaced"
    assert len(found["course"]["time"]) >= 3


def test_a_trend_that_may_be_none_is_steady_and_has_no_days_to_the_limit() -> None:
    row = {
        "name": "FC101", "device": "plc", "verdict": "stiction", "uncertain": False, "rank": 1,
        "compensated": False, "cause": None, "filled": None, "limit": 20.0, "since": None,
        "stick_band": {"value": 11.0, "low": 10.0, "high": 12.0}, "avoidable": 1.0,
        "block": {"style": "", "text": ""}, "swing_period_s": 80.0, "quality": 1.0,
        "device_state": "good", "automatic": 1.0, "saturated": 0.0, "travel_per_day": 1.0,
        "reversals_per_day": 1.0, "trend_per_week": 20.0, "trend_high": 178.0,
        "days_to_limit": 3.14,
    }  # fmt: skip
    doubtful = render("fleet_row.html.j2", row={**row, "trend_low": -136.0}, largest=20.0)
    assert "steady" in doubtful
    assert "3.1" not in doubtful
    clear = render("fleet_row.html.j2", row={**row, "trend_low": 5.0}, largest=20.0)
    assert "steady" not in clear
    assert "+20" in clear
    assert "3.1" in clear


def test_a_full_window_without_a_verdict_is_said_to_be_judged() -> None:
    assert what_would_help({"filled": 0.4, "message": ""}, None, None) == [
        "Wait: the window is 40\u00a0% full."
    ]
    (said,) = what_would_help({"filled": 1.0, "message": ""}, None, None)
    assert said.startswith("Wait: the window is full and being judged")
    (said,) = what_would_help({"filled": 1.0, "message": "PV holds no good sample"}, None, None)
    assert "being judged" not in said
