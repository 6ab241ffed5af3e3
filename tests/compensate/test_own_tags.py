"""The compensator reads its own loop's tags, all of them in every scan, and no other loop's."""

from __future__ import annotations

import struct
from pathlib import Path

from fieldlink.compensate.service import CompensateService, Verdict
from fieldlink.site import load_site
from fieldlink.site.check_report import check
from tests.links.fake_device import FakeDevice

MAP = """\
tag,address,type,every,writable
A.OP,0,float32,,yes
A.PV,2,float32,,
A.SP,4,float32,60,
A.MODE,6,uint16,60,
B.OP,320,float32,,
B.PV,322,float32,,
"""
SITE = """\
[site]
name = "test"
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
port = {port}
register_map = "map.csv"
[loops.A]
device = "plc"
op = "A.OP"
pv = "A.PV"
sp = "A.SP"
{mode}
period = 1.0
[loops.A.writeback]
base = 100
loop_id = 7
[loops.A.compensate]
enabled = true
op_out = "A.OP"
[loops.B]
device = "plc"
op = "B.OP"
pv = "B.PV"
period = 1.0
"""


async def test_the_mode_is_of_this_scan_and_other_loops_are_left_alone(tmp_path: Path) -> None:
    """A mode of up to a minute ago let OP be written while an operator had the loop, and registers
    of other loops that do not answer kept this one from being read.
    """
    device = FakeDevice()
    await device.start()
    for address, value in ((0, 50.0), (2, 51.0), (4, 52.0)):
        device.words[address : address + 2] = struct.unpack(">HH", struct.pack(">f", value))
    device.words[6] = 1
    (tmp_path / "map.csv").write_text(MAP)
    (tmp_path / "site.toml").write_text(SITE.format(port=device.port, mode='mode = "A.MODE"'))
    service = CompensateService(load_site(tmp_path / "site.toml"), "A")
    try:
        assert (await service.step(0.0)).verdict is Verdict.NO_MODEL
        device.words[6] = 0
        device.words[4:6] = struct.unpack(">HH", struct.pack(">f", 60.0))
        step = await service.step(1.0)
        assert step.verdict is Verdict.MANUAL
        assert step.sp == 60.0
        assert not any(first + count - 1 >= 320 for _, first, count in device.requests)
    finally:
        await service.close()
        await device.stop()


def test_check_warns_of_a_compensator_that_cannot_see_manual(tmp_path: Path) -> None:
    (tmp_path / "map.csv").write_text(MAP)
    for mode, warned in (("", True), ('mode = "A.MODE"', False)):
        (tmp_path / "site.toml").write_text(SITE.format(port=502, mode=mode))
        warnings = " ".join(check(load_site(tmp_path / "site.toml")).warnings)
        assert ("would write OP in manual" in warnings) is warned
