"""Whether noise keeps an oscillation going, or something of steady strength makes it.

Noise that keeps exciting a resonance makes an amplitude that wanders: it is distributed as Rayleigh
has it (1880), with a deviation of 0.52 of its mean. A wave from a machine or from another loop's
limit cycle has one amplitude.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import fft

from estimator.diagnosis.coherence import Complex, LoopSignals, LoopSpectrum, spectrum_of
from estimator.diagnosis.loop_record import LoopRecord, without_setpoint_steps
from estimator.diagnosis.oscillation import Oscillation
from estimator.diagnosis.settings import DiagnosisSettings

__all__ = ["phase_kept_by", "swing_amplitude", "variation_of"]

_ENDS = 20
"""One part of so many is left out at each end of the record, where the band is cut."""
_BETWEEN = 8
"""Frequencies that are tried for each independent one: the nearest then shows 97 % and more."""


def variation_of(spectrum: LoopSpectrum, period: float, width: float) -> float:
    """Deviation of an oscillation's amplitude over its mean; NaN where the record is too short.

    Args:
        spectrum: of the signal.
        period: of the oscillation, seconds.
        width: half of the band's width over its frequency.
    """
    size = np.abs(_amplitudes(spectrum, period, width))
    mean = float(size.mean()) if size.size > 1 else 0.0
    return float(size.std()) / mean if mean > 0.0 else math.nan


def phase_kept_by(spectrum: LoopSpectrum, period: float, width: float) -> float:
    """Share of an oscillation's squared amplitude that keeps one phase, 0 to 1; NaN without one.

    At the frequency, near 1 over ``period`` (seconds), that shows most of it.
    """
    square = _amplitudes(spectrum, period, width) ** 2
    whole = float(np.abs(square).sum())
    if whole <= 0.0:
        return math.nan
    return float(np.abs(fft.fft(square, fft.next_fast_len(_BETWEEN * square.size))).max()) / whole


def _amplitudes(spectrum: LoopSpectrum, period: float, width: float) -> Complex:
    _, found = spectrum.amplitudes(1.0 / period, width / period)
    return found[found.size // _ENDS : found.size - found.size // _ENDS]


def swing_amplitude(
    record: LoopRecord, swing: Oscillation, settings: DiagnosisSettings
) -> tuple[float, float]:
    """How much the amplitude of the main oscillation wanders in the error, and the share in phase.

    See `variation_of` and `phase_kept_by`; NaN without an oscillation.
    """
    if not swing.present or record.error is None:
        return math.nan, math.nan
    calm = without_setpoint_steps(record.error, record.sp)
    spectrum = spectrum_of(LoopSignals(calm, None, None, record.period))
    width = settings.grouping.width
    return (
        variation_of(spectrum, swing.period_s, width),
        phase_kept_by(spectrum, swing.period_s, width),
    )
