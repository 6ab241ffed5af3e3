"""Does a signal oscillate, with which period, how regularly and how far?

    found = detect_oscillation(pv - sp, period=1.0)
    found.present, found.period_s, found.regularity

The autocorrelation's zero crossings tell period and regularity (Thornhill, Huang and Zhang, 2003):
noise harms the autocorrelation at lag zero only. A slow trend or a second oscillation hides the
crossings of the wanted one, so the signal is looked at in a band around each high peak of its
spectrum. The band is two octaves wide: noise holds too many frequencies there to swing regularly.

An oscillation must also stand out: with its harmonics it makes most of what moves as fast as itself
or faster (a trend does not count against it), and either its peak is far above the smooth spectrum
around it, or the autocorrelation comes back at least half way (Miao and Seborg, 1999).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
from scipy import fft, special

from estimator.arrays import Array
from estimator.diagnosis.settings import DIAGNOSIS, Judging, Swinging
from estimator.diagnosis.swing_share import local_share
from estimator.outcomes import EstimatorError
from estimator.window import bridge

__all__ = [
    "Oscillation",
    "autocorrelation",
    "band_of",
    "detect_oscillation",
    "detect_oscillations",
    "has_steady_period",
]

Spectrum = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Oscillation:
    """What a window says about its main oscillation.

    Attributes:
        present: whether there is a regular one.
        period_s: period in seconds, NaN where no band has enough zero crossings.
        regularity: mean period over three standard deviations of the periods; above 1 is regular.
        amplitude: half the distance from trough to peak, in units of the signal.
        cycles: periods in the window.
        decay: height of the autocorrelation two periods away, 0 to 1; 1 lasts for ever.
        share: share of the oscillation in all that moves as fast or faster, 0 to 1.
        prominence: minus the logarithm of the probability that noise makes a peak as high.
    """

    present: bool
    period_s: float
    regularity: float
    amplitude: float
    cycles: float
    decay: float
    share: float
    prominence: float

    @property
    def frequency(self) -> float:
        """Cycles per second."""
        return 1.0 / self.period_s


_NOTHING = Oscillation(False, math.nan, 0.0, math.nan, 0.0, 0.0, 0.0, 0.0)


def detect_oscillation(
    values: ArrayLike, *, period: float = 1.0, settings: Swinging = DIAGNOSIS.swinging
) -> Oscillation:
    """Find the main oscillation of a signal.

    Args:
        values: samples, shape ``(n,)``, NaN where bad; the control error, PV or OP.
        period: seconds between samples.
        settings: see `estimator.diagnosis.settings`.

    Returns:
        The oscillation of the largest amplitude among those that are present; the nearest to one,
        with ``present`` False, where none is.

    Raises:
        EstimatorError: not a row of samples, no finite one, or a period that is not above zero.

    Source: Thornhill, Huang and Zhang (2003), "Detection of multiple oscillations in control
    loops", Journal of Process Control 13, 91-100; Miao and Seborg (1999), "Automatic detection of
    excessively oscillatory feedback control loops", IEEE Conference on Control Applications,
    359-364.
    """
    judged = detect_oscillations(values, period=period, settings=settings)
    return judged[0] if judged else _NOTHING


def detect_oscillations(
    values: ArrayLike, *, period: float = 1.0, settings: Swinging = DIAGNOSIS.swinging
) -> tuple[Oscillation, ...]:
    """Find every oscillation of a signal, those that are present first, then by amplitude.

    Arguments and errors are those of `detect_oscillation`.
    """
    if not (math.isfinite(period) and period > 0.0):
        raise EstimatorError(f"period is {period!r}: give the seconds between samples, above zero")
    x = bridge(values)
    flat = float(np.ptp(x)) <= 1e-12 * max(1.0, float(np.abs(x).max()))
    if x.size < settings.least_samples or flat:
        return ()
    x = np.asarray(scipy.signal.detrend(x))
    power = np.abs(fft.rfft(x * scipy.signal.windows.hann(x.size, sym=False))) ** 2
    spectrum, padded = _mirrored_spectrum(x)
    found: list[Oscillation] = []
    for frequency in _peaks(power, x.size, settings):
        one = _in_band(spectrum, padded, x.size, frequency, settings)
        if math.isnan(one.period_s):
            continue
        one = replace(
            one,
            share=local_share(power, x.size, one.period_s, settings),
            prominence=_prominence(power, x.size, frequency, settings),
        )
        _merge(found, one, settings)
    judged = [replace(one, present=_is_present(one, settings)) for one in found]
    present = [one for one in judged if one.present]

    def order(one: Oscillation) -> tuple[bool, bool, float]:
        # the band around a harmonic may hold more of them than that around the fundamental
        is_harmonic = any(_is_harmonic(one, other, settings) for other in present)
        return not one.present, is_harmonic, -one.amplitude * min(1.0, one.regularity)

    judged.sort(key=order)
    return tuple(replace(one, period_s=one.period_s * period) for one in judged)


def has_steady_period(one: Oscillation, judging: Judging) -> bool:
    """Whether the periods hardly scatter, or the phase is kept for many of them.

    Noise moves the zero crossings of a pulse train or a saw-tooth far more than those of a sine, so
    its periods scatter; two periods later its course is still the same.
    """
    lasts = one.cycles >= judging.lasting_periods and one.decay >= judging.kept
    return lasts or one.regularity >= judging.steady


def band_of(x: Array, frequency: float, settings: Swinging = DIAGNOSIS.swinging) -> Array:
    """The part of a signal ``(n,)`` in the band around a frequency (cycles a sample)."""
    spectrum, padded = _mirrored_spectrum(np.asarray(scipy.signal.detrend(x)))
    return _filtered(spectrum, padded, x.size, frequency, settings)


def autocorrelation(y: Array) -> Array:
    """Autocorrelation ``(n,)`` from lag 0 on, each lag divided by its number of products."""
    n = y.size
    size = fft.next_fast_len(2 * n, real=True)
    power = np.abs(fft.rfft(y, size)) ** 2
    found = np.asarray(fft.irfft(power, size))[:n] / np.arange(n, 0, -1)
    return found / found[0] if found[0] > 0.0 else np.zeros(n)


def _is_present(one: Oscillation, settings: Swinging) -> bool:
    # slow frequencies are fewer: the number tried grows with the cycles
    stands_out = one.prominence > math.log(2.0 * one.cycles / settings.alarms)
    return (
        one.regularity > settings.regularity
        and one.cycles >= settings.least_cycles
        and one.share > settings.share
        and (stands_out or one.decay > settings.decay)
    )


def _is_harmonic(one: Oscillation, of: Oscillation, settings: Swinging) -> bool:
    ratio = of.period_s / one.period_s
    is_multiple = ratio > 1.5 and abs(ratio - round(ratio)) < settings.same
    # three in ten slower motions have such a ratio by chance, many of them far smaller
    return is_multiple and of.amplitude > settings.fundamental * one.amplitude


def _merge(found: list[Oscillation], one: Oscillation, settings: Swinging) -> None:
    """Add an oscillation; one of the same period is the same, with the better figures of both."""
    for i, other in enumerate(found):
        if abs(other.period_s / one.period_s - 1.0) < settings.same:
            clearer = max(one, other, key=lambda o: o.decay)
            found[i] = replace(
                clearer,
                regularity=max(one.regularity, other.regularity),
                amplitude=max(one.amplitude, other.amplitude),
                share=max(one.share, other.share),
                prominence=max(one.prominence, other.prominence),
            )
            return
    found.append(one)


def _mirrored_spectrum(x: Array) -> tuple[Spectrum, int]:
    """Spectrum of the signal beside its mirror image, so that a band keeps its ends clean."""
    padded = fft.next_fast_len(2 * x.size, real=True)
    return np.asarray(fft.rfft(np.concatenate([x, x[::-1]]), padded)), padded


def _peaks(power: Array, n: int, settings: Swinging) -> list[float]:
    """Frequencies (cycles a sample) where power times frequency is high, the highest first.

    Power times frequency is the power in a band of constant width in octaves: a slow drift, whose
    power falls with frequency, makes no peak of it.
    """
    frequency = np.arange(power.size) / n
    weight = power * frequency
    weight[(frequency < settings.least_cycles / n) | (frequency > settings.fastest)] = 0.0
    found: list[float] = []
    for _ in range(settings.peaks):
        k = int(weight.argmax())
        if not weight[k] > 0.0:
            break
        found.append(k / n)
        ratio = frequency * n / k
        weight[(ratio > 1.0 / settings.apart) & (ratio < settings.apart)] = 0.0
    return found


def _filtered(
    spectrum: Spectrum, padded: int, n: int, frequency: float, settings: Swinging
) -> Array:
    f = np.arange(spectrum.size) / padded
    octaves = np.abs(np.log2(np.maximum(f, 1e-12) / frequency))
    # flanks of half an octave
    flank = np.clip((settings.octaves + 0.25 - octaves) / 0.5, 0.0, 1.0)
    kept = spectrum * (0.5 - 0.5 * np.cos(math.pi * flank))
    return np.asarray(fft.irfft(kept, padded))[:n]


def _in_band(
    spectrum: Spectrum, padded: int, n: int, frequency: float, settings: Swinging
) -> Oscillation:
    """The oscillation in the band around one frequency; times in samples."""
    y = _filtered(spectrum, padded, n, frequency, settings)
    lags = autocorrelation(y)[: max(8, int(settings.lags * n))]
    gaps = np.diff(_crossings(lags)[: settings.intervals + 1])
    if gaps.size < settings.least_intervals:
        return _NOTHING
    mean = 2.0 * float(gaps.mean())
    spread = 2.0 * float(gaps.std(ddof=1))
    regularity = min(settings.most, mean / (3.0 * spread)) if spread > 0.0 else settings.most
    return replace(
        _NOTHING,
        period_s=mean,
        regularity=regularity,
        amplitude=math.sqrt(2.0 * float(np.mean(y * y))),
        cycles=n / mean,
        decay=_height(lags, 2.0 * mean, 0.25 * mean),
    )


def _crossings(values: Array) -> Array:
    left, right = values[:-1], values[1:]
    at = np.flatnonzero((left > 0.0) != (right > 0.0))
    return np.asarray(at + left[at] / (left[at] - right[at]))


def _height(lags: Array, at: float, reach: float) -> float:
    around = lags[int(at - reach) : int(at + reach) + 2]
    return max(0.0, float(around.max())) if around.size else 0.0


_EULER = 0.5772
"""The mean logarithm of a periodogram's value lies this far below the logarithm of its mean."""


def _prominence(power: Array, n: int, frequency: float, settings: Swinging) -> float:
    """Minus log probability of a peak that high, over a straight line in log power and frequency.

    The peak may be one line or some bins wide; the likeliest width counts.
    """
    f = np.arange(power.size) / n
    reach = 2.0**settings.around
    near = (f > frequency / reach) & (f < min(0.5, frequency * reach)) & (f > 1.5 / n)
    centre = round(frequency * n)
    best, width = 0.0, 1
    while width == 1 or width <= 0.25 * centre:
        outside = near.copy()
        outside[max(0, centre - width - 1) : centre + width + 2] = False
        if int(outside.sum()) >= 4:
            x = np.log(f[outside] / frequency)
            level = np.log(power[outside] + 1e-300) + _EULER
            # bins are equally far apart: an octave of high ones holds more
            weight = 1.0 / f[outside]
            weight /= weight.sum()
            x_mean, mean = float(weight @ x), float(weight @ level)
            slope = float(weight @ ((x - x_mean) * level)) / float(weight @ (x - x_mean) ** 2)
            floor = math.exp(mean - slope * x_mean)
            bins = power[max(1, centre - width) : centre + width + 1]
            # a Hann window makes three neighbours worth two
            free = bins.size / 1.5
            tail = special.gammaincc(free, float(bins.sum()) / floor / 1.5)
            best = max(best, -math.log(max(float(tail), 1e-300)))
        width *= 2
    return best
