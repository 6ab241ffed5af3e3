"""Every number of the diagnosis that somebody chose: what it means, its unit, where it is from.

The rule that finds an oscillation (its share in what moves as fast, less what a drift has in its
band) took its form after a look at recorded OP signals; its limits are round numbers with a reason.
Nothing else was chosen with recorded loops in view. "Tuning family" is
``benchmarks.diagnosis_families.tuning``. The numbers of groups and of proposed settings stand in
`grouping_settings` and `advice_settings`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from estimator.controller.settings import Reading
from estimator.diagnosis.advice_settings import Advising
from estimator.diagnosis.grouping_settings import Grouping
from estimator.settings import SETTINGS

__all__ = [
    "DIAGNOSIS",
    "Bispectrum",
    "DiagnosisSettings",
    "Facts",
    "Grouping",
    "Headroom",
    "Judging",
    "Reading",
    "Scope",
    "Swinging",
    "Weighing",
]


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
        fundamental: least amplitude of a fundamental over that of the band around its third
            harmonic: pulses have harmonics as large as the fundamental, five of them in that band,
            and a controller takes more of the fundamental, up to in proportion to the period.
        octaves: half-width of a band in octaves.
        lags: share of the window whose lags count; later ones rest on few products.
        intervals, least_intervals: zero crossings' intervals that are used (ten: Thornhill 2003),
            and the fewest from which a spread is taken.
        regularity: limit of Thornhill's regularity.
        decay: height of the autocorrelation two periods away that needs no other proof; 0.5 over
            one period is the limit of Miao and Seborg (1999).
        local, share: half-width in octaves and least share of the oscillation in all that moves
            as fast: one half, so that it is the main motion.
        beside: octaves on each side of that band that tell how much of it is drift: 0.4 and 0.6
            make a quarter fewer errors than none (`benchmarks.diagnosis_swings`).
        chance: standard errors by which the harmonics' power must exceed that between them: noise
            then passes for an oscillation no more often than without them.
        trend: what is slower than so many periods is a trend.
        around: octaves on each side whose spectrum is the background of a peak.
        alarms: probability that noise is taken for an oscillation by its highest peak, if its
            spectrum were a straight line; of slowly drifting noise up to one in ten signals is
            still called oscillating, of random walks one in twenty, of white noise none.
        most: largest regularity that is told; a pure sine has no spread.
    """

    least_samples: int = 40
    least_cycles: float = 3.0
    fastest: float = 0.25
    peaks: int = 4
    apart: float = 1.7
    same: float = 0.15
    fundamental: float = 0.15
    octaves: float = 1.0
    lags: float = 0.7
    intervals: int = 10
    least_intervals: int = 5
    regularity: float = 1.0
    decay: float = 0.5
    local: float = 0.5
    share: float = 0.5
    beside: float = 0.6
    chance: float = 2.0
    trend: float = 3.0
    around: float = 1.5
    alarms: float = 1e-3
    most: float = 100.0


@dataclass(frozen=True, slots=True)
class Bispectrum:
    """How a limit cycle is told from a linear loop with noise; Choudhury et al. (2004) use 64 too.

    Attributes:
        per_period: samples of a period after thinning: the third harmonic has four.
        segment, least: samples of a segment, five periods, and fewest segments, half of each shared
            with the next: fewer agree by chance.
    """

    per_period: int = 12
    segment: int = 64
    least: int = 6


@dataclass(frozen=True, slots=True)
class Weighing:
    """How the explanations of a window are compared.

    Attributes:
        jump: innovations beyond so many robust deviations are jumps of the load; normal noise has
            one of five in a million.
        most_jumps: share of rows that may be left out as jumps; more is the noise itself.
        harmonics: waves from outside: a sine, and one of any shape.
        resonances: damping ratio of the peak, and its distance to the background, for a wave
            whose phase wanders.
        bends: curvatures over OP's span in the window, or over PV's: at 1 the gain varies by e, at
            4 by 55, the range of an equal-percentage valve.
        arches: the same of a gain that falls to both sides of PV's middle: at 1.5 to four fifths at
            the ends of PV's span, at 6 to a tenth.
        in_doubt: nats for a sticky valve between which it is looked for a second time: below, the
            estimator gives it up at once; above, a few strokes are enough for its verdict.
    """

    jump: float = 5.0
    most_jumps: float = 0.05
    harmonics: tuple[tuple[int, ...], ...] = ((1,), (1, 2, 3))
    resonances: tuple[tuple[float, float], ...] = ((0.003, 0.2),)
    bends: tuple[float, ...] = (0.5, 1.0, 2.0, 3.0, 4.5)
    arches: tuple[float, ...] = (1.5, 3.0, 4.5, 6.0)
    in_doubt: tuple[float, float] = (-8.0, 50.0)


@dataclass(frozen=True, slots=True)
class Facts:
    """What a record shows without a model.

    Attributes:
        least_run, run_share: samples, and share of the window, of a run of one value that is no
            chance: a frozen signal, or OP in manual.
        pushed: share of the time at an extreme in which the error pushes outwards: a limit.
        least_limit: share of the window at a limit from which it is told.
        levels: fewer different values of PV are a coarse resolution.
        in_steps: share of OP's moves after which it stands still, from which it moves in steps.
        steps: OP's usual moves by which the controller must have wanted to move it in a run for
            something to hold it: OP that moves once it is a step away may be one away to each side
            (tuning family's hands: in automatic up to 1.9, held 2.1 and more in nine of ten).
        least_moves: moves of OP from which they tell the controller's law by themselves: seven for
            each of its unknowns; of_moves: share that it must explain, and a
            controller that was read: most of them.
        of_gap: share of the samples in which OP stands still whose errors may be larger than those
            with which it moves, and the other way round, for a gap to hold OP: rounding and the
            first sample of a run; a hand's errors have any size.
        chance: probability that a run of OP that moves in steps is taken for held, if each sample
            repeated the last one as often as among all others.
    """

    least_run: int = 20
    run_share: float = 0.05
    pushed: float = 0.8
    least_limit: float = 0.02
    levels: int = 60
    in_steps: float = 0.5
    steps: float = 2.0
    least_moves: int = 15
    of_moves: float = 0.5
    of_gap: float = 0.05
    chance: float = 1e-3


@dataclass(frozen=True, slots=True)
class Scope:
    """How much of a record is explained; the facts are taken from all of it.

    Attributes:
        rows: rows of a window that is explained: the time grows with them, and 30 periods tell
            all that 300 do.
        per_period: samples of a period from which a slow oscillation is thinned.
        most_bad: share of bad samples beyond which the longest stretch without a hole is
            explained: the estimator's own limit.
        hole: bad samples in a row that such a stretch may have: a straight line bridges them.
    """

    rows: int = 1800
    per_period: float = 60.0
    most_bad: float = SETTINGS.screening.max_bad
    hole: int = 3


@dataclass(frozen=True, slots=True)
class Headroom:
    """How slow tuning is told from smooth loads; see `estimator.diagnosis.headroom`.

    Attributes:
        slower: factor by which SIMC's integral gain exceeds the running one's, from which a tuning
            is slow: the error after a load lasts as many times longer.
        seconds: second lag over the first, of processes that have two: a short one and an equal
            one (tuning family: with them, and without loads as smooth as OP, the log loss over
            74 slow and well-tuned loops falls from 63 to 41 nats).
        swings: Ms beyond which the running loop would swing; such a loop is not judged here.
        most: the same factor beyond which no process shows: a controller that slow would not move
            PV, and loads alone explain it.
        corner: first corner time of the load, samples; white, noise: first variances of the white
            load and of the noise over that of the load.
        reach: first steps of the logarithms of lag, white load, corner and noise.
        farthest: largest logarithm that is tried.
        tries: fits of a structure.
        dead_times: longest dead time, samples.
        past: past values of PV, beside OP's over the longest dead time, that tell PV where the load
            does not jump; jump: robust deviations beyond which it does; most_jumps: share of
            samples that may be left out for it: as in `Weighing`.
        first: samples in which the filters settle.
        least: samples of a stretch in automatic and within limits from which it is asked: four
            times those in which the filters settle.
    """

    slower: float = 3.0
    seconds: tuple[float, ...] = (0.3, 1.0)
    swings: float = 2.2
    most: float = 50.0
    corner: float = 25.0
    white: float = 0.1
    noise: float = 0.02
    reach: tuple[float, float, float, float] = (0.8, 2.0, 0.8, 2.0)
    farthest: float = 18.0
    tries: int = 160
    dead_times: int = 25
    past: int = 8
    jump: float = 5.0
    most_jumps: float = 0.05
    first: int = 60
    least: int = 240


@dataclass(frozen=True, slots=True)
class Judging:
    """From figures to causes and their weights.

    Attributes:
        threshold: nats from which an explanation is taken over its rivals: the estimator's own.
        unsure: nats around no evidence within which a wave from outside and a tight loop are not
            told apart.
        told: weight from which a cause is told: a twentieth of what the loop suffers is too little
            to act on.
        tight: amplification of a disturbance at the oscillation's period, or at the loop's own,
            from which a tuning is tight: Astrom and Hagglund (2006) tune for Ms of 1.4 to 2.
        dies: e-foldings of the loop's own swing within the record that it takes to tell it from a
            wave of steady phase; three are 5 %.
        endless: amplification, by a process that is fitted beside the oscillation, from which the
            loop's own swing may outlast the record: it is at the limit of stability within a tenth
            (tuning family: loops under an outside wave reach nine).
        well: amplification of a well-tuned loop (SIMC: 1.6). By a process that is fitted beside the
            oscillation, loops under an outside wave stay below it and tight ones above.
        wanders: deviation of an oscillation's amplitude over its mean from which noise keeps it
            going: half of Rayleigh's 0.52 (tuning family: tight loops have 0.29 to 1, waves from
            outside 0.01 to 0.23 over 15 periods and more).
        in_phase: share of an oscillation's squared amplitude in one phase, from which its phase
            does not wander: a machine whose size changes keeps it (tuning family: one tight loop of
            58 reaches it).
        lasting_periods: periods from which the amplitude is asked: fewer hold too few values.
        damping: damping of the loop's own swing below which it rings for five periods.
        steady: regularity from which an oscillation has a period: its periods scatter by 5 % then
            (tuning family: waves from outside have 5 to 100, noise through a well-tuned loop up to
            5).
        kept: height of the autocorrelation two periods away that a wave of steady phase keeps
            (tuning family: waves that the likelihood does not ask for keep 0.77 to 1, noise up to
            0.69).
        slow: share of the error's variance that is predictable two integral times ahead, from
            which a tuning is slow.
        lingering: sum of the shares that are predictable one and two integral times ahead, from
            which it may be slow as well (tuning family: well-tuned loops under white and red loads
            stay below 0.7, slow ones above 0.75; smooth loads go beyond).
        lasts: the same sum from which it is slow whatever the loads may be: between the two the
            probability of headroom tells.
        likely, unlikely: that probability from which it is slow, and up to which it is not: odds of
            two to one; between them neither is told. surely, probable: the same where the error is
            over within an integral time and no other cause is told: odds of fifty and of nine to
            one (tuning family: as many slow loops as well-tuned ones lie between); at odds of fifty
            against it no error that lasts makes it slow.
        removable: share of the squared error that robust settings must remove, where the process
            shows, for a tuning to be slow; lasting: the same where the record is too short for its
            integral time, so that nothing else tells.
        step: resolution over the error's deviation from which quantisation makes the error.
        shaken: share of OP's range by which noise moves the valve every sample: 0.5 % is what a
            positioner resolves.
        swung: factor on it where the loop swings: a gain at the limit of stability is up to four
            times a well-tuned one (gain margins of tuning rules are two to four).
        noisy: share of the error's variance that is noise.
        frozen: share of samples in which PV stands still.
        seen: share of the record beyond which an integral time is too long for the record to show
            how fast the loop is.
        ratio: between the largest and the smallest gain over OP's middle nine tenths, from which
            the characteristic is a cause: tuning rules leave a gain margin of two to three.
        by_hand: share of samples in manual from which that is the finding.
        explains: share of OP's moves that a controller must explain, where they are not explained
            sample by sample, for an oscillation not to be its loop's (tuning family, noisy or
            jittered: of readings that explain less a third is off by more than 30 %, of others a
            sixth).
    """

    threshold: float = 10.0
    unsure: float = 5.0
    told: float = 0.05
    tight: float = 2.2
    dies: float = 2.0
    endless: float = 10.0
    well: float = 1.6
    wanders: float = 0.26
    in_phase: float = 0.98
    lasting_periods: float = 15.0
    damping: float = 0.1
    steady: float = 6.7
    kept: float = 0.75
    slow: float = 0.3
    lingering: float = 0.75
    lasts: float = 1.5
    likely: float = 0.67
    unlikely: float = 0.33
    surely: float = 0.98
    probable: float = 0.9
    removable: float = 0.25
    lasting: float = 0.5
    step: float = 0.7
    shaken: float = 0.005
    swung: float = 4.0
    noisy: float = 0.5
    frozen: float = 0.08
    seen: float = 0.2
    ratio: float = 2.0
    by_hand: float = 0.3
    explains: float = 0.9


@dataclass(frozen=True, slots=True)
class DiagnosisSettings:
    """All settings of a diagnosis."""

    swinging: Swinging = field(default_factory=Swinging)
    bispectrum: Bispectrum = field(default_factory=Bispectrum)
    reading: Reading = field(default_factory=Reading)
    weighing: Weighing = field(default_factory=Weighing)
    facts: Facts = field(default_factory=Facts)
    scope: Scope = field(default_factory=Scope)
    grouping: Grouping = field(default_factory=Grouping)
    headroom: Headroom = field(default_factory=Headroom)
    judging: Judging = field(default_factory=Judging)
    advising: Advising = field(default_factory=Advising)


DIAGNOSIS = DiagnosisSettings()
