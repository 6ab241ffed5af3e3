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

__all__ = [
    "amplitude_variation",
    "amplitudes_of",
    "phase_kept_by",
    "swing_amplitude",
    "variation_of",
]

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
    return amplitude_variation(amplitudes_of(spectrum, period, width))


def amplitudes_of(spectrum: LoopSpectrum, period: float, width: float) -> Complex:
    """Complex amplitudes of an oscillation along a record without its ends; see `variation_of`."""
    _, found = spectrum.amplitudes(1.0 / period, width / period)
    return found[found.size // _ENDS : found.size - found.size // _ENDS]


def amplitude_variation(amplitudes: Complex) -> float:
    """Deviation of the size of complex amplitudes over its mean; NaN where there are too few."""
    size = np.abs(amplitudes)
    mean = float(size.mean()) if size.size > 1 else 0.0
    return float(size.std()) / mean if mean > 0.0 else math.nan


def phase_kept_by(amplitudes: Complex) -> float:
    """Share of the squared size of complex amplitudes that keeps one phase, 0 to 1; NaN without.

    At the frequency, near that of the amplitudes, that shows most of it.
    """
    square = amplitudes**2
    whole = float(np.abs(square).sum())
    if whole <= 0.0:
        return math.nan
    return float(np.abs(fft.fft(square, fft.next_fast_len(_BETWEEN * square.size))).max()) / whole


def swing_amplitude(
    record: LoopRecord, swing: Oscillation, settings: DiagnosisSettings
) -> tuple[float, float]:
    """How much the amplitude of the main oscillation wanders in the error, and the share in phase.

    See `amplitude_variation` and `phase_kept_by`; NaN without an oscillation.
    """
    if not swing.present or record.error is None:
        return math.nan, math.nan
    calm = without_setpoint_steps(record.error, record.sp)
    spectrum = spectrum_of(LoopSignals(calm, None, None, record.period))
    found = amplitudes_of(spectrum, swing.period_s, settings.grouping.width)
    return amplitude_variation(found), phase_kept_by(found)
