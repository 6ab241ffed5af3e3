"""Loops that swing together, at different sampling and with gaps, and the source among them."""

from __future__ import annotations

import numpy as np

from estimator.diagnosis.cascades import find_cascades
from fieldlink.diagnosing import Plant
from fieldlink.diagnosis import LoopSignals, diagnose, find_groups
from fieldlink.diagnosis_pictures import group_figure
from tests.closed_loop import Loop, run


def signals(loop: Loop, every: int = 1) -> LoopSignals:
    return LoopSignals(loop.op[::every], loop.pv[::every], loop.sp[::every], float(every))


def test_the_sticky_valve_is_the_source_of_what_it_moves() -> None:
    source = run(band=6.0, jump=4.0, seed=1)
    follower = run(load=1.5 * (source.op - source.op.mean()), lag=20.0, seed=2)
    apart = run(seed=3)
    loops = {"A": signals(source), "B": signals(follower, 2), "C": signals(apart)}
    assert loops["B"].pv is not None
    loops["B"].pv[100:115] = np.nan
    found = {
        name: diagnose(one.op, one.pv, one.sp, period=one.period, advice=False)
        for name, one in loops.items()
    }
    groups = find_groups(loops, found)
    assert [group.loops for group in groups] == [("A", "B")]
    assert groups[0].candidates[0].loop == "A"
    assert sum(one.weight for one in groups[0].candidates) <= 1.0 + 1e-9
    picture = group_figure(Plant(found, groups, {}, loops), groups[0], title="mill")
    assert [axes.get_ylabel().split()[0] for axes in picture.axes] == ["A", "B"]


def test_loops_that_swing_each_for_themselves_are_no_group() -> None:
    k = np.arange(1500)
    waves = {period: 4.0 * np.sin(2.0 * np.pi * k / period) for period in (52, 70)}
    loops = {str(seed): signals(run(seed=seed)) for seed in (4, 5)}
    loops |= {f"wave {p}": signals(run(seed=p, load=wave)) for p, wave in waves.items()}
    found = {name: diagnose(one.op, one.pv, one.sp, advice=False) for name, one in loops.items()}
    assert find_groups(loops, found) == ()


def test_a_cascade_is_read_off_the_data() -> None:
    master = run(seed=7, lag=60.0, integral_time=60.0)
    slave = run(seed=8, sp=0.5 * (master.op - 50.0), lag=4.0, dead=1, integral_time=4.0)
    found = find_cascades({"master": signals(master), "slave": signals(slave)})
    assert [(one.master, one.slave) for one in found] == [("master", "slave")]
