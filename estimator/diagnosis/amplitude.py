"""Whether noise keeps an oscillation going, or something of steady strength makes it.

Noise that keeps exciting a resonance makes an amplitude that wanders: it is distributed as Rayleigh
has it (1880), with a deviation of 0.52 of its mean. A wave from a machine or from another loop's
limit cycle has one amplitude.
"""

from __future__ import annotations

import math

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.coherence import LoopSignals, LoopSpectrum, spectrum_of
from estimator.diagnosis.loop_record import LoopRecord, without_setpoint_steps
from estimator.diagnosis.oscillation import Oscillation
from estimator.diagnosis.settings import DiagnosisSettings

__all__ = ["amplitude_variation", "swing_amplitude", "variation_of"]

_ENDS = 20
"""One part of so many is left out at each end of the record, where the band is cut."""


def amplitude_variation(signal: Array, period: float, width: float) -> float:
    """Deviation of an oscillation's amplitude over its mean; NaN where the record is too short.

    Args:
        signal: without holes, ``(n,)``.
        period: samples.
        width: half of the band's width over its frequency.
    """
    return variation_of(spectrum_of(LoopSignals(signal, None, None, 1.0)), period, width)


def variation_of(spectrum: LoopSpectrum, period: float, width: float) -> float:
    """The same of a loop's spectrum; ``period`` in seconds."""
    _, amplitudes = spectrum.amplitudes(1.0 / period, width / period)
    size = np.abs(amplitudes)
    size = size[size.size // _ENDS : size.size - size.size // _ENDS]
    mean = float(size.mean()) if size.size > 1 else 0.0
    return float(size.std()) / mean if mean > 0.0 else math.nan


def swing_amplitude(record: LoopRecord, swing: Oscillation, settings: DiagnosisSettings) -> float:
    """How much the amplitude of the main oscillation wanders in the error; NaN without one."""
    if not swing.present or record.error is None:
        return math.nan
    calm = without_setpoint_steps(record.error, record.sp)
    return amplitude_variation(calm, swing.period_s / record.period, settings.grouping.width)
