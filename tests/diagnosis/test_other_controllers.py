"""A probability beside the controller as read tells nothing where that is another one."""

from __future__ import annotations

import numpy as np
import pytest

from fieldlink.diagnosis import diagnose
from tests.seeds import in_suite


def averaging_level(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """OP and PV of a level whose controller's gain grows with the error, up to an error of 3."""
    rng = np.random.default_rng(seed)
    y, u, last, load = 0.0, 50.0, 0.0, 0.0
    moved = [50.0] * 4
    op, pv = [], []
    for noise, push in rng.standard_normal((2400, 2)):
        error = -(y + 0.02 * noise)
        asked = error * min(1.0, abs(error) / 3.0)
        u += 8.3 * (asked - last + asked / 48.0)
        last = asked
        load = 0.98 * load + 0.5 * push
        moved = [u, *moved[:-1]]
        op.append(u)
        pv.append(50.0 - error)
        y += 0.01 * (moved[-1] - 50.0 + load)
    return np.array(op), np.array(pv)


@pytest.mark.parametrize("seed", in_suite(2, [2, 4, 5, 6, 11]))
def test_a_gain_that_grows_with_the_error_is_not_called_slow_for_the_room_beside_a_fixed_one(
    seed: int,
) -> None:
    op, pv = averaging_level(seed)
    answer = diagnose(op, pv, np.full(op.size, 50.0), period=1.0, advice=False)
    assert answer.controller is not None
    # no fixed settings explain its moves
    assert answer.controller.explained < 0.9
    assert [cause.name for cause in answer.causes] in (["undetermined"], ["quiet"])
    if answer.first.name == "undetermined":
        assert "set-point" in answer.first.action
