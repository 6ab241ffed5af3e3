from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fieldlink.daemon.sampling.slot_placing import BeatPlacer, CounterPlacer, Place
from fieldlink.daemon.windows.window import LoopSample, Window


def sample(value: float) -> LoopSample:
    return LoopSample(op=value, pv=-value, sp=0.0, auto=1.0, utc=value)


def filled(slots: list[int], size: int) -> Window:
    window = Window(size)
    for slot in slots:
        window.put(slot, sample(float(slot)))
    return window


def test_samples_come_out_in_order_with_gaps_open() -> None:
    data = filled([0, 1, 3, 4], size=8).data()
    np.testing.assert_array_equal(data.op, [0, 1, np.nan, 3, 4])
    np.testing.assert_array_equal(data.pv, [0, -1, np.nan, -3, -4])
    assert (data.first_slot, data.last_slot, data.end_utc) == (0, 4, 4.0)


def test_the_oldest_samples_leave_a_full_window() -> None:
    window = filled(list(range(11)), size=4)
    assert window.is_full
    np.testing.assert_array_equal(window.data().op, [7, 8, 9, 10])


@given(
    st.lists(st.integers(min_value=1, max_value=12), min_size=1, max_size=40),
    st.integers(min_value=1, max_value=9),
)
def test_a_window_is_the_end_of_what_was_put(steps: list[int], size: int) -> None:
    slots = list(np.cumsum(steps))
    whole = np.full(int(slots[-1]) - int(slots[0]) + 1, np.nan)
    for slot in slots:
        whole[slot - slots[0]] = slot
    data = filled([int(slot) for slot in slots], size).data()
    np.testing.assert_array_equal(data.op, whole[-size:])


def test_put_counts_the_empty_slots_before_a_sample() -> None:
    window = Window(10)
    assert [window.put(slot, sample(0.0)) for slot in (5, 6, 9)] == [0, 0, 2]


def test_a_restarted_window_holds_only_what_came_after() -> None:
    window = filled([0, 1, 2, 3], size=4)
    window.restart()
    assert window.span == 0
    with pytest.raises(ValueError, match="empty"):
        window.data()
    assert window.put(6, sample(6.0)) == 2
    data = window.data()
    assert (data.first_slot, data.last_slot) == (4, 6)
    assert np.isnan(data.op[:2]).all()
    assert data.op[2] == 6.0


@pytest.mark.parametrize("slot", [3, 2])
def test_a_slot_is_not_filled_twice(slot: int) -> None:
    with pytest.raises(ValueError, match="not after"):
        filled([3], size=4).put(slot, sample(0.0))


def test_good_share_counts_gaps_and_bad_values() -> None:
    window = filled([0, 1, 3], size=4)
    assert window.good_share() == 0.75
    window.put(4, sample(math.nan))
    assert window.good_share() == 0.5


def test_signals_without_a_tag_are_absent() -> None:
    window = Window(4, has_sp=False, has_auto=False)
    window.put(0, sample(1.0))
    data = window.data()
    assert data.sp is None
    assert data.auto is None


def places(placer: BeatPlacer | CounterPlacer, reads: list[tuple[float, float]]) -> list[object]:
    placed = [placer.place(now, counter) for now, counter in reads]
    return [None if p.place is Place.DUPLICATE else p.slot for p in placed]


def test_beats_tell_slots_from_the_time() -> None:
    reads = [(t, 0.0) for t in (100.0, 101.0, 101.4, 102.0, 105.0)]
    assert places(BeatPlacer(1.0), reads) == [0, 1, None, 2, 5]


def test_beats_do_not_drift_with_rounding() -> None:
    placer = BeatPlacer(0.1)
    assert [placer.place(0.1 * k, 0.0).slot for k in range(1000)] == list(range(1000))


def test_polling_twice_a_period_finds_every_count_once() -> None:
    reads = [(0.5 * k + 0.2 * math.sin(k), float(500 + k // 2)) for k in range(40)]
    slots = [slot for slot in places(CounterPlacer(1.0), reads) if slot is not None]
    assert slots == list(range(500, 520))


def test_a_jump_of_the_counter_is_a_gap() -> None:
    reads = [(0.0, 10.0), (1.0, 11.0), (4.0, 14.0)]
    assert places(CounterPlacer(1.0), reads) == [10, 11, 14]


def test_a_counter_wraps() -> None:
    reads = [(0.0, 65534.0), (1.0, 65535.0), (2.0, 0.0), (4.0, 2.0)]
    assert places(CounterPlacer(1.0, modulus=65536), reads) == [65534, 65535, 65536, 65538]


@pytest.mark.parametrize("modulus", [65536.0, math.inf])
def test_a_counter_that_started_again_leaves_a_gap_as_long_as_the_time(modulus: float) -> None:
    placer = CounterPlacer(1.0, modulus)
    placer.place(0.0, 30_000.0)
    placed = placer.place(20.0, 3.0)
    assert (placed.slot, placed.place) == (30_020, Place.RESTARTED)
    assert placer.place(21.0, 4.0).slot == 30_021
