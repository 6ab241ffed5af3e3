from __future__ import annotations

from pathlib import Path

import pytest

from fieldlink.links import (
    LinkState,
    Quality,
    RecordingEndedError,
    SteppedLink,
    UnknownLinkKindError,
    VirtualClock,
    link_kinds,
    open_link,
    register_link,
    registry,
)
from fieldlink.site import Site, load_site

SITE = """
[site]
name = "archive"

[devices.archive]
link = "recording"

[loops.FC101]
device = "archive"
op = "FC101.OP"
pv = "FC101.PV"
mode = "FC101.MODE"
period = 2.0
[loops.FC101.plant]
recording = "rows.csv"
"""


@pytest.fixture
def site(tmp_path: Path) -> Site:
    rows = "\n".join(f"{k},{2 * k if k != 3 else ''},{int(k != 4)}" for k in range(60))
    (tmp_path / "rows.csv").write_text(f"op,pv,auto\n{rows}\n")
    (tmp_path / "site.toml").write_text(SITE)
    return load_site(tmp_path / "site.toml")


async def test_a_recording_is_played_row_by_row_and_once(site: Site) -> None:
    clock = VirtualClock()
    link = open_link(site, "archive", clock)
    assert isinstance(link, SteppedLink)
    await link.open()
    assert link.scan_period == 2.0
    scans = [await link.scan() for _ in range(60)]
    assert [scan["FC101.OP"].value for scan in scans] == list(range(60))
    assert scans[3]["FC101.PV"].quality is Quality.NOT_A_NUMBER
    assert scans[2]["FC101.PV"].value == 4.0
    assert [k for k, scan in enumerate(scans) if not scan["FC101.MODE"].good] == [4]
    ended = await link.scan()
    assert not ended.answered
    assert isinstance(ended.failures[0], RecordingEndedError)
    assert "rows.csv" in str(ended.failures[0])
    assert link.state is LinkState.DEMOTED
    await link.close()


def test_a_kind_that_nobody_registered_is_named(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "_FACTORIES", {})
    register_link("one", lambda *_: pytest.fail("not built"))
    assert link_kinds() == ("one",)
    with pytest.raises(UnknownLinkKindError, match="'recording' is not known; use one of: one"):
        open_link(site, "archive")
