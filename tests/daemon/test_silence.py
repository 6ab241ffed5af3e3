"""The words for a bad sample."""

from __future__ import annotations

import math

from fieldlink.daemon.sampling.silence import fault_of
from fieldlink.links import Quality, Reading, Scan
from fieldlink.site import Loop
from fieldlink.store import SampleRecord


def test_the_status_of_a_server_is_named() -> None:
    loop = Loop(device="plc", op="OP", pv="PV", period=1.0)
    bad = Reading(math.nan, Quality.BAD_STATUS, 0.0, 0.0, status="BadSensorFailure")
    scan = Scan({"OP": Reading(50.0, Quality.GOOD, 0.0, 0.0), "PV": bad}, 0.0, 0.0, 1, (), False)
    code = Quality.BAD_STATUS.code
    sample = SampleRecord("L", 0, 0, op=50.0, pv=math.nan, sp=None, auto=None, quality=code)
    assert fault_of(sample, loop, scan) == (
        "PV: the server gives no good status with the value: look at its diagnostics "
        "(status BadSensorFailure)"
    )
