"""The demonstration's report shows the window that its block comes from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from fieldlink.daemon import Estimate, EstimateOutcome, Findings, Interval
from fieldlink.daemon.writeback.candidate import Agreement
from fieldlink.lab.demo.judged_windows import JudgedWindows


def estimate(first_slot: int, findings: Findings | None) -> Estimate:
    outcome = EstimateOutcome.TIMED_OUT if findings is None else EstimateOutcome.ESTIMATED
    return Estimate("FC101", first_slot, first_slot + 599, 0.0, outcome, "", findings)


def test_a_block_accepted_after_the_next_estimate_keeps_its_own_window(
    findings: Callable[..., Findings],
) -> None:
    """On a busy machine the PLC answers late, and a newer window has been judged meanwhile."""
    written, newer = findings(stick_band=10.99), findings(stick_band=11.02)
    windows = JudgedWindows()
    for moment in (estimate(0, None), estimate(10, written), estimate(610, newer)):
        windows.note(moment)
    assert windows.slots_of(written) == (10, 609)
    assert windows.slots_of(newer) == (610, 1209)
    assert windows.slots_of(findings()) is None


def test_the_surest_of_the_windows_that_agree_is_the_one_shown(
    findings: Callable[..., Findings],
) -> None:
    surest = findings(stick_band=7.0)
    vague = replace(findings(stick_band=7.1), stick_band=Interval(7.1, 5.0, 9.0))
    agreement, windows = Agreement(2), JudgedWindows()
    for first, found in ((10, surest), (610, vague)):
        windows.note(estimate(first, found))
        agreement.count(found)
    assert windows.slots_of(agreement.as_surest(vague)) == (10, 609)
