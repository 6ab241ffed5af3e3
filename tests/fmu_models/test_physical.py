"""The physical valve takes steps of its grid together; the stem moves as with every one of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.physical_grid import LIMIT, MOVES, build_every_step, move_op, run_stem

STICK_BAND = 8.0


@pytest.fixture(scope="module")
def every_step(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_every_step(tmp_path_factory.mktemp("physical"))


@pytest.mark.parametrize("lag", [0.2, 1.0])
@pytest.mark.parametrize("valve", [0, 4])
@pytest.mark.parametrize("kind", MOVES)
def test_the_stem_is_within_a_hundredth_of_the_stick_band(
    every_step: Path, valve: int, kind: str, lag: float
) -> None:
    op = move_op(kind, 1)
    parameters = {"valve": valve, "stick_band": STICK_BAND, "slip_jump": 4.8, "actuator_lag": lag}
    stems = [run_stem(model, parameters, op) for model in (every_step, "physical")]
    np.testing.assert_allclose(stems[1], stems[0], atol=LIMIT * STICK_BAND)
    assert np.ptp(stems[0]) > 10.0


def test_the_closed_loop_moves_alike_until_rounding_has_grown(every_step: Path) -> None:
    """A cycle with friction is chaotic: it multiplies rounding by ten in some 60 s."""
    parameters = {"op_start": 40.0, "stick_band": STICK_BAND, "slip_jump": 2.0}
    stems = [run_stem(model, parameters, samples=300) for model in (every_step, "physical")]
    np.testing.assert_allclose(stems[1], stems[0], atol=LIMIT * STICK_BAND)
    assert np.ptp(stems[0]) > 0.5 * STICK_BAND
