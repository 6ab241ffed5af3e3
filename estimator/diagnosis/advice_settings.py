"""Every chosen number of the proposed settings and of what they are predicted to do.

"Tuning family" is ``benchmarks.diagnosis_families.tuning``.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Advising"]


@dataclass(frozen=True, slots=True)
class Advising:
    """When settings are proposed, how robust they are, and how far a prediction is trusted.

    Attributes:
        robustness: Ms of the proposed settings: SIMC's own is 1.59 for a lag with dead time.
        robust: Ms that nineteen of twenty plausible processes must keep under the proposed
            settings; 2 is the usual upper end (Astrom and Hagglund 2006), a quarter above it is
            still stable with a gain margin of 1.7.
        advise_from: nats of the process over none, under the long noise model, from which settings
            are proposed (tuning family: below it the prediction is off by more than 15 % in every
            other loop, above it in one of fourteen).
        farthest, slowest: largest and smallest factor on the gain and on the integral gain that is
            proposed: a record shows the process at the frequencies that its loop uses, and not far
            beyond.
        beyond: share of the span of the record's OP by which simulated OP may leave it: what lies
            farther out, a limit or a bend of the characteristic, is not in the record.
        noise_order: length of the noise model under which the process is fitted once more. In
            closed loop a noise model that is too short biases the process (Ljung 1999, section
            13.4); 16 hold a load behind three lags with noise of the transmitter beside it. A valve
            that sticks must be likelier under it too.
        reflection: largest reflection coefficient of that noise model: loads that drift behind a
            slow process need one nearer to 1 than the valve's verdict does.
        screen, behind: nats behind the likeliest process up to which one is refined, and counts.
        modes: dead times and shapes that are refined at the most.
        samples: processes that stand for all plausible ones.
        tail: share of the plausible processes on each side of the range that is told.
        reach: farthest step of a sampled time constant, as a logarithm.
        blur, blur_cycle: widening of the range, as a share: the noise model is never quite right;
            the size of a limit cycle varies from run to run (tuning family, halves of the record
            included: 66 of 67 ranges hold the truth).
        narrow: ratio of the range's ends up to which a single figure is told: it is then off by a
            quarter at the most. Where the running settings, simulated, miss the recorded error by
            more, nothing is proposed (tuning family: one of 79, by a factor of 6,700; the others
            miss it by 1.5 at the most).
    """

    robustness: float = 1.6
    robust: float = 2.5
    advise_from: float = 60.0
    farthest: float = 5.0
    slowest: float = 0.1
    beyond: float = 0.5
    noise_order: int = 16
    reflection: float = 0.9999
    screen: float = 15.0
    behind: float = 6.0
    modes: int = 10
    samples: int = 48
    tail: float = 0.05
    reach: float = 2.5
    blur: float = 0.05
    blur_cycle: float = 0.1
    narrow: float = 1.6
