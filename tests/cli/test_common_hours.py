"""What is told where loops were not recorded in the same hours."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fieldlink.common_hours import clock_notes
from fieldlink.diagnosis import LoopSignals

HOUR = 3600.0


def record(start_s: float) -> LoopSignals:
    """Two hours at 10 s from then on."""
    op = np.zeros(720)
    return LoopSignals(op, op, None, 10.0, start_s)


def notes(**starts: float) -> tuple[str, ...]:
    return clock_notes({name: record(start) for name, start in starts.items()})


def test_shared_hours_need_no_note() -> None:
    assert notes(A=0.0, B=HOUR) == ()
    assert notes(A=0.0) == ()


def test_a_loop_of_another_day_is_named() -> None:
    (told,) = notes(A=0.0, B=HOUR, C=24.0 * HOUR)
    assert told.startswith("C shares no hours")


def test_no_hours_in_common_at_all() -> None:
    (told,) = notes(A=0.0, B=24.0 * HOUR, C=48.0 * HOUR)
    assert told.startswith("no two loops share any hours")


def test_a_chain_of_hours_leaves_its_ends_unasked() -> None:
    (told,) = notes(A=0.0, B=1.5 * HOUR, C=3.0 * HOUR)
    assert told.startswith("A and C share no hours")


@pytest.mark.parametrize("other", [math.nan, 5.0 * HOUR])
def test_a_record_without_a_date_is_taken_to_start_with_the_others(other: float) -> None:
    (told,) = notes(A=math.nan, B=other)
    assert "no date and time" in told
    assert ("A" in told) == math.isfinite(other)
