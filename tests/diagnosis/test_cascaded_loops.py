"""A slave under its master: what the set-point gives it, and what enters by itself."""

from __future__ import annotations

import numpy as np
import pytest

from fieldlink.diagnosis import Diagnosis, LoopSignals, diagnose, find_groups

N, WARM = 1600, 400
PERIOD_S = 100.0


def cascade(*, inner_load: float, outer_load: float) -> dict[str, LoopSignals]:
    """A temperature that sets a flow, with sinusoidal loads of either, in scans of 1 s."""
    rng = np.random.default_rng(1)
    wave = np.sin(2.0 * np.pi * np.arange(N + WARM) / PERIOD_S)
    out = np.empty((5, N + WARM))
    flow = heat = u_i = u_o = 0.0
    e_i = e_o = 0.0
    drift = 0.0
    for k in range(N + WARM):
        pv_o, pv_i = heat + 0.03 * rng.standard_normal(), flow + 0.05 * rng.standard_normal()
        drift = 0.97 * drift + 0.1 * rng.standard_normal()
        now = -pv_o
        u_o, e_o = u_o + 1.8 * (now - e_o + now / 60.0), now
        now = u_o - pv_i
        u_i, e_i = u_i + 0.8 * (now - e_i + now / 3.0), now
        out[:, k] = u_o, pv_o, u_i, pv_i, u_o
        flow += (u_i + inner_load * wave[k] + drift - flow) / 3.0
        heat += (flow + outer_load * wave[k] - heat) / 60.0
    op_o, pv_o, op_i, pv_i, sp_i = out[:, WARM:] + 50.0
    return {
        "TC1": LoopSignals(op_o, pv_o, np.full(N, 50.0), 1.0),
        "FC1": LoopSignals(op_i, pv_i, sp_i, 1.0),
    }


def judged(signals: dict[str, LoopSignals]) -> dict[str, Diagnosis]:
    return {
        name: diagnose(one.op, one.pv, one.sp, period=1.0, advice=False)
        for name, one in signals.items()
    }


def test_a_slave_that_follows_its_master_is_told_to_look_there() -> None:
    first = judged(cascade(inner_load=0.0, outer_load=8.0))["FC1"].first
    assert first.name == "external_oscillation"
    assert "the set-point itself oscillates" in first.evidence[0]
    assert "master" in first.action


def test_a_wave_that_enters_the_slave_is_not_laid_on_its_master() -> None:
    signals = cascade(inner_load=8.0, outer_load=0.0)
    found = judged(signals)
    first = found["FC1"].first
    assert first.name == "external_oscillation"
    assert "from outside explains PV better" in first.evidence[0]
    assert "a master that answers this loop swings with it" in first.evidence[-1]
    assert "Look at what gives the set-point" not in first.action
    # sixteen periods: two loops apart could swing alike by chance, master and slave do not
    (group,) = find_groups(signals, found)
    assert set(group.loops) == {"TC1", "FC1"}
    assert group.period_s == pytest.approx(PERIOD_S, rel=0.03)
