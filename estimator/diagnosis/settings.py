"""Every number of the diagnosis that somebody chose: what it means, its unit, where it is from.

None was chosen by a recorded loop. "Tuning family" is ``benchmarks.diagnosis_families.tuning``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = ["DIAGNOSIS", "DiagnosisSettings", "Reading", "Swinging", "Weighing"]


@dataclass(frozen=True, slots=True)
class Swinging:
    """When a signal is called oscillating.

    Attributes:
        least_samples: fewer samples hold no three periods and their noise.
        least_cycles: three periods show the period twice; fewer are a drift.
        fastest: highest frequency, cycles a sample: a period needs four samples to be seen.
        peaks: peaks of the spectrum that are looked at; a loop has seldom more than three
            oscillations (Thornhill 2003).
        apart: factor between the frequencies of two peaks.
        same: periods nearer than this share are one oscillation.
        octaves: half-width of a band in octaves.
        lags: share of the window whose lags count; later ones rest on few products.
        intervals, least_intervals: zero crossings' intervals that are used (ten: Thornhill 2003),
            and the fewest from which a spread is taken.
        regularity: limit of Thornhill's regularity.
        decay: height of the autocorrelation two periods away that needs no other proof; 0.5 over
            one period is the limit of Miao and Seborg (1999).
        local, share: half-width in octaves and least share of the oscillation in all that moves
            as fast: one half, so that it is the main motion.
        trend: what is slower than so many periods is a trend.
        around: octaves on each side whose spectrum is the background of a peak.
        alarms: probability that noise is taken for an oscillation by its highest peak (tuning
            family: one in fifty drifting signals is still called oscillating).
        most: largest regularity that is told; a pure sine has no spread.
    """

    least_samples: int = 40
    least_cycles: float = 3.0
    fastest: float = 0.25
    peaks: int = 4
    apart: float = 1.7
    same: float = 0.15
    octaves: float = 1.0
    lags: float = 0.7
    intervals: int = 10
    least_intervals: int = 5
    regularity: float = 1.0
    decay: float = 0.5
    local: float = 0.5
    share: float = 0.5
    trend: float = 3.0
    around: float = 1.5
    alarms: float = 1e-3
    most: float = 100.0


@dataclass(frozen=True, slots=True)
class Reading:
    """How the controller is read off the record.

    Attributes:
        least_rows: fewer usable rows do not tell four unknowns.
        exact: share of OP's moves from which the record is what the controller saw.
        resolution: share of the moves' variance that rounding of a record leaves at least.
        reaches: samples over which noisy records are summed.
        least_explained: share of OP's moves below which OP does not answer the error.
    """

    least_rows: int = 40
    exact: float = 0.97
    resolution: float = 1e-7
    reaches: tuple[int, ...] = (1, 2, 4, 8, 16, 32)
    least_explained: float = 0.3


@dataclass(frozen=True, slots=True)
class Weighing:
    """How the explanations of a window are compared.

    Attributes:
        jump: innovations beyond so many robust deviations are jumps of the load; normal noise has
            one of five in a million.
        most_jumps: share of rows that may be left out as jumps; more is the noise itself.
        harmonics: waves from outside: a sine, and one of any shape.
        radii: damping ratios of a resonance for a wave whose phase wanders.
        bends: curvatures over OP's span in the window: at 1 the gain varies by e, at 4 by 55, the
            range of an equal-percentage valve.
        parts, best_parts: parts of the window over which a sticky valve's evidence is spread, and
            how many of the best are left out.
    """

    jump: float = 5.0
    most_jumps: float = 0.05
    harmonics: tuple[tuple[int, ...], ...] = ((1,), (1, 2, 3))
    radii: tuple[float, ...] = (0.002, 0.02)
    bends: tuple[float, ...] = (0.5, 1.0, 2.0, 3.0, 4.5)
    parts: int = 8
    best_parts: int = 2


@dataclass(frozen=True, slots=True)
class DiagnosisSettings:
    """All settings of a diagnosis."""

    swinging: Swinging = field(default_factory=Swinging)
    reading: Reading = field(default_factory=Reading)
    weighing: Weighing = field(default_factory=Weighing)


DIAGNOSIS = DiagnosisSettings()
