"""What a window of samples shows: the stem, how far it travels, and the oscillation of PV."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from estimator import EstimatorError, Interval
from estimator.monitoring.indices import oscillation, valve_wear
from estimator.valves import laws
from fieldlink.stem_start import likeliest_start
from fieldlink.worklist.row import Figures
from fieldlink.worklist.settings import WorkListSettings

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["WindowSamples", "figures_of", "interval_of", "loss_of"]

Array = NDArray[np.float64]

_SETTINGS = WorkListSettings()


@dataclass(frozen=True, slots=True, eq=False)
class WindowSamples:
    """OP and PV of one window, NaN where bad, and what the estimator says of the valve.

    Attributes:
        op, pv: shape ``(n,)``.
        sp: likewise; None where the loop has none.
        stem: estimated stem; None where no sticky valve was found.
        period: seconds between samples.
        auto: 1 in automatic, 0 in manual; None where the mode is not recorded.
    """

    op: Array
    pv: Array
    sp: Array | None
    stem: Array | None
    period: float
    auto: Array | None = None

    @classmethod
    def of_frame(
        cls, frame: pd.DataFrame, period: float, document: Mapping[str, Any] | None
    ) -> WindowSamples | None:
        """Build from `fieldlink.store.FleetReader.samples`; None where there is too little.

        Missed slots are rows of NaN. A history whose numbering of slots has started again is cut to
        what came since.
        """
        slots = frame["slot"].to_numpy(dtype=np.int64)
        breaks = np.flatnonzero(np.diff(slots) <= 0)
        if breaks.size:
            frame = frame.iloc[int(breaks[-1]) + 1 :]
            slots = frame["slot"].to_numpy(dtype=np.int64)
        # A pause of many windows would be mostly holes.
        wide = np.flatnonzero(np.diff(slots) > max(len(slots), 1))
        if wide.size:
            frame = frame.iloc[int(wide[-1]) + 1 :]
        if len(frame) < 2:
            return None
        whole = frame.set_index("slot")
        whole = whole.reindex(range(int(whole.index[0]), int(whole.index[-1]) + 1))
        op, pv, sp = (whole[name].to_numpy(dtype=np.float64) for name in ("op", "pv", "sp"))
        if not (np.isfinite(op).any() and np.isfinite(pv).any()):
            return None
        return cls(op, pv, sp if np.isfinite(sp).any() else None, _stem(op, pv, document), period)

    @property
    def error(self) -> Array:
        """The control error; PV where there is no set-point."""
        return self.pv if self.sp is None else self.pv - self.sp

    @property
    def swing(self) -> tuple[bool, float]:
        """Whether the control error oscillates regularly, and its period in seconds (else NaN)."""
        try:
            found = oscillation(self.error, period=self.period)
        except EstimatorError:
            return False, math.nan
        return found.is_regular, found.period_s if found.is_regular else math.nan


def figures_of(
    samples: WindowSamples | None, document: Mapping[str, Any] | None, span: float
) -> Figures:
    """Return the figures of a window; NaN for what it does not show.

    Figures that were stored with the estimate are taken as they are: they are of exactly its
    window, and stay when the samples are gone.

    Args:
        samples: of the window; None where they are gone.
        document: the estimator's result as it was stored.
        span: OP's span, units of OP.
    """
    percent = 100.0 / span
    band = jump = math.nan
    if document is not None and document.get("verdict") == "stiction":
        band, jump = (percent * _value(document, name) for name in ("stick_band", "slip_jump"))
    stored = None if document is None else document.get("window")
    shown = stored or {}
    if not stored and samples is not None:
        shown = _measure(samples, _SETTINGS.dead_band / percent)

    def figure(name: str) -> float:
        value = shown.get(name)
        return math.nan if value is None else float(value)

    return Figures(
        stick_band=band,
        slip_jump=jump,
        loss=loss_of(document),
        pv_std=figure("pv_std"),
        travel_per_day=percent * figure("travel_per_day"),
        reversals_per_day=figure("reversals_per_day"),
        period_s=figure("swing_period_s"),
        windows=1,
    )


def _measure(samples: WindowSamples, dead_band: float) -> dict[str, float]:
    """The figures that a daemon may store with an estimate, by the same names."""
    error = samples.error
    found = {"swing_period_s": samples.swing[1], "pv_std": math.nan}
    if np.isfinite(error).any():
        found["pv_std"] = float(np.nanstd(error))
    try:
        wear = valve_wear(samples.op, period=samples.period, deadband=dead_band)
    except EstimatorError:
        return found
    return found | {
        "travel_per_day": wear.travel_per_day,
        "reversals_per_day": wear.reversals_per_day,
    }


def interval_of(document: Mapping[str, float | None]) -> Interval:
    """Return the interval of ``{"value", "low", "high"}``; NaN stands for null."""
    value, low, high = (
        math.nan if (number := document[key]) is None else float(number)
        for key in ("value", "low", "high")
    )
    return Interval(value, low, high)


def loss_of(document: Mapping[str, Any] | None) -> float:
    """Return the share of PV's variance that sticking makes, 0 where the valve does not stick."""
    if document is None or document.get("verdict") == "not_assessable":
        return math.nan
    if document.get("verdict") != "stiction":
        return 0.0
    effect = (document.get("evidence") or {}).get("effect")
    return math.nan if effect is None else min(1.0, max(0.0, float(effect)))


def _stem(op: Array, pv: Array, document: Mapping[str, Any] | None) -> Array | None:
    """The stem that the identified valve makes of OP; bad samples hold the last good OP.

    None, too, where PV tells that the simulated stem is not the true one.
    """
    if document is None or document.get("verdict") != "stiction":
        return None
    band, jump = _value(document, "stick_band"), _value(document, "slip_jump")
    law = (document.get("evidence") or {}).get("law")
    if not (math.isfinite(band) and math.isfinite(jump)) or law not in laws.LAWS:
        return None
    good = np.isfinite(op)
    last = np.maximum.accumulate(np.where(good, np.arange(op.size), np.argmax(good)))
    held = op[last]

    def simulate(start: float) -> Array:
        return np.asarray(laws.stem_of(held, str(law), (band, jump, start)))

    start = likeliest_start(simulate, held, pv, stick_band=band, slip_jump=jump)
    return None if start is None else simulate(start)


def _value(document: Mapping[str, Any] | None, name: str) -> float:
    found = None if document is None else (document.get(name) or {}).get("value")
    return math.nan if found is None else float(found)
