"""The daemon's estimator with the changes that a scenario or a defect makes to its findings."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace

from fieldlink.daemon import Estimate, Findings, Interval
from fieldlink.daemon.estimation.estimating import EstimateRequest, estimate
from fieldlink.lab.rehearse.happenings import Misestimate
from fieldlink.lab.rehearse.injected_defects import Defect
from fieldlink.lab.rehearse.models import Scenario
from loop_model import LoopModel, ValveModel

__all__ = ["RehearsalEstimator"]

_CALLED = {
    Defect.ALWAYS_STICTION: "stiction",
    Defect.NEVER_STICTION: "no_stiction",
}


class RehearsalEstimator:
    """An `Estimator` in the caller's process.

    Args:
        scenario: says when the findings are to be wrong.
        defect: what is broken on purpose.
        now: returns the plant second.
    """

    def __init__(self, scenario: Scenario, defect: Defect | None, now: Callable[[], float]) -> None:
        self._scenario = scenario
        self._defect = defect
        self._now = now

    async def run(self, request: EstimateRequest) -> Estimate:
        """Return the outcome."""
        await asyncio.sleep(0)
        result = estimate(request)
        if result.findings is None:
            return result
        findings = result.findings
        for wrong in self._scenario.misestimate:
            if wrong.covers(self._now()):
                findings = _misestimated(findings, wrong)
        return replace(result, findings=_broken(findings, self._defect))


def _misestimated(found: Findings, wrong: Misestimate) -> Findings:
    S = _scaled(found.stick_band, wrong.stick_band_factor)
    J = _scaled(found.slip_jump, wrong.slip_jump_factor)
    J = Interval(*(min(value, S.value) for value in (J.value, J.low, J.high)))
    model = found.model
    if model is not None:
        process = replace(model.process, b=tuple(wrong.gain_factor * b for b in model.process.b))
        model = LoopModel(ValveModel(stick_band=S.value, slip_jump=J.value), process)
    return replace(
        found,
        stick_band=S,
        slip_jump=J,
        static_friction=_combined(S, J, 1.0),
        dynamic_friction=_combined(S, J, -1.0),
        model=model,
    )


def _broken(found: Findings, defect: Defect | None) -> Findings:
    if defect is Defect.WRONG_SCALE and found.verdict == "stiction":
        half_more = Misestimate(begin=0.0, end=1.0, stick_band_factor=1.5, slip_jump_factor=1.5)
        return _misestimated(found, half_more)
    if defect is Defect.NEVER_UNSURE and found.verdict == "not_assessable":
        return replace(found, verdict="no_stiction")
    if defect in _CALLED and found.verdict != "not_assessable":
        return replace(found, verdict=_CALLED[defect])
    return found


def _scaled(interval: Interval, factor: float) -> Interval:
    return Interval(interval.value * factor, interval.low * factor, interval.high * factor)


def _combined(S: Interval, J: Interval, sign: float) -> Interval:
    """Half of S + J or S - J; its interval is as wide as the two allow."""
    value = 0.5 * (S.value + sign * J.value)
    ends = [0.5 * (s + sign * j) for s in (S.low, S.high) for j in (J.low, J.high)]
    return Interval(value, max(0.0, min(ends)), max(ends))
