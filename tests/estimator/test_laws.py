"""The lane laws of the search against their equations, written out one valve at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from estimator.valves.laws import LAWS, stem_of
from loop_model import ValveModel

Array = NDArray[np.float64]

VALVES = st.tuples(st.floats(0.02, 1.1), st.floats(0.0, 1.0), st.floats(-1.0, 1.0)).map(
    lambda v: (v[0], v[0] * v[1], 0.5 * v[2] * v[0] * (1.0 + v[1]))
)
"""S, J and a first position within fS of zero, where OP begins."""


def _op(seed: int, n: int = 150) -> Array:
    """Sines, steps and noise that span one and begin at zero; its values never repeat by rule."""
    rng = np.random.default_rng(seed)
    k = np.arange(n)
    u = np.sin(k / rng.uniform(3.0, 15.0)) + np.repeat(rng.normal(size=n // 10), 10)
    u += 0.1 * rng.normal(size=n)
    found: Array = (u - u[0]) / np.ptp(u)
    return found


def _he(op: Array, valve: tuple[float, float, float]) -> Array:
    return ValveModel(valve[0], valve[1]).simulate(op, valve[2])


def _sliding(op: Array, valve: tuple[float, float, float]) -> Array:
    """At rest it needs fS; in motion it stays fD behind OP until OP stops or turns."""
    band, jump, x = valve
    static, dynamic = 0.5 * (band + jump), 0.5 * (band - jump)
    direction, before, stem = 0, op[0], []
    for u in op:
        if u - x > static or (direction > 0 and u > before):
            direction = 1
        elif u - x < -static or (direction < 0 and u < before):
            direction = -1
        else:
            direction = 0
        x = u - direction * dynamic if direction else x
        before = u
        stem.append(x)
    return np.array(stem)


def _steps(op: Array, valve: tuple[float, float, float]) -> Array:
    """One slip of J after another, within a sample, until OP is within fS again."""
    band, jump, x = valve
    static, slip = 0.5 * (band + jump), max(jump, 1e-3 * band)
    stem = []
    for path in _between(op):
        for u in path:
            while abs(u - x) > static:
                x += math.copysign(slip, u - x)
        stem.append(x)
    return np.array(stem)


def _between(op: Array) -> list[list[float]]:
    """What OP does from each sample to the next: its turn on the way, if it has one, and its end.

    The turn is where a line through the two samples before meets one through the two after, if the
    one rises, the other falls and they meet between.
    """
    paths = [[float(op[0])]]
    for k in range(1, op.size):
        way = [0.5 * float(op[k - 1] + op[k]), float(op[k])]
        if 1 < k < op.size - 1:
            before = np.polynomial.Polynomial.fit([k - 2, k - 1], op[k - 2 : k], 1).convert()
            after = np.polynomial.Polynomial.fit([k, k + 1], op[k : k + 2], 1).convert()
            rise, fall = before.deriv()(k), after.deriv()(k)
            if rise * fall < 0.0:
                meet = (after - before).roots()[0]
                if k - 1 < meet < k:
                    way[0] = float(before(meet))
        paths.append(way)
    return paths


def _sliding_between(op: Array, valve: tuple[float, float, float]) -> Array:
    """The sliding valve along OP with its turns, as it stands at the samples."""
    paths = _between(op)
    stem = _sliding(np.concatenate(paths), valve)
    return stem[np.cumsum([len(path) for path in paths]) - 1]


REFERENCES = {
    "he": _he,
    "sliding": _sliding,
    "steps": _steps,
    "sliding-between": _sliding_between,
}


def test_a_triangle_sampled_beside_its_corners_turns_at_them() -> None:
    # the corners of a triangle of height one lie a third of a sample behind samples
    at = np.arange(40.0)
    op = 1.0 - 2.0 * np.abs(np.mod((at + 0.66) / 9.0, 2.0) - 1.0)
    valve = (1.95, 1.95, -0.98)
    # a slip of almost the whole travel needs the corners; no sample is as far
    moves = np.count_nonzero(np.diff(stem_of(op, "steps", valve)))
    assert np.ptp(op) < valve[0]
    assert moves == 4
    assert np.count_nonzero(np.diff(stem_of(op, "he", valve))) == 0


def test_every_law_has_a_reference() -> None:
    assert set(LAWS) == set(REFERENCES)


@pytest.mark.parametrize("law", REFERENCES)
@settings(max_examples=12)
@given(seed=st.integers(0, 500), valve=VALVES)
def test_a_lane_follows_the_equation(
    law: str, seed: int, valve: tuple[float, float, float]
) -> None:
    op = _op(seed)
    expected = REFERENCES[law](op, valve)
    # without J the slips of ``steps`` are a thousandth of S, and rounding may add or leave one
    tiny = 1.01e-3 * valve[0] if law == "steps" and valve[1] < 1e-3 * valve[0] else 0.0
    np.testing.assert_allclose(stem_of(op, law, valve), expected, atol=1e-9 + tiny)


@pytest.mark.parametrize("law", LAWS)
def test_a_lane_has_the_same_bits_in_any_company(law: str) -> None:
    op = _op(3, 200)
    rng = np.random.default_rng(1)
    band = rng.uniform(0.02, 1.0, 37)
    valves = np.column_stack([band, band * rng.random(37), rng.normal(0.0, 0.1, 37)])
    together = LAWS[law](op, valves)
    turned = rng.permutation(37)
    np.testing.assert_array_equal(LAWS[law](op, valves[turned].copy()), together[:, turned])
    for size in (1, 3, 8, 16):
        np.testing.assert_array_equal(LAWS[law](op, valves[:size].copy()), together[:, :size])


def test_a_jump_as_wide_as_the_band_makes_sliding_and_he_catch_up_with_op_entirely() -> None:
    # fD = 0: at every slip the stem is where OP is
    op = _op(5)
    for law in ("he", "sliding"):
        stem = stem_of(op, law, (0.3, 0.3, 0.0))
        moved = np.flatnonzero(np.diff(stem)) + 1
        assert moved.size > 3
        np.testing.assert_array_equal(stem[moved], op[moved])
