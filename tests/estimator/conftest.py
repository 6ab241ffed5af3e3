"""Windows of the closed loop that all tests share, and the rows that `identify` makes of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.controller.reading import read_aligned
from estimator.evidence.sign import gain_sign, soonest_answer
from estimator.hypotheses.hypothesis import Case
from estimator.rows import rows_of
from estimator.settings import SETTINGS
from estimator.window import harmonise
from loop_model import ValveModel
from tests.closed_loop import settled_loop

Array = NDArray[np.float64]
Loop = Callable[..., tuple[Array, Array, Array]]


@pytest.fixture(scope="session")
def loop() -> Loop:
    """`tests.closed_loop.settled_loop` as a fixture."""
    return settled_loop


@pytest.fixture(scope="session")
def sticky_window() -> tuple[Array, Array, Array]:
    """OP, PV and stem of a loop with S = 5 and J = 2."""
    return settled_loop(ValveModel(5.0, 2.0), samples=500, noise=0.05, seed=3)


def case_of(op: Array, pv: Array, *, signed: bool = True) -> Case:
    """The rows of a window as `identify` prepares them; ``signed`` is whether the sign is told."""
    exact = read_aligned(op, pv, None).controller
    sign = gain_sign(op, pv, None, exact, SETTINGS.modelling) if signed else 0.0
    soonest = soonest_answer(op, pv, None, sign, SETTINGS.modelling) if signed else 0
    window = harmonise(op, pv, None, None, 1.0, SETTINGS.screening)
    return Case(rows_of(window, sign, SETTINGS.modelling, soonest=soonest), SETTINGS)


@pytest.fixture(scope="session")
def case() -> Callable[..., Case]:
    """`case_of` as a fixture."""
    return case_of
