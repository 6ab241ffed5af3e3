"""A process whose gain changes with PV: heat losses, dilution, neutralisation."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.arrays import Array
from estimator.diagnosis.pv_curves import PvCurve
from fieldlink.diagnosis import Diagnosis, diagnose


def drawn(seed: int, *, spreads: float = 0.0, noise_grows: bool = False) -> Diagnosis:
    """A lag of 8 scans under PI and set-point steps; ``spreads``: e-foldings of its gain over PV.

    PV goes from -20 to 20; its curve is ``-ln(1 - k x) / k`` of the lag's state x: the gain from OP
    is ``exp(k PV)``.
    """
    rng = np.random.default_rng(seed)
    k = spreads / 40.0
    n = 1200
    sp = np.repeat(rng.uniform(-20.0, 20.0, n // 20), rng.integers(30, 90, n // 20))[:n]
    noise = 0.1 * rng.standard_normal(n)
    if noise_grows:
        noise *= 1.0 + 4.0 * (sp + 20.0) / 40.0
    load = np.cumsum(rng.standard_normal(n)) * 0.05
    op, pv = np.empty(n), np.empty(n)
    state, moved, last, u = 0.0, 0.0, 0.0, 50.0
    for at in range(n):
        state += (moved + load[at] - state) / 8.0
        pv[at] = (-np.log(1.0 - k * state) / k if k else state) + noise[at]
        error = sp[at] - pv[at]
        u += 1.2 * (error - last + error / 8.0)
        last, op[at], moved = error, u, u - 50.0
    return diagnose(op, pv, sp, period=1.0, advice=False, figures=False)


@pytest.mark.parametrize("seed", [4, 10])
def test_a_gain_that_grows_with_pv_is_told_with_what_to_do(seed: int) -> None:
    first = drawn(seed, spreads=1.6).first
    assert first.name == "characteristic"
    assert "over PV's middle nine tenths and is higher at high PV" in first.evidence[0]
    assert "schedule the gain over PV" in first.action
    assert "positioner" not in first.action


def test_noise_that_grows_with_pv_is_no_curve() -> None:
    names = {cause.name for cause in drawn(3, noise_grows=True).causes}
    assert "characteristic" not in names


@pytest.mark.parametrize(
    "curve", [PvCurve(0.7, False, 2.0), PvCurve(-0.7, False), PvCurve(0.7, True, -1.0)]
)
def test_a_curve_leads_back_and_its_slope_is_its_derivative(curve: PvCurve) -> None:
    pv: Array = np.linspace(-2.0, 1.4, 35)
    straight = curve.straighten(pv)
    assert curve.bend(straight) == pytest.approx(pv)
    step = 1e-6
    slope = (curve.straighten(pv + step) - curve.straighten(pv - step)) / (2.0 * step)
    assert np.exp(curve.log_slope(pv)) == pytest.approx(slope, rel=1e-6)


def test_a_curve_in_units_of_pv_has_the_same_slopes() -> None:
    scaled = PvCurve(0.5, True, 0.3)
    pv = np.linspace(10.0, 30.0, 9)
    assert scaled.in_units(20.0, 4.0).log_slope(pv) == pytest.approx(
        scaled.log_slope((pv - 20.0) / 4.0)
    )
