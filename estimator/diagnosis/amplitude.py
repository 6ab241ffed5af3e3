"""Whether noise keeps an oscillation going, or something of steady strength makes it.

Noise that keeps exciting a resonance makes an amplitude that wanders: it is distributed as Rayleigh
has it (1880), with a deviation of 0.52 of its mean. A wave from a machine or from another loop's
limit cycle has one amplitude, or changes its size and keeps its phase, or changes its phase and
keeps its size. Noise changes both alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import fft

from estimator.diagnosis.coherence import Complex, LoopSignals, LoopSpectrum, spectrum_of
from estimator.diagnosis.loop_record import LoopRecord, without_setpoint_steps
from estimator.diagnosis.oscillation import Oscillation
from estimator.diagnosis.settings import DiagnosisSettings

__all__ = [
    "amplitude_variation",
    "amplitudes_of",
    "evidence_against_noise",
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


def evidence_against_noise(amplitudes: Complex, apart: int, *, stepped: bool = False) -> float:
    """Log Bayes factor of size and phase that change unlike each other, nats; 0 where too short.

    What noise adds to an oscillation has no direction: beside the even course of the loop's own
    swing the amplitude moves along itself (the size changes) as far as across itself (the phase
    changes), whatever excites the loop. A machine of changing load moves along, one of changing
    speed across. So two variances of moves stand against one, with Schwarz's price of the second
    (1978, "Estimating the dimension of a model", Annals of Statistics 6, 461-464).

    The swing after a step of the load dies along itself as well: the few moves that are far larger
    than the usual ones are left out, in whatever direction they go. Steps of the set-point come in
    numbers; beside them a size that changes is no evidence.

    Args:
        amplitudes: along a record, ``(m,)``.
        apart: places between two values that are hardly alike in a band of noise.
        stepped: whether steps of the set-point excite the loop.
    """
    along, across, count, starts = 0.0, 0.0, 0.0, 0
    for first in range(apart):
        values = amplitudes[first::apart]
        if values.size < _FEWEST:
            continue
        # it turns evenly off the band's middle, and a loop near its limit dies or grows evenly
        power = float(np.sum(np.abs(values[:-1]) ** 2))
        course = np.sum(values[1:] * np.conj(values[:-1])) / max(power, _TINY)
        before = values[:-1] * course
        size = np.abs(before)
        used = size > 0.0
        moves = (values[1:] - before)[used] * np.conj(before[used]) / size[used]
        if moves.size < _FEWEST:
            continue
        far = np.abs(moves)
        moves = moves[far <= _FAR * float(np.median(far)) / _RAYLEIGH_MEDIAN]
        along += float(np.mean(moves.real**2))
        across += float(np.mean(moves.imag**2))
        count += moves.size
        starts += 1
    if not (starts and along > 0.0 and across > 0.0) or (stepped and along > across):
        return 0.0
    ratio = 0.5 * (along + across) / math.sqrt(along * across)
    count /= starts
    return count * math.log(ratio) - 0.5 * math.log(count)


_TINY = float(np.finfo(np.float64).tiny)
_FEWEST = 5
"""Values without which two variances cannot be compared."""
_FAR = 4.0
"""Deviations beyond which a move is no usual one: one of 3,000 of two normal parts."""
_RAYLEIGH_MEDIAN = math.sqrt(2.0 * math.log(2.0))
"""Median size of moves with two normal parts of deviation one."""


def swing_amplitude(
    record: LoopRecord, swing: Oscillation, settings: DiagnosisSettings
) -> tuple[float, float, float]:
    """How the amplitude of the main oscillation changes in the error.

    Returns:
        How much it wanders, the share in phase, and the evidence that no noise does it: see
        `amplitude_variation`, `phase_kept_by`, `evidence_against_noise`. Without an oscillation
        NaN, NaN and 0.
    """
    if not swing.present or record.error is None:
        return math.nan, math.nan, 0.0
    calm = without_setpoint_steps(record.error, record.sp)
    spectrum = spectrum_of(LoopSignals(calm, None, None, record.period))
    stepped = record.sp is not None and bool(np.ptp(record.sp) > 0.0)
    narrow, wide = settings.grouping.width, settings.grouping.wide
    band = _in_band(spectrum, swing.period_s, narrow, stepped=stepped)
    # a narrow band turns a phase that changes fast into a size that changes: a wide one shows both,
    # and the steps of a load as well, so that only a phase that changes beside a steady size tells
    whole = _in_band(spectrum, swing.period_s, wide, stepped=True)
    if not whole.variation < settings.judging.wanders:
        return band.variation, band.in_phase, band.unlike_noise
    size = float(np.fmin(band.variation, whole.variation))
    return size, band.in_phase, max(band.unlike_noise, whole.unlike_noise - math.log(2.0))


@dataclass(frozen=True, slots=True)
class _Band:
    """How the amplitude in a band around an oscillation changes; see `swing_amplitude`."""

    variation: float
    in_phase: float
    unlike_noise: float


def _in_band(spectrum: LoopSpectrum, period: float, width: float, *, stepped: bool) -> _Band:
    found = amplitudes_of(spectrum, period, width)
    times, _ = spectrum.amplitudes(1.0 / period, width / period)
    apart = 1
    if times.size > 1:
        # white noise in the band is alike by a half so far apart, and not at all twice as far
        apart = max(1, round(0.5 * period / width / (times[1] - times[0])))
    unlike = evidence_against_noise(found, apart, stepped=stepped)
    return _Band(amplitude_variation(found), phase_kept_by(found), unlike)
