"""Every chosen number of the groups of loops that swing together, and of their source.

"Tuning family" is ``benchmarks.diagnosis_families.tuning``.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Grouping"]


@dataclass(frozen=True, slots=True)
class Grouping:
    """Which loops swing together, and which is the source.

    Attributes:
        same: periods nearer than this share may be one event's.
        width, wide: half-width of the band, as a share of the frequency: narrow for an oscillation,
            wide for the irregular motion of a sticky valve.
        delays: periods by which loops follow such a motion: a band that wide tells them apart.
        chance: probability that a plant shows one group by chance (tuning family: at 0.005 waves
            from outside are lost).
        led: the same for a loop whose valve or tuning moves others by its past alone: less, because
            no period speaks for it (tuning family: down to 0.002 no source is lost).
        made: weight of tight tuning, the share of its loop's motion that it makes, from which the
            loop may move others: most of it (tuning family: sources have 0.73 and more, loops of
            plants without an event up to 0.41).
        regular: regularity below which the cycle of a sticky valve is compared in the wide band.
        range: span of the periods that loops of a plant have, in nats: 3 is a factor of 20.
        coherence: least coherence of two loops that both oscillate; half of the amplitude's
            variance is then in common.
        hidden: least coherence of a loop that does not oscillate visibly itself.
        driven: least coherence, in the wide band, of a loop with one that makes its own motion, for
            it to be asked whether that one's past tells its future: a quarter in common.
        share: least share of the oscillation in such a loop's motion.
        moving: share of samples in which a cascade's set-point moves.
        masters: outputs most like a set-point that are tried as its master's.
        cascade: share of a set-point's variance that a master's OP explains.
        sticky, tight, external: log odds that a loop is the source, by its own diagnosis
            (judged, not measured: a victim is seldom called sticky, more often tight).
        evident, usual: log odds for each nat of the logarithm of the evidence for a sticky valve,
            and the evidence, nats, of `sticky`. A victim's steps pass for strokes, but explain far
            less of its PV: on networks of loops apart from both families 14 sources had 98 to
            3,100 nats, healthy victims 12 to 67, one of ten 224. The loop is a source where its
            log odds exceed `outside`: from 14 nats on.
        maybe: log odds of a loop whose cause is undetermined and that amplifies disturbances of the
            group's period as a tight one does: it may swing by itself.
        steady: deviation of the oscillation's amplitude over its mean, in the loop of a group where
            it is least, up to which no noise keeps it going: a quarter of Rayleigh's 0.52 (tuning
            family: groups of tight loops have 0.17 to 0.61, 86 of 92 outside waves 0.01 to 0.12).
        harmonics, strength: log odds of the loop with the most harmonics, and for each nat of the
            odds of the oscillation over the rest of the motion.
        nonlinear, bicoherent: log odds of a loop with a nonlinear oscillation, and the bicoherence
            from which it is one (tuning family: nine of ten tight loops are below).
        leads: log odds of a loop whose past tells the future of all others.
        compared: likeliest loops that are compared for a lead.
        order, per_period: past values of the regressions that tell who leads, and samples of a
            period: together they reach back most of a period.
        lead_nats: difference of evidence from which a lead is clear.
        outside: log odds of a source that is none of the loops, where one of them swings by itself;
            unmade: its lead over the likeliest loop that does not.
    """

    same: float = 0.1
    width: float = 0.2
    wide: float = 0.5
    delays: tuple[float, ...] = (-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75)
    chance: float = 0.01
    led: float = 0.005
    made: float = 0.5
    regular: float = 3.0
    range: float = 3.0
    coherence: float = 0.7
    hidden: float = 0.85
    driven: float = 0.5
    share: float = 0.1
    moving: float = 0.3
    masters: int = 3
    cascade: float = 0.95
    sticky: float = 5.0
    evident: float = 1.5
    usual: float = 100.0
    tight: float = 3.0
    external: float = 1.0
    maybe: float = 2.5
    steady: float = 0.13
    harmonics: float = 1.0
    strength: float = 1.2
    nonlinear: float = 0.5
    bicoherent: float = 0.55
    leads: float = 3.0
    compared: int = 8
    order: int = 10
    per_period: float = 15.0
    lead_nats: float = 15.0
    outside: float = 2.0
    unmade: float = 1.0
