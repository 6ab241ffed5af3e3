"""Notices over real sockets: taken once, refused, slow, dead, and after a restart."""

from __future__ import annotations

import asyncio
import email
import email.policy
import json
import logging
import socket
import ssl
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import trustme
from typer.testing import CliRunner

from fieldlink.cli.app import app
from fieldlink.links import LinkState
from fieldlink.notices import Notice, NoticeError, Notifying, mail, receivers_of, web_hook
from fieldlink.notices.outbox import Retrying
from fieldlink.site import Site, SiteError, load_site
from fieldlink.store import FindingRecord
from tests.notices.receiving import HookServer, Mails, MailServer

SITE = """[site]
name = "mill"
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
register_map = "map.csv"
[loops.FC101]
device = "plc"
op = "OP"
pv = "PV"
period = 1.0
[notify]
page = "https://edge.example:9480/"
lost_after = 0.0
"""
NOON_MS = 1_795_262_400_000
QUICK = Retrying(first=0.01, factor=1.0, attempts=3)


def site_of(folder: Path, notify: str) -> Site:
    (folder / "map.csv").write_text(
        "tag,table,address,type\nOP,holding,0,float32\nPV,holding,2,float32\n"
    )
    site = SITE
    if notify.startswith("page = "):
        site = site.replace('page = "https://edge.example:9480/"\n', "")
    (folder / "site.toml").write_text(site + notify)
    return load_site(folder / "site.toml")


def finding(number: int = 1, state: str = "confirmed") -> FindingRecord:
    return FindingRecord(
        f"20261121-120000-{number}", NOON_MS, NOON_MS, state, "sticky_valve", "FC 101",
        ("FC 101", "TC2"), 88.0, 0.9, "confirmed",
        {"evidence": ["PV follows a sticky valve"], "action": "Check packing.", "candidates": []},
    )  # fmt: skip


class Told:
    """Events and defects that the notices told."""

    def __init__(self) -> None:
        self.events: list[tuple[str, str, str]] = []
        self.defects: list[Exception] = []

    def event(self, kind: str, source: str, message: str, *, bad: bool = False) -> None:
        del bad
        self.events.append((kind, source, message))

    def defect(self, _source: str, error: Exception, _consequence: str) -> None:
        self.defects.append(error)

    def kinds(self) -> list[str]:
        return [kind for kind, _, _ in self.events]


class People:
    """Notices of a site that run, with the states of its device in the test's hands."""

    def __init__(self, site: Site) -> None:
        self.state = LinkState.GOOD
        self.told = Told()
        self.now_ms = NOON_MS
        self.notifying = Notifying(
            site,
            states=lambda: {"plc": (self.state, "no answer within 0.5 s")},
            tell=self.told.event,
            defect=self.told.defect,
            utc_ms=lambda: self.now_ms,
            retrying=QUICK,
            look_every=0.01,
        )

    def report(self, name: str) -> Any:
        return self.notifying.report().receivers[name]

    async def until_delivered(self, name: str, count: int) -> None:
        """Wait until a receiver has taken so many; a notice that is not noted comes again."""
        await until(lambda: self.report(name).delivered == count, f"{count} for {name}")

    @asynccontextmanager
    async def running(self) -> AsyncIterator[People]:
        async with self.notifying.running():
            yield self
        assert self.told.defects == []


async def until(condition: Callable[[], object], what: str) -> None:
    for _ in range(3000):
        if condition():
            return
        await asyncio.sleep(0.01)
    pytest.fail(f"never happened: {what}")


@pytest.fixture
async def hook() -> AsyncIterator[HookServer]:
    async with HookServer().running() as server:
        yield server


@pytest.fixture
def mails() -> Iterator[tuple[Mails, MailServer]]:
    taken = Mails()
    server = MailServer(taken)
    yield taken, server
    server.stop()


def hook_table(port: int, more: str = "") -> str:
    return f'[notify.web_hook]\nurl = "http://127.0.0.1:{port}/secret/path"\n{more}'


def mail_table(port: int, more: str = 'security = "none"\n') -> str:
    return (
        f'[notify.mail]\nhost = "127.0.0.1"\nport = {port}\nsender = "edge@mill.example"\n'
        f'to = ["a@mill.example", "b@mill.example"]\n{more}'
    )


async def test_a_confirmed_finding_is_told_once_over_restarts(
    hook: HookServer, mails: tuple[Mails, MailServer], tmp_path: Path
) -> None:
    (tmp_path / "token").write_text("t0ken\n")
    taken, server = mails
    text = hook_table(hook.port, 'token_file = "token"\n') + mail_table(server.port)
    site = site_of(tmp_path, text)
    for restart in range(2):
        async with People(site).running() as people:
            people.notifying.put(finding(1, "watch"))
            people.notifying.put(finding(1))
            people.notifying.put(finding(2 + restart))
            for name in ("web_hook", "mail"):
                await people.until_delivered(name, 2 - restart)
    headers, posted = hook.posts[0]
    assert headers["authorization"] == "Bearer t0ken"
    assert posted["kind"] == "finding"
    assert posted["state"] == "confirmed"
    assert posted["link"] == "https://edge.example:9480/loops/FC%20101"
    assert posted["detail"]["loops"] == ["FC 101", "TC2"]
    assert [one["subject"] for _, one in hook.posts] == [
        f"finding/20261121-120000-{number}" for number in (1, 2, 3)
    ]
    content = taken.taken[0].content
    assert isinstance(content, bytes)
    mail = email.message_from_bytes(content, policy=email.policy.default)
    assert mail["Subject"].startswith("[mill] candidate FC 101: sticky valve; TC2 swings")
    body = mail.get_content()
    for line in ("PV follows a sticky valve", "next step: Check packing.", posted["link"]):
        assert line in body
    assert taken.taken[0].rcpt_tos == ["a@mill.example", "b@mill.example"]
    assert len({email.message_from_bytes(one.content)["Message-ID"] for one in taken.taken}) == 3  # type: ignore[arg-type]


async def test_a_device_is_told_lost_once_and_back_once(hook: HookServer, tmp_path: Path) -> None:
    site = site_of(tmp_path, hook_table(hook.port))
    async with People(site).running() as people:
        await until(lambda: (tmp_path / "data/notices.sqlite").exists(), "the outbox")
        people.state = LinkState.DEMOTED
        await people.until_delivered("web_hook", 1)
    # it is still lost at the next start, and comes back
    async with People(site).running() as people:
        people.state = LinkState.DEMOTED
        await until(lambda: people.notifying._devices._last, "a look")
        people.now_ms += 60_000
        people.state = LinkState.GOOD
        await people.until_delivered("web_hook", 1)
    assert [(one["subject"], one["state"]) for _, one in hook.posts] == [
        ("device/plc", "lost"),
        ("device/plc", "back"),
    ]
    assert hook.posts[0][1]["lines"] == ["no answer within 0.5 s"]
    assert hook.posts[0][1]["link"] == "https://edge.example:9480/devices"


async def test_what_is_beyond_the_hour_comes_as_one_notice(
    hook: HookServer, tmp_path: Path
) -> None:
    site = site_of(tmp_path, "per_hour = 2\n" + hook_table(hook.port))
    async with People(site).running() as people:
        for number in range(5):
            people.notifying.put(finding(number))
        await until(lambda: people.notifying.report().held == 3, "held")
        await until(lambda: len(hook.posts) == 2, "two posts")
        people.now_ms += 3_600_001
        await until(lambda: len(hook.posts) == 3, "the summary")
    summary = hook.posts[2][1]
    assert summary["title"] == "3 more notices"
    assert len(summary["lines"]) == 3


async def test_a_receiver_that_refuses_is_tried_with_a_bound_and_costs_the_other_nothing(
    hook: HookServer, mails: tuple[Mails, MailServer], tmp_path: Path
) -> None:
    taken, server = mails
    hook.status = 503
    site = site_of(tmp_path, hook_table(hook.port) + mail_table(server.port))
    async with People(site).running() as people:
        people.notifying.put(finding())
        await until(lambda: taken.taken, "the mail")
        for number in range(1, QUICK.attempts + 1):
            await until(lambda n=number: people.report("web_hook").failed == n, "an attempt")  # type: ignore[misc]
            people.now_ms += 1000
        await until(lambda: people.report("web_hook").given_up == 1, "given up")
        assert len(hook.posts) == QUICK.attempts
        assert len({one["id"] for _, one in hook.posts}) == 1
        # the next one is taken as if nothing had been
        hook.status = 204
        people.notifying.put(finding(2))
        await until(lambda: people.report("web_hook").delivered == 1, "the next one")
    kinds = people.told.kinds()
    assert kinds.count("notice.failed") == 1
    assert kinds.count("notice.given_up") == 1
    said = next(message for kind, _, message in people.told.events if kind == "notice.failed")
    assert "answered with HTTP status 503" in said
    assert "secret" not in json.dumps(people.told.events)


async def test_dead_and_slow_receivers_hold_up_neither_the_others_nor_the_end(
    hook: HookServer,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    caplog.set_level(logging.DEBUG)
    # What waited for one of these would be ended by the test's own time-out.
    for place, name in ((mail, "PATIENCE"), (mail, "STEP_PATIENCE"), (web_hook, "PATIENCE")):
        monkeypatch.setattr(place, name, 3600.0)
    hook.status = 0
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        site = site_of(tmp_path, hook_table(hook.port) + mail_table(port))
        async with People(site).running() as people:
            people.notifying.put(finding())
            await until(lambda: hook.posts, "the post that gets no answer")
            connection, _ = await asyncio.to_thread(silent.accept)
        connection.close()
    # a dead one says so at once, and nothing secret is logged
    found = receivers_of(site)
    with pytest.raises(NoticeError, match=r"127.0.0.1:\d+ cannot be reached: connection refused"):
        await found["mail"].send(people_notice())
    assert "secret/path" not in caplog.text


@pytest.mark.parametrize(
    ("status", "said"),
    [
        (307, "it names another address, where notices do not follow it"),
        (401, "check the token"),
        (404, "check the address"),
        (422, "check address and token"),
        (429, "lower notify.per_hour"),
        (500, "see its own log"),
    ],
)
async def test_what_a_web_hook_answers_has_a_remedy(
    hook: HookServer, tmp_path: Path, status: int, said: str
) -> None:
    hook.status = status
    receiver = receivers_of(site_of(tmp_path, hook_table(hook.port)))["web_hook"]
    with pytest.raises(NoticeError, match=f"HTTP status {status}; .*{said}"):
        await receiver.send(people_notice())


async def test_a_port_without_tls_is_told_as_that(
    mails: tuple[Mails, MailServer], tmp_path: Path
) -> None:
    """The web hook said "operation not permitted", which is OpenSSL's number 1 as an errno."""
    port = mails[1].port
    table = hook_table(port).replace("http://", "https://")
    receiver = receivers_of(site_of(tmp_path, table))["web_hook"]
    with pytest.raises(NoticeError, match="its port is not for TLS: correct the port"):
        await receiver.send(people_notice())
    site = site_of(tmp_path, mail_table(port, 'security = "tls"\n'))
    receiver = receivers_of(site)["mail"]
    with pytest.raises(NoticeError, match="its port is not for TLS: correct the port"):
        await receiver.send(people_notice())


def people_notice() -> Any:
    from fieldlink.notices import finding_notice

    return finding_notice(finding(), "mill", "http://127.0.0.1")


@pytest.fixture
def authority(tmp_path: Path) -> trustme.CA:
    made = trustme.CA()
    made.cert_pem.write_to_path(tmp_path / "ca.pem")
    return made


def server_tls(authority: trustme.CA) -> ssl.SSLContext:
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    authority.issue_cert("localhost", "127.0.0.1").configure_cert(tls)
    return tls


async def test_tls_and_logins_of_both(
    authority: trustme.CA, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = Mails()
    server = MailServer(taken, server_tls(authority))
    monkeypatch.setenv("MAIL_PASSWORD", "open sesame")
    mail = 'username = "edge"\npassword_variable = "MAIL_PASSWORD"\n'
    try:
        async with HookServer().running(server_tls(authority)) as hook:
            (tmp_path / "address").write_text(f"https://127.0.0.1:{hook.port}/secret\n")
            text = '[notify.web_hook]\nurl_file = "address"\n' + 'ca = "ca.pem"\n'
            site = site_of(tmp_path, text + mail_table(server.port, mail + 'ca = "ca.pem"\n'))
            for receiver in receivers_of(site).values():
                await receiver.send(people_notice())
            assert len(hook.posts) == 1
            assert taken.logins == [("edge", "open sesame")]
            assert len(taken.taken) == 1
            # a wrong password, a certificate of nobody, and no encryption at all
            monkeypatch.setenv("MAIL_PASSWORD", "guess")
            with pytest.raises(NoticeError, match="refuses user name or password"):
                await receivers_of(site)["mail"].send(people_notice())
            strict = site_of(tmp_path, text.replace('ca = "ca.pem"\n', ""))
            with pytest.raises(NoticeError, match="its certificate is refused"):
                await receivers_of(strict)["web_hook"].send(people_notice())
    finally:
        server.stop()


async def test_what_the_wire_cannot_carry_is_said_before_it_is_sent(
    hook: HookServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SECRET", "pässword")
    login = 'security = "none"\nusername = "edge"\npassword_variable = "SECRET"\n'
    with pytest.raises(NoticeError, match="other characters than ASCII") as said:
        receivers_of(site_of(tmp_path, mail_table(25, login)))
    assert "pässword" not in str(said.value)
    for token in ("t0kän", "t0\nken"):
        (tmp_path / "token").write_text(token)
        with pytest.raises(NoticeError, match="characters that a header cannot carry"):
            receivers_of(site_of(tmp_path, hook_table(hook.port, 'token_file = "token"\n')))
    # a host that is no name is told at once, not after the time for a whole mail
    monkeypatch.setattr(mail, "PATIENCE", 3600.0)
    odd = mail_table(25).replace('host = "127.0.0.1"', 'host = "mail..example"')
    with pytest.raises(NoticeError, match="is not a host name; check host"):
        await receivers_of(site_of(tmp_path, odd))["mail"].send(people_notice())


async def test_a_number_that_is_none_holds_nothing_up(hook: HookServer, tmp_path: Path) -> None:
    odd = replace(finding(), swing_period_s=float("nan"), weight=float("inf"))
    async with People(site_of(tmp_path, hook_table(hook.port))).running() as people:
        people.notifying.put(odd)
        people.notifying.put(finding(2))
        await people.until_delivered("web_hook", 2)
    assert hook.posts[0][1]["detail"]["swing_period_s"] is None


async def test_a_notice_that_cannot_be_sent_at_all_is_given_up(
    hook: HookServer, tmp_path: Path
) -> None:
    people = People(site_of(tmp_path, hook_table(hook.port)))
    send, broken = people.notifying._receivers["web_hook"].send, ValueError("a defect")

    async def stumble(notice: Notice) -> str:
        if notice.subject.endswith("-1"):
            raise broken
        return await send(notice)

    people.notifying._receivers["web_hook"].send = stumble  # type: ignore[method-assign]
    async with people.notifying.running():
        people.notifying.put(finding(1))
        people.notifying.put(finding(2))
        for number in range(1, QUICK.attempts + 1):
            await until(lambda n=number: len(people.told.defects) >= n, "an attempt")  # type: ignore[misc]
            people.now_ms += 1000
        await people.until_delivered("web_hook", 1)
    assert people.told.defects == [broken] * QUICK.attempts


async def test_a_damaged_outbox_is_replaced_whenever_the_damage_is_met(
    hook: HookServer, tmp_path: Path
) -> None:
    site = site_of(tmp_path, "per_hour = 1000\n" + hook_table(hook.port))
    file = tmp_path / "data/notices.sqlite"
    async with People(site).running() as people:
        for number in range(20):
            people.notifying.put(finding(number))
        await people.until_delivered("web_hook", 20)
    whole = file.read_bytes()
    number = 100
    for page in range(4096, len(whole), 4096):
        damaged = whole[:page] + bytes(4096) + whole[page + 4096 :]
        for at_run_time in (False, True):
            file.write_bytes(whole if at_run_time else damaged)
            async with People(site).running() as people:
                number += 1
                people.notifying.put(finding(number))
                await people.until_delivered("web_hook", 1)
                if at_run_time:
                    file.write_bytes(damaged)
                people.notifying.put(finding(number + 1000))
                await people.until_delivered("web_hook", 2)
    assert list(tmp_path.glob("data/notices.damaged-*.sqlite"))


async def test_an_address_that_is_refused_beside_others_is_told(
    mails: tuple[Mails, MailServer], tmp_path: Path
) -> None:
    taken, server = mails
    taken.unknown = {"b@mill.example"}
    async with People(site_of(tmp_path, mail_table(server.port))).running() as people:
        people.notifying.put(finding())
        await until(lambda: "notice.refused" in people.told.kinds(), "the event")
    assert [mail.rcpt_tos for mail in taken.taken] == [["a@mill.example"]]
    (said,) = [said for kind, _, said in people.told.events if kind == "notice.refused"]
    assert said.endswith("takes no mail for b@mill.example (SMTP 550); correct notify.mail.to")
    command = ["notify", "test", str(tmp_path / "site.toml")]
    result = await asyncio.to_thread(CliRunner().invoke, app, command)
    assert result.exit_code == 1
    assert "b@mill.example (SMTP 550)" in result.output
    assert len(taken.taken) == 2


async def test_a_secret_that_is_put_right_is_used_for_the_next_attempt(
    hook: HookServer, tmp_path: Path
) -> None:
    (tmp_path / "token").write_text("old\n")
    hook.status = 401
    people = People(site_of(tmp_path, hook_table(hook.port, 'token_file = "token"\n')))
    async with people.running():
        people.notifying.put(finding())
        await until(lambda: people.report("web_hook").failed == 1, "a refusal")
        (tmp_path / "token").write_text("new\n")
        hook.status = 200
        people.now_ms += 1000
        await people.until_delivered("web_hook", 1)
    assert [headers["authorization"] for headers, _ in hook.posts] == ["Bearer old", "Bearer new"]


async def test_starttls_is_never_left_out(mails: tuple[Mails, MailServer], tmp_path: Path) -> None:
    taken, server = mails
    site = site_of(tmp_path, mail_table(server.port, ""))
    with pytest.raises(NoticeError, match=r"does not offer what notify\.mail asks for"):
        await receivers_of(site)["mail"].send(people_notice())
    assert taken.taken == []


def test_the_command_tries_every_receiver(mails: tuple[Mails, MailServer], tmp_path: Path) -> None:
    taken, server = mails
    with socket.create_server(("127.0.0.1", 0)) as held:
        closed = held.getsockname()[1]
    site_of(tmp_path, hook_table(closed) + mail_table(server.port))
    result = CliRunner().invoke(app, ["notify", "test", str(tmp_path / "site.toml"), "--json"])
    assert result.exit_code == 1
    rows: list[Mapping[str, Any]] = json.loads(result.output)
    assert [(row["receiver"], row["delivered"]) for row in rows] == [
        ("web_hook", False),
        ("mail", True),
    ]
    assert "connection refused" in rows[0]["problem"]
    assert b"nothing has happened" in taken.taken[0].content  # type: ignore[operator]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no receiver is named; add the table web_hook or mail"),
        ('[notify.web_hook]\nurl = "mailto:x"\n', "url is not a web address"),
        (
            '[notify.web_hook]\nurl = "http://far.example/x"\ntoken_variable = "T"\n',
            "the token or password would cross the network unencrypted",
        ),
        (
            '[notify.web_hook]\nurl = "http://me:word@far.example/x"\n',
            "the token or password would cross the network unencrypted",
        ),
        (
            'page = "https://edge.example/pages?a=b"\n' + hook_table(80),
            "links begin with it",
        ),
        (mail_table(25, 'security = "none"\n').replace("a@", "a "), "is not a mail address"),
        (mail_table(25).replace("a@", "ä@"), "is not a mail address; write NAME@HOST in ASCII"),
        (mail_table(25).replace("a@", "a..b@"), "is not a mail address"),
        (
            mail_table(25, 'username = "edge"\n'),
            "username and a password belong together",
        ),
        (
            '[notify.web_hook]\nurl_file = "none"\n',
            "there is no file",
        ),
    ],
)
def test_a_table_that_cannot_work_is_refused_with_its_line(
    tmp_path: Path, text: str, said: str
) -> None:
    with pytest.raises(SiteError, match=said):
        site_of(tmp_path, text)


def test_a_secret_that_is_not_there_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NO_TOKEN", raising=False)
    site = site_of(tmp_path, hook_table(80, 'token_variable = "NO_TOKEN"\n'))
    with pytest.raises(NoticeError, match="the environment variable NO_TOKEN is not set"):
        receivers_of(site)
