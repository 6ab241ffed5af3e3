"""The door: raw samples in, one harmonised window out, or a reason why it cannot be judged."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimator.arrays import Array, Mask
from estimator.outcomes import EstimatorError, Reason, ReasonCode
from estimator.settings import Screening

__all__ = [
    "Window",
    "bridge",
    "carry_on",
    "harmonise",
    "period_of",
    "screen",
    "signal_of",
    "signals_of",
]

_TINY = 1e-9
"""Span or deviation, as a share of the value, that is rounding."""

_LARGEST = 1e100
"""Beyond, a number stands for no measurement (the largest of double precision is what some servers
store instead), and its square is none."""

_USUAL_PERIOD = 1.0
"""Seconds between samples that come without times and without a period."""

_ROUNDED = 0.02
"""Share by which times may differ from a given period: 100 samples whose times are rounded to the
period do so by 1 %."""

_HOLE = 1.5
"""Steps of an index beyond which a row is missing: from there on a missing row is nearer than a
late one."""


@dataclass(frozen=True, slots=True)
class Window:
    """A window in its own units: OP spans one, PV has unit variance, both are centred.

    Attributes:
        u: scaled OP, shape ``(n,)``; bad samples bridged by the straight line between neighbours.
        y: scaled PV, shape ``(n,)``; zero where bad.
        good: usable samples, shape ``(n,)``, bool.
        op_centre, op_span, pv_centre, pv_scale: ``OP = op_centre + op_span u``, PV likewise.
        period: seconds between samples.
        automatic: share of samples in automatic.
    """

    u: Array
    y: Array
    good: Mask
    op_centre: float
    op_span: float
    pv_centre: float
    pv_scale: float
    period: float
    automatic: float

    @property
    def size(self) -> int:
        """Samples of the window."""
        return int(self.u.size)


def harmonise(
    op: ArrayLike,
    pv: ArrayLike,
    sp: ArrayLike | None,
    auto: ArrayLike | None,
    period: float,
    screening: Screening,
) -> Window:
    """Check and scale the raw samples.

    Raises:
        EstimatorError: not one-dimensional numbers, different lengths, no usable sample, a period
            that is not positive.
    """
    op_raw, given = signals_of(op, {"pv": pv, "sp": sp, "auto": auto})
    pv_raw, length = given["pv"], op_raw.size
    if length < 2:
        raise EstimatorError(
            f"a window of {length} samples is too short: give {screening.min_samples}+"
        )
    period = period_of(period)
    in_auto = np.ones(length, dtype=bool)
    if "auto" in given:
        flag = given["auto"]
        in_auto = np.isfinite(flag) & (flag != 0.0)
    op_good, pv_good = np.isfinite(op_raw), np.isfinite(pv_raw)
    for name, ok in (("op", op_good), ("pv", pv_good)):
        if not ok.any():
            raise EstimatorError(f"{name} has no finite sample: map the right tag or column")
    good = op_good & pv_good
    index = np.arange(length)
    bridged = np.interp(index, index[op_good], op_raw[op_good])
    low, high = float(bridged.min()), float(bridged.max())
    op_centre, op_span = 0.5 * (low + high), high - low
    kept = pv_raw[good] if good.any() else pv_raw[pv_good]
    pv_centre = float(kept.mean())
    pv_scale = float(kept.std())
    if op_span <= _TINY * max(abs(low), abs(high)):
        op_span = 0.0
    if pv_scale <= _TINY * abs(pv_centre):
        pv_scale = 0.0
    u = (bridged - op_centre) / (op_span or 1.0)
    y = np.where(good, (np.where(good, pv_raw, pv_centre) - pv_centre) / (pv_scale or 1.0), 0.0)
    return Window(
        u=u,
        y=y,
        good=good,
        op_centre=op_centre,
        op_span=op_span,
        pv_centre=pv_centre,
        pv_scale=pv_scale,
        period=period,
        automatic=float(in_auto.mean()),
    )


def signal_of(name: str, values: ArrayLike) -> Array:
    """One row of samples, ``(n,)``; what is masked or measures nothing is NaN.

    ``name`` is that of the signal.

    Raises:
        EstimatorError: not one row of numbers.
    """
    if np.iscomplexobj(values):
        raise EstimatorError(f"{name} is complex: give real numbers")
    if _kind_of(values) in ("m", "M"):
        raise EstimatorError(f"{name} holds times: give the samples' numbers")
    try:
        if isinstance(values, np.ma.MaskedArray):
            values = np.ma.filled(values.astype(np.float64), math.nan)
        signal = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        if name == "auto":
            raise EstimatorError(
                "auto is not numeric: give 1 where the controller is in automatic and 0 elsewhere, "
                "for instance mode == 'AUTO'"
            ) from error
        raise EstimatorError(
            f"{name} is not numeric ({error}): give numbers, and NaN for what is none, for "
            f"instance by pandas.to_numeric({name}, errors='coerce')"
        ) from error
    if signal.ndim != 1:
        raise EstimatorError(
            f"{name} has shape {signal.shape}: give one row of samples, shape (n,)"
        )
    beyond = np.abs(signal) > _LARGEST
    return np.where(beyond, math.nan, signal) if beyond.any() else signal


def signals_of(
    op: ArrayLike, others: Mapping[str, ArrayLike | None]
) -> tuple[Array, dict[str, Array]]:
    """OP and those of the other signals that there are, by name, ``(n,)`` each.

    Series with an index (pandas) are not joined by it: theirs have to be equal.

    Raises:
        EstimatorError: one is not a row of numbers, or has another length or index than OP; PV is
            OP, sample by sample.
    """
    first = signal_of("op", op)
    found = {name: signal_of(name, one) for name, one in others.items() if one is not None}
    for name, signal in found.items():
        if signal.size != first.size:
            raise EstimatorError(
                f"op has {first.size} samples and {name} has {signal.size}: "
                f"give every signal of the window with the same number of samples"
            )
    _compare_indexes({"op": op, **others})
    same = "pv" in found and np.array_equal(first, found["pv"], equal_nan=True)
    # two loops at rest may well hold the same number; what moves alike is one signal
    if same and np.unique(first[np.isfinite(first)]).size > 1:
        raise EstimatorError("op and pv are the same samples: give OP's and PV's own columns")
    return first, found


def period_of(period: float | None, *signals: ArrayLike | None) -> float:
    """The seconds between samples.

    Args:
        period: as given; None takes it from the times of the signals' index, or 1 s without any.
        signals: as given. An index of times (pandas' DatetimeIndex, TimedeltaIndex, PeriodIndex)
            has to rise in steps without holes; its mean step is the period.

    Raises:
        EstimatorError: not a number above zero, times in uneven steps, or times that contradict it.
    """
    # numpy counts a timedelta64 among its integers, and compares it with no number
    is_number = isinstance(period, (int, float, np.number)) and _kind_of(period) != "m"
    if period is not None and not (is_number and 0.0 < period < math.inf):
        raise EstimatorError(f"period is {period!r}: give the seconds between samples, above zero")
    times = next((found for one in signals if (found := _times_of(one)) is not None), None)
    if times is None or times.size < 2:
        return _USUAL_PERIOD if period is None else float(period)
    step = _step_of(times)
    if period is None:
        return step
    if abs(step - period) > _ROUNDED * period:
        raise EstimatorError(
            f"period is {period:g} s and the times of the index are {step:g} s apart: leave period "
            f"out, or give the samples without their index (to_numpy())"
        )
    return float(period)


def _index_of(values: ArrayLike | None) -> Any:
    """The index of a pandas Series; None for what has none (a list's ``index`` is a method)."""
    index = getattr(values, "index", None)
    return None if index is None or callable(index) else index


def _kind_of(values: Any) -> str:
    """The letter of numpy's kind of numbers; empty for what has none, such as a list."""
    return str(getattr(getattr(values, "dtype", None), "kind", ""))


def _labels_of(index: Any) -> NDArray[Any]:
    if _kind_of(index) == "M":
        # with a time zone numpy would make objects of them
        return np.asarray(index.to_numpy(dtype="datetime64[ns]"))
    return np.asarray(index)


def _compare_indexes(signals: Mapping[str, ArrayLike | None]) -> None:
    first: tuple[str, NDArray[Any]] | None = None
    for name, one in signals.items():
        if (index := _index_of(one)) is None:
            continue
        labels = _labels_of(index)
        if first is None:
            first = name, labels
        elif not np.array_equal(labels, first[1]):
            raise EstimatorError(
                f"{first[0]} and {name} have different indexes, and samples are taken by their "
                f"place: join them first (pandas.concat(..., axis=1)), or give them without their "
                f"index (to_numpy())"
            )


def _times_of(values: ArrayLike | None) -> Array | None:
    """Seconds of each sample by its index, ``(n,)``; None where the index holds no times."""
    index = _index_of(values)
    if index is None:
        return None
    if callable(getattr(index, "to_timestamp", None)):
        index = index.to_timestamp()
    labels = _labels_of(index)
    if labels.dtype.kind not in "mM" or not labels.size:
        return None
    seconds: Array = (labels - labels[0]) / np.timedelta64(1, "s")
    return seconds


def _step_of(times: Array) -> float:
    """The mean step of times that rise evenly, seconds."""
    steps = np.diff(times)
    remedy = "or give the samples without their index (to_numpy()), and their period"
    if not (steps > 0.0).all():
        row = int(np.argmin(steps > 0.0)) + 1
        raise EstimatorError(
            f"the times of the index do not rise at row {row} (counted from 0): sort them and drop "
            f"those that are empty or there twice, {remedy}"
        )
    # times that are rounded alternate between two steps: their mean is between these
    usual = max(float(np.median(steps)), float(np.mean(steps)))
    row = int(np.argmax(steps))
    if steps[row] > _HOLE * usual:
        raise EstimatorError(
            f"the times of the index are {usual:g} s apart, and {steps[row]:g} s before row "
            f"{row + 1} (counted from 0): give missing rows as NaN (asfreq, resample), {remedy}"
        )
    return float((times[-1] - times[0]) / steps.size)


def bridge(values: ArrayLike, name: str = "the signal") -> Array:
    """The samples with straight lines across the bad ones; ``name`` is for messages.

    Raises:
        EstimatorError: not a row of samples, or none is finite.
    """
    x = np.asarray(values, dtype=np.float64)
    if x.ndim != 1:
        raise EstimatorError(f"{name} has shape {x.shape}: give one row of samples, shape (n,)")
    good = np.isfinite(x)
    if not good.any():
        raise EstimatorError(f"{name} has no finite sample: map the right tag or column")
    if good.all():
        return x
    k = np.arange(x.size)
    return np.interp(k, k[good], x[good])


def carry_on(sp: ArrayLike) -> Array | None:
    """The set-point ``(n,)`` with its last known value where it is NaN; None where none is known.

    A set-point stands until it is set anew: historians store it where it changes, and polls get
    lost. Before the first known value that one counts.
    """
    values = np.asarray(sp, dtype=np.float64)
    known = np.flatnonzero(np.isfinite(values))
    if known.size == 0:
        return None
    last = np.searchsorted(known, np.arange(values.size), side="right") - 1
    carried: Array = values[known[np.maximum(last, 0)]]
    return carried


def screen(window: Window, informed: float, screening: Screening) -> tuple[Reason, ...]:
    """Reasons why the window cannot be judged before any model is tried; empty when it can.

    ``informed`` is the share of samples that were measured and not drawn by a historian.
    """
    reasons: list[Reason] = []

    def add(code: ReasonCode, text: str) -> None:
        reasons.append(Reason(code, text))

    n, good = window.size, int(window.good.sum())
    if n < screening.min_samples:
        add(
            ReasonCode.TOO_FEW_SAMPLES,
            f"the window has {n} samples, {screening.min_samples} are needed",
        )
    if good < (1.0 - screening.max_bad) * n:
        add(
            ReasonCode.TOO_MANY_BAD_SAMPLES,
            f"{n - good} of {n} samples are bad or missing, {screening.max_bad:.0%} are tolerated",
        )
    if window.automatic < screening.min_auto:
        add(
            ReasonCode.NOT_IN_AUTOMATIC,
            f"the controller is in automatic for {window.automatic:.0%} of the window, "
            f"{screening.min_auto:.0%} are needed",
        )
    if window.op_span == 0.0:
        add(ReasonCode.OP_CONSTANT, f"OP stays at {window.op_centre:.6g}")
    elif (steady := _longest_share(window.u)) > screening.max_still:
        add(ReasonCode.OP_HARDLY_MOVES, f"OP stands still for {steady:.0%} of the window")
    elif (share := _rail_share(window.u[window.good])) > screening.max_at_rail:
        add(ReasonCode.OP_AT_LIMIT, f"OP is at its limit for {share:.0%} of the window")
    if window.pv_scale == 0.0:
        add(ReasonCode.PV_FROZEN, f"PV stays at {window.pv_centre:.6g}")
    else:
        y = window.y[window.good]
        if (still := _longest_share(y)) > screening.max_still:
            add(
                ReasonCode.PV_FROZEN,
                f"PV does not change for {still:.0%} of the window",
            )
        elif (share := _rail_share(y)) > screening.max_at_rail:
            add(ReasonCode.PV_AT_LIMIT, f"PV is at its limit for {share:.0%} of the window")
    if informed < screening.min_informed:
        add(
            ReasonCode.RECORD_INTERPOLATED,
            f"only {informed:.0%} of the samples are off the straight line between two others, "
            f"{screening.min_informed:.0%} are needed",
        )
    return tuple(reasons)


def _rail_share(signal: Array) -> float:
    """Share of samples that sit exactly at the signal's lowest or highest value."""
    if signal.size == 0:
        return 0.0
    low, high = signal.min(), signal.max()
    band = 1e-6 * (high - low)
    return float(max((signal <= low + band).mean(), (signal >= high - band).mean()))


def _longest_share(signal: Array) -> float:
    """Share of samples that do not differ from the one before."""
    if signal.size < 2:
        return 1.0
    return float((np.abs(np.diff(signal)) <= 1e-9).mean())
