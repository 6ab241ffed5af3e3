"""Work for the estimator's processes: why the loop of a window swings, and which loops together.

What crosses the process border is plain, but for the packed part that only another worker opens:
the daemon's own process does without the estimator.
"""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldlink.daemon.windows.window import WindowData

__all__ = ["DiagnosisRequest", "WindowDiagnosis", "diagnose_window", "group_windows"]

Floats = NDArray[np.float64]

KEPT = 4000
"""Samples of a loop that are kept to find groups: 100 kB a loop, and 250 periods of 16 samples."""


@dataclass(frozen=True, slots=True)
class DiagnosisRequest:
    """A full window of a loop.

    Attributes:
        period: plant seconds between samples.
        ended_s: plant seconds from the end of the window to a moment that is the same for all loops
            of a round; negative where the window ended before it.
        begin_ms: stamp of the first slot, UTC.
        compensated: whether a block may have been in force during the window.
        valve_is_healthy: whether the estimator found the valve healthy in this window.
        op_span: OP's span in its own units; None where the register map is silent.
    """

    loop: str
    window: WindowData
    period: float
    ended_s: float
    begin_ms: int
    compensated: bool = False
    valve_is_healthy: bool = False
    op_span: float | None = None


@dataclass(frozen=True, slots=True)
class WindowDiagnosis:
    """What a worker found.

    Attributes:
        document: `estimator.diagnosis.Diagnosis.to_dict`.
        packed: the diagnosis and thinned signals, for `group_windows`.
    """

    document: Mapping[str, Any]
    packed: bytes


def diagnose_window(request: DiagnosisRequest) -> WindowDiagnosis | str:
    """Diagnose a window; a sentence where it is none."""
    from estimator import EstimatorError
    from fieldlink.diagnosis import LoopSignals, diagnose

    window = request.window
    try:
        found = diagnose(
            window.op,
            window.pv,
            window.sp,
            auto=_held(window.auto),
            period=request.period,
            valve_is_healthy=request.valve_is_healthy,
            op_span=request.op_span,
        )
    except EstimatorError as error:
        return str(error)
    every = max(1, -(-window.op.size // KEPT))

    def thin(values: Any) -> Any:
        return values[: values.size // every * every].reshape(-1, every).mean(axis=1)

    has_sp = window.sp is not None and bool(np.isfinite(window.sp).any())
    signals = LoopSignals(
        op=thin(window.op),
        pv=thin(window.pv),
        sp=thin(window.sp) if has_sp else None,
        period=request.period * every,
        start_s=request.ended_s - request.period * (window.op.size - 1),
    )
    return WindowDiagnosis(found.to_dict(), pickle.dumps((found, signals)))


def group_windows(packed: Mapping[str, bytes]) -> list[dict[str, Any]]:
    """Find the groups that swing together; each as ``fieldlink diagnose --json`` prints it."""
    from fieldlink.diagnosis import find_groups

    # made by `diagnose_window` in a process of the same pool
    both = {name: pickle.loads(one) for name, one in packed.items()}
    groups = find_groups(
        {name: signals for name, (_, signals) in both.items()},
        {name: found for name, (found, _) in both.items()},
    )
    return [group.to_dict() for group in groups]


def _held(auto: Floats | None) -> Floats | None:
    """The mode with the last known value in its gaps: a missed sample is not a loop in manual."""
    if auto is None or not np.isfinite(auto).any():
        return None
    known = np.isfinite(auto)
    last = np.maximum.accumulate(np.where(known, np.arange(auto.size), int(np.argmax(known))))
    return np.asarray(auto[last])
