"""Whether a PLC takes OP: what is late, limited or rounded follows, what goes its own way not."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from fieldlink.compensate.op_watch import OpWatch

PATIENCE = 10


def scans_until_blamed(plc: Callable[[float, float], float], scans: int = 300) -> int | None:
    """Write moves and rests as a compensator does; ``plc(OP now, written)`` gives the next OP."""
    watch = OpWatch(100.0, PATIENCE)
    op, shown = 50.0, 50.0
    for k in range(scans):
        if not watch.look(shown):
            return k
        op = 50.0 + 12.0 * (k // 25 % 2) + 3.0 * (k % 25 == 0)
        watch.wrote(op)
        shown = plc(shown, op)
    return None


def test_a_plc_that_takes_op_is_not_blamed() -> None:
    late: list[float] = [50.0]

    def a_scan_late(_: float, written: float) -> float:
        late.append(written)
        return late[-2]

    assert scans_until_blamed(lambda _, written: written) is None
    assert scans_until_blamed(a_scan_late) is None
    assert scans_until_blamed(lambda _, written: round(written)) is None
    limited = scans_until_blamed(lambda op, w: op + max(-0.5, min(0.5, w - op)))
    assert limited is None


@pytest.mark.parametrize("start", [30.0, 55.0, 90.0])
def test_a_plc_that_goes_its_own_way_is_blamed_after_some_scans(start: float) -> None:
    for slope in (0.0, 0.2):
        found = scans_until_blamed(lambda op, _, slope=slope: max(op, start) + slope)  # type: ignore[misc]
        assert found is not None
        assert found > PATIENCE


def test_where_nothing_was_written_there_is_nothing_to_follow() -> None:
    watch = OpWatch(100.0, PATIENCE)
    watch.wrote(50.0)
    for _ in range(5):
        assert watch.look(70.0)
    watch.wrote_nothing()
    assert all(watch.look(70.0) for _ in range(50))
