"""The way of a set-point, against the sum of all its changes that count."""

from __future__ import annotations

import random

import pytest

from compensator.supervising.setpoint_way import SetpointWay


@pytest.mark.parametrize("seed", range(20))
def test_all_changes_count_out_of_reach_and_the_latest_ones_within(seed: int) -> None:
    drawn = random.Random(seed)
    scans = drawn.randint(1, 12)
    way, counted, out = SetpointWay(scans), list[float](), False
    for _ in range(300):
        out ^= drawn.random() < 0.1
        change, error = drawn.uniform(-1.0, 1.0), drawn.uniform(-5.0, 5.0)
        way.push(change, out_of_reach=out)
        counted.append(change)
        if not out:
            counted = counted[-scans:]
        total = sum(counted)
        explained = 1.1 * abs(total) if total * error < 0.0 else 0.0
        assert way.explains(error) == pytest.approx(explained, abs=1e-9)
