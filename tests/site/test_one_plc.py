"""Two devices of a site file that are one PLC under two names."""

from __future__ import annotations

from pathlib import Path

import pytest

from fieldlink.site import SiteError, load_site

LOOP = """
[devices.{device}]
link = "{link}"
host = "{host}"
register_map = "{map}"
{opcua}
[loops.{device}1]
device = "{device}"
op = "OP"
pv = "PV"
period = 1.0
[loops.{device}1.writeback]
enabled = true
loop_id = {number}
base = 100
"""


def write(folder: Path, link: str, hosts: tuple[str, str]) -> Path:
    (folder / "map.csv").write_text("tag,address,type\nOP,0,float32\nPV,2,float32\n")
    (folder / "nodes.csv").write_text("tag,node\nOP,ns=1;s=OP\nPV,ns=1;s=PV\n")
    is_opcua = link == "opcua"
    text = '[site]\nname = "x"\n' + "".join(
        LOOP.format(
            device=f"d{number}",
            link=link,
            host=host,
            number=number,
            map="nodes.csv" if is_opcua else "map.csv",
            opcua=f'[devices.d{number}.opcua]\nexchange_node = "ns=1;s=E"' if is_opcua else "",
        )
        for number, host in enumerate(hosts, 1)
    )
    (folder / "site.toml").write_text(text)
    return folder / "site.toml"


@pytest.mark.parametrize("link", ["modbus-tcp", "opcua"])
@pytest.mark.parametrize(
    "hosts",
    [
        ("127.0.0.1", "localhost"),
        ("LocalHost", "::1"),
        ("PLC.example", "plc.example."),
        ("fe80::1", "FE80:0::1"),
    ],
)
def test_areas_of_one_plc_under_two_names_must_not_overlap(
    tmp_path: Path, link: str, hosts: tuple[str, str]
) -> None:
    with pytest.raises(SiteError, match="shares registers with"):
        load_site(write(tmp_path, link, hosts))


@pytest.mark.parametrize("hosts", [("127.0.0.1", "127.0.0.2"), ("plc1", "plc2")])
def test_different_names_are_different_plcs(tmp_path: Path, hosts: tuple[str, str]) -> None:
    assert len(load_site(write(tmp_path, "modbus-tcp", hosts)).devices) == 2
