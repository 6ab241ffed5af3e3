"""What can be set of the search for the stem."""

from __future__ import annotations

from dataclasses import dataclass, field

from compensator.action import (
    CompensatorError,
    require_not_negative,
    require_positive,
    require_whole,
)
from compensator.prediction import NoiseModel
from compensator.stem_tracking.friction import FrictionPrior
from compensator.stem_tracking.innovations import InnovationSettings

__all__ = ["TrackerSettings"]


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """Settings of `StemTracker`.

    Attributes:
        noise: ratios of the filter; ``offset_memory`` takes the place of its ``disturbance``.
        friction: prior of the static and of the dynamic friction.
        gain: process gain to expect, over the model's.
        gain_spread: relative deviation of the process gain.
        offset_memory: settling times over which the load is averaged in quiet times.
        level_memory: samples that take the place of a settling time in what a level remembers. A
            level has none, and its balance shows in PV's slope alone: with measurement noise of a
            twentieth of what a slip makes, a hundred samples tell the balance to a thirtieth of J.
        load_walk: slip jumps that the load goes in a settling time, as the deviation of a random
            walk, beside what ``offset_memory`` allows for.
        delay_spread: samples that the answer to a slip may be early or late; it covers what a
            model of too low an order or another dead time leaves of the response, which would else
            pass for load or for a wrong gain.
        first: positions assumed at first, from OP, as shares of the static friction: the stem is
            anywhere in OP's band, and steps of 0.4 leave none of them farther than a fifth away.
        negligible: chance of an outcome of a command below which it is not followed by a hypothesis
            of its own: that of 2.5 deviations.
        hypotheses: how many are kept.
        hopeless: log-odds against a hypothesis from which it is dropped: one in three million.
        alike: log-odds up to which the position that OP is held for stays the same: 1 % is
            no evidence, and a change of mind may set off the stem.
        memory: samples over which evidence counts, those not counted that all hypotheses expected
            alike.
        recalled: log-odds against an earlier position that is believed possible again when
            innovations stay biased: 3 %, below what a move is made larger for, because a load
            explains such innovations more often than a slip that was missed.
        fluctuation_margin: factor on the variance of PV at rest that noise may be taken for: the
            variance of some ten independent values is known to a factor of two.
        farthest_load: OP, a move of which by as much at once is the largest surprise that PV is
            taken for: the whole range. What is beyond it and ``farthest_noise`` deviations is the
            transmitter's and counts for no more than that.
        farthest_noise: see ``farthest_load``; noise does not reach ten deviations.
        innovations: what PV's innovations tell of the noise.
        frictions: factors of the model's friction, the model's own first, of which each has a
            tracker in a `TrackerBank`: a tracker covers some 15 % to either side of its own
            (`FrictionPrior.spread`), and what is beyond 1.7 the record before tells
            (`RecordCheckSettings.larger`).
        claim: log-odds against another friction or gain than the model's: one in four hundred.
        jumps: factors of the model's slip jump of which each has a tracker too, with the gain that
            keeps their product, unless the block's interval of J makes it less likely than
            ``claim``. A limit cycle at one set-point shows the product alone, and a tracker covers
            some 30 % to either side of its own (`FrictionPrior.jump_spread_most`). From the largest
            factor on each twice the last is looked at too, up to the stick band: a block may state
            a J near 0 that is anything.
        least_jump: of those, as a share of the stick band.
        jump_late: samples by which PV may answer later where J is one of the larger ``jumps``: a
            stem of small J goes along with OP, one of larger J slips at once, and being so much
            later makes up for a dead time that is too short. Where dead time and J were 11 and 2,
            blocks said 1 and 0.2.
        jump_late_claim: log-odds against such a dead time, beside those against the J: one in
            three, none of the three is likelier.
        gains: factors of the model's gain of which each has a tracker too. One tracker learns at
            most half of its gain more or less, and slowly: where PV answered twice as much as the
            model had it, the stem of 16 of 25 simulated loops travelled farther than before.
        late: samples by which PV may answer later than the model has it, or sooner where negative,
            each with a tracker, which covers ``delay_spread`` to either side. With one that
            is six samples too long simulated levels hunted.
        late_claim: log-odds against another dead time: one in thirty. Lags of a valve or a sensor
            that a model lacks, and friction that is taken too large, end in the dead time.
        opposed_claim: log-odds against a gain of the other sign from which the model is
            contradicted: one in twenty thousand. Where the sign was right they stayed below 6.
        restless: values of ``load_walk`` of which each has a tracker too: half a slip jump in a
            settling time is a load that a move there and back no longer pays for. A level has none:
            coloured noise of its measurement would pass for such a load.
        restless_claim: log-odds against a load that does not rest: one in four hundred, because it
            explains whatever friction makes, too.
        bank_memory: samples over which the densities that decide between trackers count: two
            stretches of ``memory``, because noise and friction vary less than positions.
        lead: log-odds by which another tracker must be ahead to take over: one in seven. With one
            in fifty a wrong slip jump was kept for hundreds of scans (`benchmarks.demo_course`);
            with one in three two that are alike take turns.
        bank_learning: samples in which a tracker still learns how much noise there is: what it
            expects counts nothing.
    """

    noise: NoiseModel
    friction: FrictionPrior = field(default_factory=FrictionPrior)
    gain: float = 1.0
    gain_spread: float = 0.1
    offset_memory: float = 2.0
    level_memory: int = 100
    load_walk: float = 0.0
    delay_spread: float = 1.0
    first: tuple[float, ...] = (0.0, -0.4, 0.4, -0.8, 0.8)
    negligible: float = 0.006
    hypotheses: int = 14
    hopeless: float = 15.0
    alike: float = 0.01
    memory: float = 60.0
    recalled: float = 3.5
    fluctuation_margin: float = 2.0
    farthest_load: float = 100.0
    farthest_noise: float = 10.0
    innovations: InnovationSettings = field(default_factory=InnovationSettings)
    frictions: tuple[float, ...] = (1.0, 1.3, 0.75)
    claim: float = 6.0
    jumps: tuple[float, ...] = (0.4, 0.65, 1.6)
    least_jump: float = 0.05
    jump_late: tuple[int, ...] = (5, 10)
    jump_late_claim: float = 1.1
    gains: tuple[float, ...] = (1.8,)
    late: tuple[int, ...] = (3, -3, -6)
    late_claim: float = 3.5
    opposed_claim: float = 10.0
    restless: tuple[float, ...] = (0.5,)
    restless_claim: float = 6.0
    bank_memory: float = 120.0
    lead: float = 2.0
    bank_learning: int = 60

    def __post_init__(self) -> None:
        require_not_negative(
            "TrackerSettings",
            gain_spread=self.gain_spread,
            delay_spread=self.delay_spread,
            alike=self.alike,
            claim=self.claim,
            jump_late_claim=self.jump_late_claim,
            late_claim=self.late_claim,
            opposed_claim=self.opposed_claim,
            load_walk=self.load_walk,
            restless_claim=self.restless_claim,
            lead=self.lead,
            least_jump=self.least_jump,
        )
        require_positive(
            "TrackerSettings",
            gain=self.gain,
            offset_memory=self.offset_memory,
            memory=self.memory,
            fluctuation_margin=self.fluctuation_margin,
            farthest_load=self.farthest_load,
            farthest_noise=self.farthest_noise,
            recalled=self.recalled,
            hopeless=self.hopeless,
            bank_memory=self.bank_memory,
        )
        if not 0.0 <= self.negligible < 0.5:
            raise CompensatorError(
                f"TrackerSettings: negligible is a probability below 0.5; got {self.negligible!r}"
            )
        if not self.first or not all(-1.0 < share < 1.0 for share in self.first):
            raise CompensatorError(
                f"TrackerSettings: first are shares between -1 and 1; got {self.first!r}"
            )
        if self.frictions[:1] != (1.0,) or not all(factor > 0.0 for factor in self.frictions):
            raise CompensatorError(
                "TrackerSettings: frictions are factors above 0, the first of them 1; got "
                f"{self.frictions!r}"
            )
        if not all(0.0 < factor != 1.0 for factor in self.jumps):
            raise CompensatorError(
                f"TrackerSettings: jumps are factors above 0 other than 1; got {self.jumps!r}"
            )
        if not all(0.0 < factor != 1.0 for factor in self.gains):
            raise CompensatorError(
                f"TrackerSettings: gains are factors above 0 other than 1; got {self.gains!r}"
            )
        for samples in self.late:
            require_whole("TrackerSettings", 1, late=abs(samples))
        for samples in self.jump_late:
            require_whole("TrackerSettings", 1, jump_late=samples)
        require_whole(
            "TrackerSettings",
            1,
            hypotheses=self.hypotheses,
            level_memory=self.level_memory,
            bank_learning=self.bank_learning,
        )
