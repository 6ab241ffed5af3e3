"""Which signal is OP: what the data tell, and that they are never read the wrong way round."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from fieldlink.site.role_evidence import Roles, judge_roles
from tests.site.made_loops import made_loop


def test_loops_in_automatic_are_never_read_the_wrong_way_round() -> None:
    loops = [made_loop(seed) for seed in range(40)]
    found = Counter(judge_roles(op, pv).roles for op, pv in loops)
    swapped = Counter(judge_roles(pv, op).roles for op, pv in loops)
    assert found[Roles.SWAPPED] == swapped[Roles.AGREE] == 0
    # What they do not tell is left to a person; a useful share of them tells.
    assert min(found[Roles.AGREE], swapped[Roles.SWAPPED]) >= 15


def test_steps_by_hand_show_who_follows() -> None:
    draws = np.random.default_rng(1)
    op = np.repeat(50.0 + 5.0 * draws.normal(size=8), 50)
    pv = np.empty(op.size)
    level = 50.0
    for k in range(op.size):
        level += (op[max(0, k - 3)] - level) / 10.0
        pv[k] = level + 0.1 * draws.normal()
    assert judge_roles(op, pv).sentence == "OP is moved in steps and PV follows"
    assert judge_roles(pv, op).roles is Roles.SWAPPED


def walk(seed: int) -> np.ndarray:
    return 50.0 + 0.3 * np.cumsum(np.random.default_rng(seed).normal(size=300))


@pytest.mark.parametrize(
    ("op", "pv", "roles", "said"),
    [
        (np.linspace(150.0, 420.0, 100), walk(1)[:100], Roles.SWAPPED, "from 150 to 420"),
        (3.0 * walk(1), 5.0 * walk(2), Roles.UNCLEAR, "neither stays in 0 to 100"),
        (np.full(100, 50.0), walk(1)[:100], Roles.UNCLEAR, "OP stood still"),
        (walk(1)[:20], walk(2)[:20], Roles.UNCLEAR, "only 20 samples"),
        (walk(1), walk(2), Roles.UNCLEAR, "do not tell"),
    ],
    ids=["range", "no range", "rest", "short", "unrelated"],
)
def test_other_data(op: np.ndarray, pv: np.ndarray, roles: Roles, said: str) -> None:
    found = judge_roles(op, pv)
    assert found.roles is roles
    assert said in found.sentence
