"""Choudhury's higher-order statistics: a loop whose error is nonlinear, then the ellipse's width.

Source: Choudhury, Shah and Thornhill (2004), "Diagnosis of poor control-loop performance using
higher-order statistics", Automatica 40, 1719-1728, and Choudhury, Shah, Thornhill and Shook (2006),
"Automatic detection and quantification of stiction in control valves", Control Engineering
Practice 14, 1395-1412.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from benchmarks.published.finding import Finding
from estimator import EstimatorError
from estimator.monitoring.indices import apparent_stiction

__all__ = ["judge_bicoherence"]

Array = NDArray[np.float64]

SEGMENT = 64
"""Samples of a segment; the paper takes 64 to 128 of 4096, our windows are shorter."""
LEAST_NON_GAUSSIAN, LEAST_NONLINEAR = 0.001, 0.01
"""NGI and NLI above which the paper calls the loop nonlinear."""
NOISE_FLOOR = 0.01
"""Added to the denominator as a share of its largest value, as the paper advises for rounding."""


def _bicoherence(signal: Array) -> tuple[Array, int]:
    """Squared bicoherence of all frequency pairs of the principal domain, and segments used."""
    starts = range(0, signal.size - SEGMENT + 1, SEGMENT // 2)
    window = np.hanning(SEGMENT)
    pieces = np.array([signal[a : a + SEGMENT] for a in starts])
    spectra = np.fft.fft((pieces - pieces.mean(axis=1, keepdims=True)) * window, axis=1)
    half = SEGMENT // 2
    pairs = [(i, j) for i in range(1, half) for j in range(1, i + 1) if i + j < half]
    first, second = np.array(pairs).T
    product = spectra[:, first] * spectra[:, second]
    third = spectra[:, first + second]
    top = np.abs((product * third.conj()).mean(axis=0)) ** 2
    bottom = (np.abs(product) ** 2).mean(axis=0) * (np.abs(third) ** 2).mean(axis=0)
    return top / (bottom + NOISE_FLOOR * bottom.max()), len(pieces)


def judge_bicoherence(op: Array, pv: Array, sp: Array | None = None) -> Finding:
    """Non-Gaussianity of the control error as score; S by the ellipse of a nonlinear loop.

    The paper has 4096 samples and tests every pair of frequencies at 5 %. Windows here are shorter,
    so that by chance some pair always passes: the 5 % are divided among the pairs.
    """
    error = pv - (pv.mean() if sp is None else sp)
    deviation = float(error.std())
    if error.size < 3 * SEGMENT or deviation == 0.0:
        return Finding("undecided", math.nan)
    squared, segments = _bicoherence((error - error.mean()) / deviation)
    critical = float(chi2.ppf(1.0 - 0.05 / squared.size, 2)) / (2.0 * segments)
    significant = squared[squared > critical]
    if significant.size == 0:
        return Finding("no_stiction", float(squared.max()) - critical)
    non_gaussian = float(significant.mean()) - critical
    nonlinear = float(squared.max() - squared.mean() - 2.0 * squared.std())
    if non_gaussian <= LEAST_NON_GAUSSIAN or nonlinear <= LEAST_NONLINEAR:
        return Finding("no_stiction", non_gaussian)
    try:
        width = apparent_stiction(op, pv).apparent_stiction
    except EstimatorError:
        return Finding("undecided", non_gaussian)
    return Finding("stiction" if width > 0.0 else "undecided", non_gaussian, stick_band=width)
