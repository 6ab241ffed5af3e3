"""What can be set of the hybrid compensator."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from compensator.action import (
    CompensatorError,
    OpLimits,
    require_not_negative,
    require_positive,
    require_whole,
)
from compensator.hybrid.load_trend import LoadTrendSettings
from compensator.hybrid.setpoint_trend import SetpointTrendSettings
from compensator.hybrid.thrift import ThriftSettings
from compensator.prediction import NoiseModel
from compensator.stem_tracking.friction import FrictionPrior, Uncertainty

__all__ = ["HybridSettings"]


@dataclass(frozen=True, slots=True)
class HybridSettings:
    """Settings of `HybridMpc`.

    Attributes:
        limits: range and rate of OP.
        horizon: samples; 0 chooses it from the settling time.
        level_horizon: samples that a plan for a level looks ahead beyond the dead time. It settles
            nowhere by itself: seen over fewer, a position a part of J beside the balance looks as
            good as the balance. A lag longer than this is planned as a level.
        lasting: horizons that the error at a horizon's end counts for beyond it: an offset stays,
            noise passes.
        move_penalty: price of one move: the share of the noise's own variance by which it must
            lower PV's mean square error over the horizon.
        travel_penalty: price of moving by one slip jump, as a share of ``move_penalty``.
        noise_band: PV deviation that is of no interest (units of PV), added to the noise seen.
        slip_margin: moves are planned at least ``J + slip_margin * fS`` in size, so that they slip
            even if the static friction is somewhat above its estimate.
        overshoot: how far beyond its final position the stem may go for speed, as a share of the
            way there. The farther, the more the plan relies on the fast part of the process model.
        edge: share of the static friction up to which OP may approach a slip without causing it.
        room: largest leap of an OP with a limited rate, in least moves, below which OP creeps until
            the stem slips: fewer sizes leave no choice where the stem lands.
        dwell: scans that OP stays where it moved the stem to: an actuator lags, and a stem slides
            for a while. A command of one scan would leave such a stem short of its goal.
        linger: scans after a move before OP returns to the middle of the band, if no other move is
            wanted: a slow stem may still be on its way.
        unknown: weight of what is not yet known of the lasting offset, beside noise, in the price
            of a move: waiting will tell.
        unseen: factor of the noise's variance in that price until the stem was seen to slip: its
            position is not known then, and only a lasting error of three deviations is worth it.
        tolerated: share of PV's deviation before compensation that is worth no move.
        tolerated_level: the same for an integrating process, where each position drifts and a
            correction for the last share would cost the travel of all others.
        spread: relative uncertainty of fS; dynamic_spread: of fD (`FrictionPrior`).
        gain_spread: relative uncertainty of the process gain.
        offset_memory: settling times over which the load (what makes the controller free of offset)
            is averaged in quiet times.
        late: samples by which PV may answer later than the model has it, or sooner where negative;
            each that leaves a dead time is followed too (`TrackerSettings.late`).
        jump_late: the same where J is larger than the model has it (`TrackerSettings.jump_late`).
        trend: what makes a ramp of the set-point, and how far ahead it is planned.
        load_trend: what makes a drift of the load, and how far ahead it is planned.
        thrift: how travel is saved where PV is good enough.
        noise: ratios that set the filter (``disturbance`` is set by ``offset_memory``); None lets
            the loop's own noise decide (`TrackerBank`).
    """

    limits: OpLimits = field(default_factory=OpLimits)
    horizon: int = 0
    level_horizon: int = 120
    lasting: float = 1.0
    move_penalty: float = 1.0
    travel_penalty: float = 0.2
    noise_band: float = 0.0
    slip_margin: float = 0.2
    overshoot: float = 0.5
    edge: float = 0.85
    room: float = 1.5
    dwell: int = 2
    linger: int = 3
    unknown: float = 3.0
    unseen: float = 9.0
    tolerated: float = 0.25
    tolerated_level: float = 0.4
    spread: float = 0.1
    dynamic_spread: float = 0.25
    gain_spread: float = 0.1
    offset_memory: float = 2.0
    late: tuple[int, ...] = (3, -3, -6)
    jump_late: tuple[int, ...] = (5, 10)
    trend: SetpointTrendSettings = field(default_factory=SetpointTrendSettings)
    load_trend: LoadTrendSettings = field(default_factory=LoadTrendSettings)
    thrift: ThriftSettings = field(default_factory=ThriftSettings)
    noise: NoiseModel | None = None

    def __post_init__(self) -> None:
        require_not_negative(
            "HybridSettings",
            move_penalty=self.move_penalty,
            travel_penalty=self.travel_penalty,
            noise_band=self.noise_band,
            slip_margin=self.slip_margin,
            overshoot=self.overshoot,
            unknown=self.unknown,
            unseen=self.unseen,
            tolerated=self.tolerated,
            tolerated_level=self.tolerated_level,
            spread=self.spread,
            dynamic_spread=self.dynamic_spread,
            gain_spread=self.gain_spread,
            lasting=self.lasting,
        )
        require_whole(
            "HybridSettings", 0, horizon=self.horizon, dwell=self.dwell, linger=self.linger
        )
        require_whole("HybridSettings", 1, level_horizon=self.level_horizon)
        require_positive(
            "HybridSettings",
            offset_memory=self.offset_memory,
            edge=self.edge,
            room=self.room,
        )
        if self.edge >= 1.0:
            raise CompensatorError(
                f"HybridSettings: edge must be below 1, the slip itself; got {self.edge!r}"
            )

    def with_limits(self, limits: OpLimits) -> HybridSettings:
        """Return the same settings with other limits of OP."""
        return replace(self, limits=limits)

    def friction_prior(self, uncertainty: Uncertainty) -> FrictionPrior:
        """Return the prior of the friction, given what its identification states."""
        return FrictionPrior(self.spread, self.dynamic_spread, uncertainty=uncertainty)
