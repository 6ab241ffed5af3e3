"""Every number of the estimator that somebody chose: what it means, its unit, and where it is from.

None was chosen by a recorded loop. Where the source is "tuning family", it comes from the simulated
loops of ``benchmarks.families.tuning``, never from those that the benchmarks report on.
"""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = ["SETTINGS", "Judging", "Modelling", "Screening", "Searching", "Settings", "Spreading"]


@dataclass(frozen=True, slots=True)
class Screening:
    """When a window is not judged at all.

    Attributes:
        min_samples: fewer samples hold no four strokes and the parameters of a loop.
        max_bad: share of bad samples; beyond it the strokes themselves have holes.
        min_auto: share of samples in automatic; a loop in manual is another experiment.
        max_at_rail: share of samples at one limit; beyond it the window shows the limit.
        max_still: share of samples that equal the one before; beyond it the signal stands still.
        min_informed: share of samples that are no straight line between two others. Below a fifth
            the lines that a historian drew are taken for the process (tuning family: no false alarm
            from there on).
        min_band: stick band as a share of OP's span that a positioner resolves (1 to 2 % by
            ISA-75.25 for good ones); a smaller one is not reported as stiction.
        min_strokes: strokes of the stem; one is a step, two are a load that comes and goes.
        enough: rows of a window, and rows of a stroke of OP, beyond which samples are averaged:
            four strokes of a loop whose dead time (20 rows at most) is a tenth of its cycle.
    """

    min_samples: int = 50
    max_bad: float = 0.3
    min_auto: float = 0.7
    max_at_rail: float = 0.5
    max_still: float = 0.9
    min_informed: float = 0.2
    min_band: float = 0.02
    min_strokes: int = 3
    enough: tuple[int, int] = (1000, 25)


@dataclass(frozen=True, slots=True)
class Modelling:
    """What both hypotheses, healthy and sticky valve, are made of.

    Attributes:
        memory: rows at the start of the window that serve as past only (samples): the longest dead
            time and the longest noise memory together.
        max_dead_time: longest dead time (samples).
        noise_orders: orders of the autoregressive noise that BIC chooses from.
        max_reflection: largest reflection coefficient of the noise model. A load that wanders
            freely is 1, which leaves PV's level unknown; below 0.999 the process is bent to explain
            what wanders (tuning family: fewer valves found).
        floor: residual (share of PV's standard deviation) below which PV is not trusted: converters
            resolve about 0.1 %.
        startup: time constant (samples) of the shared column for what happened before the window.
        action_t: t-value of the controller's action on the error from which its sign is taken as
            known: four deviations are one error in 16,000.
        max_sinusoids: outside oscillations that may be added to a hypothesis.
        waves: harmonics of the outside oscillations that are offered: a sine, a wave of any shape,
            and two that are alike up and down (a triangle's 9th is 1 % of its first, its 21st
            0.2 %: what little noise leaves standing).
    """

    memory: int = 30
    max_dead_time: int = 20
    noise_orders: tuple[int, ...] = (0, 1, 2, 3, 5, 8)
    max_reflection: float = 0.9999
    floor: float = 1e-3
    startup: float = 40.0
    action_t: float = 4.0
    max_sinusoids: int = 4
    waves: tuple[tuple[int, ...], ...] = (
        (1,),
        (1, 2, 3),
        (1, 3, 5, 7, 9),
        tuple(range(1, 22, 2)),
    )


@dataclass(frozen=True, slots=True)
class Searching:
    """How wide valves are looked for; wider costs time only (tuning family: what is still found).

    Attributes:
        bands: stick bands of the coarse search, as shares of OP's span.
        jumps: slip jumps of the coarse search, as shares of the stick band.
        starts: first positions of the stem, as shares of fS around OP's first sample; for the laws
            after the first every second one of ``fine_starts``.
        fine_jumps, fine_starts: the same of the ranking by one-step errors, which is cheap.
        pasts: samples of PV's own past in that ranking: white noise on PV needs more than the three
            of a clean record (tuning family: of 17 windows in which a search with three had lost
            the right valve, that ranks it first in 3, one with eight in 11, one with sixteen in 9).
        delays: dead times of the coarse search in samples.
        reversals: times that a stem must turn to be a hypothesis: what happens once is a step,
            which anything explains.
        variance: least variance of the stem over OP's, alpha of (11b) of the paper.
        laws: laws whose valves are looked for, the first one's most thoroughly.
        ahead: nats over a healthy valve from which a sticky one is clear: looks by simulation are
            then spared, and valves of other laws, or under disturbances found since, are looked for
            with less effort.
        seeds: valves of the first law, and of each other one, that a first look follows.
        wide, generations: first reach (share of S) and rounds of following one.
        basins: of these, valves that each look hands on; apart: how far they differ in S, as a
            share.
        polished, refined: of all looks, valves of each law whose process is fitted, and those
            refined last. Before its process is fitted the right one may rank behind several wrong
            ones (tuning family: three polished lose five of 1,160 that 35 to 300 nats show).
        lanes: candidates of a round of any refinement.
        rounds, turns: rounds of the last refinement, and how often the noise model follows.
        swept: valves nearby that a sweep refines, and sweeps in a row at most.
    """

    bands: tuple[float, ...] = (
        0.02, 0.035, 0.055, 0.08, 0.12, 0.19, 0.26, 0.33, 0.40, 0.47, 0.54, 0.61, 0.68, 0.75, 0.82,
        0.89, 0.97,
    )  # fmt: skip
    jumps: tuple[float, ...] = (0.02, 0.25, 0.6, 1.0)
    starts: tuple[float, ...] = (-0.95, -0.4, 0.4, 0.95)
    fine_jumps: tuple[float, ...] = (0.0, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0)
    fine_starts: tuple[float, ...] = (-0.95, -0.5, 0.0, 0.5, 0.95)
    pasts: tuple[int, ...] = (8,)
    delays: tuple[int, ...] = (0, 1, 2, 4, 7, 12, 18)
    reversals: int = 1
    variance: float = 0.001
    laws: tuple[str, ...] = ("he", "sliding")
    ahead: float = 50.0
    seeds: tuple[int, int] = (3, 2)
    wide: float = 0.12
    generations: int = 7
    basins: tuple[int, int] = (2, 1)
    apart: float = 0.15
    polished: int = 6
    refined: int = 2
    lanes: int = 24
    rounds: int = 8
    turns: int = 2
    swept: int = 3


@dataclass(frozen=True, slots=True)
class Judging:
    """From evidence to a verdict.

    Attributes:
        price: what having searched S, J and the first position costs the sticky hypothesis, in
            units of ``log n`` nats: 3/2 for three parameters by BIC, 1/2 more for the many valves
            that were tried.
        threshold: log Bayes factor from which a valve is called sticky. About 1 in 20,000 at even
            odds: a false alarm sends a technician, and loops are judged daily.
        few: strokes of the stem below which a window is called sticky only from a higher log Bayes
            factor on, and that factor: two or three strokes also fit a load that drifts (tuning
            family: half of the false alarms, none beyond 41).
        parts, steady: parts of the window, and the log Bayes factor that must be left without the
            part that holds most of it: a valve sticks all the time, a load jumps once (tuning
            family: false alarms rest on one part).
        close: nats around the threshold within which an answer is close: a valve is looked for
            again, it is estimated under every law, and a load that is as far behind may be a rival.
            From the threshold on the answer is certain (tuning family, from 10 to 14: 9 of 479
            sticky valves, none of 365 healthy ones); below it, it is uncertain wherever a sticky
            valve is likelier than a healthy one.
        process: log-likelihood ratio of a process over none, below which PV does not follow OP:
            4.5 is a gain three deviations from zero. The likeliest of many processes gains more by
            luck: below ``threshold``, the healthy valve's gain must be as far from zero itself.
    """

    price: float = 2.0
    threshold: float = 10.0
    few: tuple[int, float] = (4, 50.0)
    parts: int = 8
    steady: float = 1.5
    close: float = 4.0
    process: float = 4.5


@dataclass(frozen=True, slots=True)
class Spreading:
    """How wide the intervals are, beside what the likelihood says.

    Attributes:
        law_nats: laws that are further behind the best one are left out.
        law_temper: power of a law's likelihood in its share of the posterior; far below 1, because
            no law is quite that of a valve (tuning family: coverage per kind).
        temper: power of the likelihood; below 1 because slips of a real valve vary from stroke to
            stroke while the model's do not (tuning family: coverage per kind).
        law: standard deviations of S, as shares of S: where the leading law is the valve's; where
            none is, downwards; and upwards, times the share of OP's span that S leaves. Where none
            is they are large: pressure that follows OP late makes S look larger, bristles and
            friction that falls with speed make it look smaller (simulated valves with mass, spring
            and friction, of which a slow ramp of OP tells S; tuning family: coverage per kind).
        law_jump: those of J, as shares of S: where one law is the valve's, and where none is.
        lead: nats by which a law is ahead that make it e times more improbable that none is the
            valve's; as many more as the mean square of its errors after the stem's turns is larger
            than elsewhere, squared (the same sources).
        gains: likely valves over which the gain's spread is taken.
        lanes, rounds: samples of one round of the sampler, and rounds.
        reach: first standard deviations in log S, J over S and start over S.
        wider, narrowest: factor on the deviations of the next round, and their least value.
    """

    law_nats: float = 30.0
    law_temper: float = 0.05
    temper: float = 0.5
    law: tuple[float, float, float] = (0.01, 0.14, 0.28)
    law_jump: tuple[float, float] = (0.07, 0.3)
    lead: float = 30.0
    gains: int = 16
    lanes: int = 128
    rounds: int = 5
    reach: tuple[float, float, float] = (0.04, 0.1, 0.15)
    wider: float = 1.5
    narrowest: float = 1e-4


@dataclass(frozen=True, slots=True)
class Settings:
    """All settings of one identification."""

    screening: Screening = field(default_factory=Screening)
    modelling: Modelling = field(default_factory=Modelling)
    searching: Searching = field(default_factory=Searching)
    judging: Judging = field(default_factory=Judging)
    spreading: Spreading = field(default_factory=Spreading)


SETTINGS = Settings()
