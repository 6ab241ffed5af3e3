"""What a shipped scenario's first window shows of its valve, whatever the noise."""

from __future__ import annotations

import numpy as np
import pytest

from fieldlink.lab.rehearse import find_scenario, load_scenario, rehearse

FILE = load_scenario(find_scenario("compensated"))
VALVE = FILE.scenario.valve


def first_window(seed: int) -> tuple[float, float]:
    """S and J that the daemon finds in the first window under another noise."""
    window = rehearse(FILE.changed(seed=seed, duration=620)).course.windows[0]
    return window.stick_band.value, window.slip_jump.value


@pytest.mark.thorough
def test_the_valve_is_found_under_twenty_noises() -> None:
    """S trades against the dead time, and valves of nearly the same slips lie in narrow valleys."""
    found = np.array([first_window(seed) for seed in range(1, 21)])
    band, jump = VALVE.stick_band[0][1], VALVE.slip_jump[0][1]
    assert np.abs(found[:, 0] / band - 1.0).max() < 0.02
    assert np.abs(found[:, 1] / jump - 1.0).max() < 0.1
