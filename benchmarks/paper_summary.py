"""Errors, coverage and ratios of every method over the windows of one example."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.examples import Example
from benchmarks.paper_methods import Band, Estimate, poles_of
from loop_model import LoopModel, ProcessModel

__all__ = [
    "CONSTANT", "HEADER", "LIMITS", "ORACLE", "Limit", "Summary", "held", "limits_of", "published",
    "summarise",
]  # fmt: skip

_NO_WORSE = 1e-3
"""A cost is no worse within this share: a tenth of a percent, to which the search refines S."""

_FEWEST = 60
"""Windows that a coverage needs to be held against its limits."""

HEADER = (
    "example", "method", "windows", "stiction", "fS %", "fD %", "S %", "S %, p90", "J %", "gain %",
    "slowest pole %", "poles", "cover S", "cover J", "cover gain", "search no worse",
    "search/method cost, worst", "core seconds", "time over search",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Summary:
    """One method over all windows of one example, in the order of `HEADER`.

    Errors are medians of absolute errors, in percent of the truth; ``poles`` is the median of the
    largest distance from a true pole to the nearest found. ``cover_*`` is the share of intervals
    that hold the truth. ``no_worse`` is the share of windows in which the search's cost is at most
    the method's (within a thousandth), ``worst_cost`` the largest ratio of the two.
    """

    example: str
    method: str
    windows: int
    stiction: float
    static_friction: float
    dynamic_friction: float
    stick_band: float
    stick_band_p90: float
    slip_jump: float
    gain: float
    slowest_pole: float
    poles: float
    cover_stick_band: float
    cover_slip_jump: float
    cover_gain: float
    no_worse: float
    worst_cost: float
    seconds: float
    time_ratio: float


@dataclass(frozen=True, slots=True)
class Limit:
    """What a figure of the search's row is held to; ``low`` to ``high`` after ``factor``."""

    name: str
    field: str
    low: float
    high: float
    factor: float = 1.0

    @property
    def words(self) -> str:
        """The limits in words."""
        if math.isinf(self.low):
            return f"at most {self.high:.3g}"
        return f"{self.low:g} to {self.high:g}"

    def met(self, value: float) -> bool | None:
        """Whether ``value`` (times ``factor`` already) is within; None when it is not known."""
        return None if math.isnan(value) else self.low <= value <= self.high


LIMITS = (
    Limit("median error of S, %", "stick_band", -math.inf, 1.0),
    Limit("median error of J, %", "slip_jump", -math.inf, 15.0),
    Limit("median error of the gain, %", "gain", -math.inf, 5.0),
    Limit("S in its 90 % interval, % of windows", "cover_stick_band", 80.0, 97.0, 100.0),
    Limit("J in its 90 % interval, % of windows", "cover_slip_jump", 80.0, 97.0, 100.0),
    Limit("gain in its 90 % interval, % of windows", "cover_gain", 80.0, 97.0, 100.0),
)


ORACLE = "oracle: the true moves"
"""Method that is given the moments at which the stem moves."""

CONSTANT = "constant set-point"
"""End of the name of an example without set-point changes."""

_OVER_ORACLE = 1.25
"""Limit of the gain's error there, over the oracle's: the data leave the gain open."""


def limits_of(example: str, oracle_gain: float) -> tuple[Limit, ...]:
    """The limits of an example; ``oracle_gain`` is the oracle's median error of the gain in %.

    At constant set-point the gain is held to the oracle's own error plus a quarter.
    """
    if not example.endswith(CONSTANT):
        return LIMITS
    return tuple(
        replace(limit, high=_OVER_ORACLE * oracle_gain)
        if limit.field == "gain" and math.isfinite(oracle_gain)
        else limit
        for limit in LIMITS
    )


def held(rows: Sequence[Summary]) -> list[tuple[str, str, float, str, str]]:
    """Example, figure, value, limit and whether it is met, for every row of the search."""
    word = {True: "yes", False: "**no**", None: "not measured"}
    oracles = {row.example: row.gain for row in rows if row.method == ORACLE}
    found = []
    for row in rows:
        if not row.method.startswith("search"):
            continue
        for limit in limits_of(row.example, oracles.get(row.example, math.nan)):
            value = limit.factor * float(getattr(row, limit.field))
            name = f"{limit.name} ({row.method.removeprefix('search, ')})"
            met = word[limit.met(value)]
            if limit.field.startswith("cover_") and row.windows < _FEWEST:
                met = "too few windows"
            found.append((row.example, name, value, limit.words, met))
    return found


def _error(values: Sequence[float], truth: float, share: float = 0.5) -> float:
    errors = [100.0 * abs(v - truth) / abs(truth) for v in values if math.isfinite(v)]
    return float(np.quantile(errors, share)) if errors else math.nan


def _coverage(bands: Sequence[Band | None], truth: float) -> float:
    known = [band for band in bands if band is not None and math.isfinite(band[0])]
    return sum(low <= truth <= high for low, high in known) / len(known) if known else math.nan


def _farthest(found: Sequence[complex], truth: Sequence[complex]) -> float:
    """Largest distance from a true pole to the nearest found."""
    if not found:
        return math.nan
    return max(min(abs(pole - other) for other in found) for pole in truth)


def _row(
    example: str, truth: LoopModel, found: Sequence[Estimate], search: Sequence[Estimate]
) -> Summary:
    bands, jumps = [one.stick_band for one in found], [one.slip_jump for one in found]
    true_poles = poles_of(truth.process)
    slowest = [abs(one.poles[0]) for one in found if one.poles]
    farthest = [_farthest(one.poles, true_poles) for one in found if one.poles]
    ratios = [base.cost / one.cost for base, one in zip(search, found, strict=True)]
    verdicts = [one.verdict == "stiction" for one in found if one.verdict]
    seconds = float(np.median([one.seconds for one in found]))
    return Summary(
        example=example,
        method=found[0].method,
        windows=len(found),
        stiction=sum(verdicts) / len(verdicts) if verdicts else math.nan,
        static_friction=_error(
            [0.5 * (s + j) for s, j in zip(bands, jumps, strict=True)], truth.valve.static_friction
        ),
        dynamic_friction=_error(
            [0.5 * (s - j) for s, j in zip(bands, jumps, strict=True)], truth.valve.dynamic_friction
        ),
        stick_band=_error(bands, truth.valve.stick_band),
        stick_band_p90=_error(bands, truth.valve.stick_band, 0.9),
        slip_jump=_error(jumps, truth.valve.slip_jump),
        gain=_error([one.gain for one in found], truth.process.gain),
        slowest_pole=_error(slowest, abs(true_poles[0])),
        poles=float(np.median(farthest)) if farthest else math.nan,
        cover_stick_band=_coverage(
            [one.stick_band_interval for one in found], truth.valve.stick_band
        ),
        cover_slip_jump=_coverage([one.slip_jump_interval for one in found], truth.valve.slip_jump),
        cover_gain=_coverage([one.gain_interval for one in found], truth.process.gain),
        # A window that the search could not judge has no cost, and counts against it.
        no_worse=float(np.mean([ratio <= 1.0 + _NO_WORSE for ratio in ratios])),
        worst_cost=max(math.inf if math.isnan(ratio) else ratio for ratio in ratios),
        seconds=seconds,
        time_ratio=seconds / float(np.median([one.seconds for one in search])),
    )


def summarise(
    example: str, truth: LoopModel, windows: Sequence[Sequence[Estimate]]
) -> list[Summary]:
    """A row for every method; the first estimate of a window is the search's."""
    rows = []
    for method in dict.fromkeys(one.method for window in windows for one in window):
        pairs = [(one, window[0]) for window in windows for one in window if one.method == method]
        rows.append(_row(example, truth, [one for one, _ in pairs], [base for _, base in pairs]))
    return rows


def published(example: Example) -> Summary:
    """The paper's own figures as a row; its seconds are those of its machine."""
    said = example.published
    half = len(said.theta) // 2
    theta = ProcessModel(said.theta[:half], said.theta[half:], 1, 0.0, 1.0)
    frictions = (said.static_friction, said.dynamic_friction)
    fit = Estimate(
        method=f"the paper ({frictions[0]:g}/{frictions[1]:g}, its machine)",
        stick_band=sum(frictions),
        slip_jump=frictions[0] - frictions[1],
        gain=said.gain,
        poles=poles_of(theta),
        cost=math.nan,
        seconds=said.seconds,
        stem0=math.nan,
    )
    truth = LoopModel(example.valve, example.process)
    row: dict[str, Any] = {
        name: getattr(_row(example.name, truth, [fit], [fit]), name)
        for name in Summary.__dataclass_fields__
    }
    nothing = dict.fromkeys(("stick_band_p90", "no_worse", "worst_cost", "time_ratio"), math.nan)
    return Summary(**{**row, **nothing})
