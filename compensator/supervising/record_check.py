"""Whether the record of a loop contradicts a model; checked before the model gets the loop.

A model of the wrong sign drives PV away, and the watch notices that only afterwards. But the record
of the loop under its own controller holds the answer already: the stem that the valve model makes
of OP, sent through the process model, has to move with PV. Where it moves against PV, the sign of
the gain is wrong. In a limit cycle of a sticky valve the two are nearly the same curve; and a loop
with integral action never makes them opposite, whatever disturbs it (its open-loop phase lies
between -90 and -270 degrees).

Example: a loop that oscillated by its valve had correlations of 0.7 to 1.0 with the right sign, and
of -0.7 to -1.0 with the wrong one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compensator.action import CompensatorError, require_positive, require_whole
from compensator.prediction import Prediction, answer_of, settling_samples
from loop_model import LoopModel, ValveModel

__all__ = ["RecordCheckSettings", "answer_correlation", "seen_agreement", "seen_friction"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RecordCheckSettings:
    """Settings of `seen_agreement` and `seen_friction`.

    Attributes:
        clear: absolute correlation of the model's answer with PV from which the sign counts as
            known. With the right sign none of 700 records of the tuning family was below -0.4.
        shares: factors of the friction, each of which is tried: valves that do not follow He's
            model slip before OP has gone their whole stick band.
        slips: least number of slips of the stem in the record.
        shortest: least number of samples of the record.
        own_shortest: the same for a record under the compensator, whose moves are larger and made
            on purpose.
        farther: such a record is checked when the control error exceeds this factor of the largest
            one before compensation.
        every: scans from one such check to the next.
        larger: larger frictions that are tried, as factors of the model's. Factors nearer to 1 are
            covered by the prior (`FrictionPrior.farthest`). Smaller frictions are not tried: a
            valve that does not follow He's model looks like one of less friction.
        first: first positions of the stem that are tried, from OP, in units of the static friction:
            in a limit cycle no wider than the band a stem that begins in its middle never moves.
        plainer: a larger friction counts if it leaves at most this share of the variance of PV that
            the model's own friction leaves unexplained. On 70 records of the tuning family none of
            210 models with the right friction, or a larger one, was changed.
    """

    clear: float = 0.6
    shares: tuple[float, ...] = (1.0, 0.5)
    slips: int = 3
    shortest: int = 160
    own_shortest: int = 40
    farther: float = 1.2
    every: int = 4
    larger: tuple[float, ...] = (1.7, 2.0, 2.4, 2.8)
    first: tuple[float, ...] = (-0.8, 0.0, 0.8)
    plainer: float = 0.75

    def __post_init__(self) -> None:
        if not 0.0 < self.clear < 1.0:
            raise CompensatorError(
                f"RecordCheckSettings: clear is a correlation between 0 and 1; got {self.clear!r}"
            )
        if not self.shares or not all(0.0 <= share <= 1.0 for share in self.shares):
            raise CompensatorError(
                f"RecordCheckSettings: shares lie between 0 and 1; got {self.shares!r}"
            )
        require_whole(
            "RecordCheckSettings",
            1,
            slips=self.slips,
            shortest=self.shortest,
            own_shortest=self.own_shortest,
            every=self.every,
        )
        require_positive("RecordCheckSettings", farther=self.farther)


def seen_agreement(
    model: LoopModel,
    op: Sequence[float],
    pv: Sequence[float],
    settings: RecordCheckSettings | None = None,
) -> int:
    """Return 1 where a record bears out the sign of a model's gain, -1 where it contradicts it, and
    0 where it is too short or shows neither.

    Args:
        model: valve and process.
        op: applied before each PV, shape ``(n,)``.
        pv: shape ``(n,)``, NaN where it was bad.
        settings: limits.
    """
    s = settings or RecordCheckSettings()
    if len(op) < s.shortest or not np.isfinite(pv).any():
        return 0
    found = [answer_correlation(model, op, pv, share, s.slips) for share in s.shares]
    strongest = max(found, key=abs)
    if abs(strongest) < s.clear:
        return 0
    return 1 if strongest > 0.0 else -1


def seen_friction(
    model: LoopModel,
    op: Sequence[float],
    pv: Sequence[float],
    settings: RecordCheckSettings | None = None,
) -> float:
    """Return the factor by which the friction of the valve is larger than a model has it, as far
    as a record shows it plainly; else 1.

    A valve that sticks lets OP travel through its whole band between two slips. With too small a
    friction the model's stem slips too early, and its answer runs ahead of PV.

    Args:
        model: valve and process.
        op: applied before each PV by the loop's own controller, shape ``(n,)``.
        pv: shape ``(n,)``, NaN where it was bad.
        settings: factors and limits.
    """
    s = settings or RecordCheckSettings()
    if len(op) < s.shortest or not np.isfinite(pv).any():
        return 1.0
    found = {
        f: max(answer_correlation(model, op, pv, f, s.slips, first) for first in s.first)
        for f in (1.0, *s.larger)
    }
    best = max(found, key=lambda f: found[f])
    plain = 1.0 - found[best] ** 2 <= s.plainer * (1.0 - max(found[1.0], 0.0) ** 2)
    return best if found[best] >= s.clear and plain else 1.0


def answer_correlation(
    model: LoopModel,
    op: Sequence[float],
    pv: Sequence[float],
    factor: float = 1.0,
    slips: int = 3,
    first: float = 0.0,
) -> float:
    """Return the correlation of PV with the model's answer to OP, slow trends taken off both.

    Args:
        model: valve and process.
        op: applied before each PV, shape ``(n,)``.
        pv: shape ``(n,)``, NaN where it was bad.
        factor: of the model's friction.
        first: position of the stem at first, from OP, as a share of the static friction.
        slips: of the stem at least; with fewer, or where nothing changes, the correlation is 0.
    """
    valve = ValveModel(factor * model.valve.stick_band, factor * model.valve.slip_jump)
    stem = valve.simulate(op, op[0] + first * valve.static_friction)
    if np.count_nonzero(np.diff(stem)) < slips:
        return 0.0
    p = model.process.as_controlled()
    answer = answer_of(p, stem - stem[0], p.dead_time - 1)
    prediction = Prediction.of(p, "input")
    window = 3 * (20 + prediction.dead_time)
    if not p.is_integrating:
        window = 2 * settling_samples(prediction) + prediction.dead_time + 20
    window = min(window, stem.size // 3)
    ours, theirs = (_detrended(x, window) for x in (answer, _filled(pv)))
    spread = float(ours.std() * theirs.std())
    return float(np.mean(ours * theirs)) / spread if spread > 0.0 else 0.0


def _detrended(signal: Array, window: int) -> Array:
    """Return a signal less its mean over a window around each sample, both ends left out."""
    sums = np.concatenate([[0.0], np.cumsum(signal)])
    means = (sums[window:] - sums[:-window]) / window
    middle = signal[window // 2 : window // 2 + means.size] - means
    kept: Array = middle - middle.mean()
    return kept


def _filled(pv: Sequence[float]) -> Array:
    """Return PV with what is bad replaced by its neighbours."""
    values = np.asarray(pv, dtype=np.float64)
    good = np.flatnonzero(np.isfinite(values))
    filled: Array = np.interp(np.arange(values.size), good, values[good])
    return filled
