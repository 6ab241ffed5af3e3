"""A valve law and a criterion are one thing each, and a name: registered for a test, and used."""

from __future__ import annotations

import sys
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from estimator import Verdict, identify
from estimator.criteria.registry import CRITERIA, ColouredNoise
from estimator.settings import Modelling
from estimator.valves.laws import LAWS, stem_of
from loop_model import ValveModel


def _register(
    monkeypatch: pytest.MonkeyPatch, registry: MappingProxyType[str, Any], name: str, entry: Any
) -> None:
    """One line more in a registry, in every module that reads it, until the test ends."""
    longer = MappingProxyType({**registry, name: entry})
    for module in [m for key, m in sys.modules.items() if key.startswith("estimator")]:
        for attribute, value in list(vars(module).items()):
            if value is registry:
                monkeypatch.setattr(module, attribute, longer)


def _lazy_stems(op: np.ndarray, valves: np.ndarray) -> np.ndarray:
    """A law of this test: having broken away, the stem goes exactly J, however far OP is."""
    stems = np.empty((op.size, len(valves)))
    for lane, (band, jump, x) in enumerate(valves):
        for k, u in enumerate(op):
            if abs(u - x) > 0.5 * (band + jump):
                x += np.copysign(max(jump, 1e-3 * band), u - x)
            stems[k, lane] = x
    return stems


def _lazy_loop(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """OP that drifts to and fro so fast that one slip of J a sample falls behind."""
    rng = np.random.default_rng(0)
    op = 4.0 * np.sin(np.arange(samples) / 12.0) + np.cumsum(0.3 * rng.normal(size=samples))
    op = (op - 0.5 * (op.max() + op.min())) / np.ptp(op)
    stem = _lazy_stems(op, np.array([[0.3, 0.04, op[0]]]))[:, 0]
    pole = np.exp(-1.0 / 3.0)
    pv = np.zeros(samples)
    for k in range(1, samples):
        pv[k] = pole * pv[k - 1] + (1.0 - pole) * stem[k - 1]
    return op, pv + 0.004 * rng.normal(size=samples)


def test_a_law_more_is_tried_and_can_be_the_likeliest(monkeypatch: pytest.MonkeyPatch) -> None:
    op, pv = _lazy_loop(240)
    before = identify(op, pv)
    assert before.evidence.law in LAWS
    _register(monkeypatch, LAWS, "lazy", _lazy_stems)
    np.testing.assert_array_equal(
        stem_of(op, "lazy", (0.3, 0.04, float(op[0]))),
        _lazy_stems(op, np.array([[0.3, 0.04, op[0]]]))[:, 0],
    )
    after = identify(op, pv)
    assert after.evidence.law == "lazy"
    # the evidence is He's valve's, whatever laws there are
    assert after.score == before.score
    told = [one.explanation for one in after.runners_up]
    assert all(any(f"(law {name})" in text for text in told) for name in LAWS)


class _FirstOrderNoise(ColouredNoise):
    """A criterion of this test: noise of one tap."""

    def modelling(self, settings: Modelling) -> Modelling:
        return replace(settings, noise_orders=(1,))


def test_a_criterion_more_is_chosen_by_its_name(monkeypatch: pytest.MonkeyPatch, loop) -> None:
    op, pv, _ = loop(ValveModel(5.0, 2.0), samples=400, seed=3)
    _register(monkeypatch, CRITERIA, "first-order noise", _FirstOrderNoise())
    result = identify(op, pv, criterion="first-order noise")
    assert result.verdict is Verdict.STICTION
    assert "autoregressive of order 1" in result.criterion_reason


def test_a_registry_cannot_be_changed_by_accident() -> None:
    for registry in (LAWS, CRITERIA):
        with pytest.raises(TypeError):
            registry["another"] = None  # type: ignore[index]
