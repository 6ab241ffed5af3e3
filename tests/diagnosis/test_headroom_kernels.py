"""The compiled parts of the headroom, against NumPy's roots and the linear loop's margins."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.algebra import is_stable
from estimator.controller.controller import Controller
from estimator.diagnosis.delay_loops import INSIDE, sensitivities
from estimator.diagnosis.innovations import poles_product, power_of_load, whitening_numerator
from estimator.diagnosis.linear_loop import TURNS, LinearLoop
from estimator.diagnosis.tuning_rules import simc, simc_lag
from loop_model import ProcessModel
from tests.seeds import in_suite

PI = Controller("PI", 0.8, 12.0, 0.0, 0.8 / 12.0, 0.0, "error", 0, 1.0, True)


@pytest.mark.parametrize("draws", in_suite(1, [100, 300]))
@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_numerator_has_the_spectrum_of_load_plus_noise(count: int, draws: int) -> None:
    rng = np.random.default_rng(count)
    frequencies = np.geomspace(1e-5, 0.5, 200)
    z = np.exp(-2j * np.pi * frequencies)
    for _ in range(draws):
        # lags of a third of a sample to 10,000, two of them alike, or an integrator
        poles = np.exp(-np.exp(-rng.uniform(-1.0, 9.0, count)))
        poles[-1] = rng.choice([poles[0], poles[-1], 1.0])
        noise, white = np.exp(rng.uniform(-10.0, 6.0, 2))
        # a white load passes a process: without one it is noise
        white = white if count > 1 else 0.0
        numerator = whitening_numerator(poles, noise, white)
        denominator = poles_product(poles)
        beside = 1.0 / power_of_load(denominator)
        poles_of = np.prod(
            (1.0 - poles[:, None]) ** 2 + 4.0 * poles[:, None] * np.sin(np.pi * frequencies) ** 2,
            axis=0,
        )
        corner = (1.0 - poles[0]) ** 2 + 4.0 * poles[0] * np.sin(np.pi * frequencies) ** 2
        wanted = noise * poles_of + beside
        if count > 1:
            wanted += white / power_of_load(poles_product(poles[1:])) * corner
        found = np.abs(np.polyval(numerator[::-1], z)) ** 2
        assert found / found[-1] == pytest.approx(wanted / wanted[-1], rel=1e-4)
        assert numerator[0] == 1.0
        assert np.abs(np.roots(numerator)).max() < 1.0


def test_a_load_of_one_pole_has_the_numerator_of_the_textbook() -> None:
    # 1 + theta q^-1 with theta / (1 + theta^2) = -a noise / ((1 + a^2) noise + 1 - a^2)
    pole, noise = 0.9, 0.3
    theta = whitening_numerator(np.array([pole]), noise, 0.0)[1]
    share = -pole * noise / ((1.0 + pole**2) * noise + 1.0 - pole**2)
    assert theta / (1.0 + theta**2) == pytest.approx(share, rel=1e-12)


def test_stability_is_that_of_the_roots() -> None:
    rng = np.random.default_rng(1)
    seen = {True: 0, False: 0}
    for _ in range(500):
        roots = rng.uniform(0.2, 1.1, 3) * np.exp(1j * rng.uniform(0.0, np.pi, 3))
        both = np.concatenate([roots, roots.conj(), rng.uniform(-1.05, 1.05, 2)])
        polynomial = rng.uniform(0.5, 2.0) * np.poly(both).real
        expected = bool(np.abs(both).max() < 1.0)
        assert is_stable(-polynomial[1:] / polynomial[0], INSIDE) is expected
        seen[expected] += 1
    assert min(seen.values()) > 20


@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize(("pole", "second"), [(0.95, 0.0), (0.95, 0.6), (1.0, 0.0)])
def test_sensitivities_are_those_of_the_linear_loop(pole: float, second: float, delay: int) -> None:
    controller = Controller("PI", 0.8, 12.0, 0.0, 0.8 / 12.0, 0.0, "error", delay, 1.0, True)
    step = 1.0 if pole == 1.0 else 1.0 - pole
    gains = np.array([[0.5, 1.0, 2.0], [0.5, 1.0, 2.0], [0.1, 1.0, 4.0]]) * (
        0.05 if pole == 1.0 else 1.0
    )
    dead = (1, 2, 9)
    late = np.array([controller.samples_late(one) for one in dead])
    poles = (-pole - second, pole * second)

    def closed(gain: float, late: int) -> LinearLoop:
        first = step * (1.0 - second) * gain
        return LinearLoop.of(ProcessModel(poles, (first,), late, 0.0, 1.0), controller)

    loops = [[closed(k, d) for k in row] for d, row in zip(dead, gains, strict=True)]
    found = sensitivities(gains, late, (pole, step, second), loops[0][0].r, loops[0][0].t, TURNS)
    for row, of_row in zip(found, loops, strict=True):
        for one, loop in zip(row, of_row, strict=True):
            margins = loop.margins()
            assert one == pytest.approx(margins.sensitivity if margins.stable else np.inf, rel=1e-9)
    assert np.isinf(found).any()
    assert np.isfinite(found).any()


def test_simc_for_a_lag_is_skogestads_table() -> None:
    # Skogestad (2003), table 1: Kc = T / (K (tau_c + theta)), Ti = min(T, 4 (tau_c + theta))
    gain, time = simc_lag(2.0 / 20.0, 20.0, 1.5)
    assert (gain, time) == pytest.approx((20.0 / (2.0 * 3.0), 12.0))
    pole = float(np.exp(-1.0 / 20.0))
    rule = simc(ProcessModel((-pole,), (2.0 * (1.0 - pole),), 2, 0.0, 1.0), PI)[0]
    assert (rule.gain, rule.integral_time_s) == pytest.approx((gain, time))
    gain, time = simc_lag(0.1, np.inf, 1.5)
    assert (gain, time) == pytest.approx((1.0 / (0.1 * 3.0), 12.0))


def test_the_phase_margin_of_a_loop_that_is_not_stable_is_below_zero() -> None:
    # a lag with a dead time of five samples: the phase at which the gain is one, by frequency
    process = ProcessModel((-float(np.exp(-0.1)),), (1.0 - float(np.exp(-0.1)),), 5, 0.0, 1.0)
    for gain in (1.0, 8.0):
        controller = Controller("PI", gain, 10.0, 0.0, gain / 10.0, 0.0, "error", 0, 1.0, True)
        loop = LinearLoop.of(process, controller)
        margins = loop.margins()
        assert (margins.phase_deg > 0.0) is margins.stable is (margins.gain > 1.0)
        turns = np.geomspace(1e-3, 0.4, 4000)
        size = np.abs(loop.open_loop(turns))
        phase = np.degrees(np.unwrap(np.angle(loop.open_loop(turns))))
        crossing = phase[:-1][(size[1:] < 1.0) & (size[:-1] >= 1.0)]
        assert np.min(np.abs(crossing + 180.0 - margins.phase_deg)) < 2.0
