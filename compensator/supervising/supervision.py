"""What a supervisor can be in, what can be set of it, and what it needs of a compensator."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

from compensator.action import (
    CompensatorError,
    Controller,
    require_not_negative,
    require_positive,
    require_whole,
)
from compensator.hybrid.settings import HybridSettings
from compensator.prediction import Prediction
from compensator.supervising.figures import LoopFigures
from compensator.supervising.given_up import GivenUp, RetrySettings
from compensator.supervising.jumps import JumpSettings
from compensator.supervising.record_check import RecordCheckSettings
from compensator.supervising.watch_settings import WatchSettings
from loop_model import LoopModel, ValveModel

__all__ = [
    "Compensator",
    "LoopMemory",
    "SupervisorSettings",
    "SupervisorState",
    "WithdrawReason",
]


class SupervisorState(Enum):
    """Who has the loop."""

    BASE = "the base controller has the loop, no valve model is offered"
    WAITING = "a model is accepted; the compensator takes over when the valve rests"
    COMPENSATING = "the compensator has the loop"
    MANUAL = "an operator has the loop; both controllers follow"


class WithdrawReason(Enum):
    """Why the compensator does not have the loop; the value is the advice."""

    NONE = "no reason: nothing was withdrawn"
    EXPIRED = "the block's time of validity is over; see why no newer one was written"
    HEARTBEAT_DEAD = "the daemon's heartbeat stands still; check the daemon and the network"
    OPERATOR = "withdrawn by an operator, or the enable bit is off"
    NO_STICTION = "the valve was found healthy; the base controller suffices"
    PV_BAD = "PV was bad for too long; the compensator returns when PV does"
    LOAD = "a load drove PV out of its known range; the compensator returns when PV has"
    OP_OUTSIDE = "OP is outside the compensator's limits; it takes over once OP is inside"
    PV_FROZEN = "PV repeats one value: its sensor is frozen; the compensator returns with PV"
    SOLVER = "the compensator's solver passed its bound several scans in a row; use another one"
    WORSE = "PV deviated more than before; the model was given up, identify again"
    NO_GAIN = "PV deviated more than half as much as before; the model was given up, identify again"
    GROWING = "the oscillation grew; the model was given up, identify again"
    HUNTING = "the stem travelled more for no gain; the model was given up, identify again"
    TRAVEL = "the stem travelled more than its budget; the model was given up, see travel_budget"
    WRONG_SIGN = "PV answers to OP against the model; check the gain's sign and the dead time"
    LEFT_RANGE = "PV left its known range; the model was given up, check the gain's sign"
    REFUSED = "the offered model cannot be used; see `refusal`"


@dataclass(frozen=True, slots=True)
class SupervisorSettings:
    """Settings of `Supervisor`.

    Attributes:
        hybrid: settings of the compensator.
        watch: when the compensated loop counts as worse than before.
        retry: when a model that was given up may be tried again.
        check: what the record must show to contradict a model's sign.
        jump: which PV jumped farther than a process can make it.
        friction_rate: largest change of fS and of fD per scan when a newer model differs, in OP.
        history: scans that a new compensator relives, to find stem and load at once; four times as
            many tell how good the loop was before.
        relived: of them in one scan, so that an offer makes no scan late: each takes as long as a
            scan's own. With 30, a tenth of a second in all, the first take-over is 11 scans after
            the offer.
        least_known: scans under the base controller that must be known before a take-over: without
            them nothing tells whether the loop has become worse. After a restart as many and the
            dead time must be seen, because stem and load have to be found again.
        gain_sign: sign of the process gain that the loop's own controller counts on; a model of the
            other sign is refused. 0 when it is not known.
        period: seconds between scans; a model of another one is refused. 0 when it is not known.
        pv_bad_limit: scans of bad PV after which the base controller gets the loop.
        pv_frozen_limit: least scans in which PV repeats one value to count as frozen (`PvScreen`).
        solver_limit: scans in a row that the compensator's solver may pass its bound; then the base
            controller has the loop for a horizon, and for good from the fourth time on.
    """

    hybrid: HybridSettings = field(default_factory=HybridSettings)
    watch: WatchSettings = field(default_factory=WatchSettings)
    retry: RetrySettings = field(default_factory=RetrySettings)
    check: RecordCheckSettings = field(default_factory=RecordCheckSettings)
    jump: JumpSettings = field(default_factory=JumpSettings)
    friction_rate: float = 0.05
    history: int = 300
    relived: int = 30
    least_known: int = 40
    gain_sign: int = 0
    period: float = 0.0
    pv_bad_limit: int = 10
    pv_frozen_limit: int = 30
    solver_limit: int = 3

    def __post_init__(self) -> None:
        require_positive("SupervisorSettings", friction_rate=self.friction_rate)
        require_not_negative("SupervisorSettings", period=self.period)
        if self.gain_sign not in (-1, 0, 1):
            raise CompensatorError(
                f"SupervisorSettings: gain_sign is -1, 1, or 0 for unknown; got {self.gain_sign!r}"
            )
        require_whole(
            "SupervisorSettings",
            1,
            history=self.history,
            relived=self.relived,
            least_known=self.least_known,
            pv_bad_limit=self.pv_bad_limit,
            pv_frozen_limit=self.pv_frozen_limit,
            solver_limit=self.solver_limit,
        )
        if self.least_known > 4 * self.history:
            raise CompensatorError(
                f"SupervisorSettings: least_known = {self.least_known} is more than the "
                f"{4 * self.history} scans that are kept; lower it or raise history"
            )


@dataclass(frozen=True, slots=True)
class LoopMemory:
    """What a supervisor must keep over a restart.

    Attributes:
        figures: of the loop under its base controller; None while unknown.
        given_up: models that made it worse.
        gain_sign: of the process, as the loop's record showed it; 0 while unknown.
    """

    figures: LoopFigures | None = None
    given_up: tuple[GivenUp, ...] = ()
    gain_sign: int = 0


class Compensator(Controller, Protocol):
    """A controller with a valve model, as the supervisor needs it; `HybridMpc`, `EmbeddingMpc`."""

    @property
    def model(self) -> LoopModel:
        """The model in use."""

    @property
    def prediction(self) -> Prediction:
        """The process of the model."""

    @property
    def ready(self) -> bool:
        """Whether a PV was ever seen."""

    @property
    def is_moving(self) -> bool:
        """Whether the valve is being moved."""

    @property
    def horizon(self) -> int:
        """Samples that it looks ahead."""

    @property
    def held_variance(self) -> float:
        """Variance of PV that noise alone makes, the stem held."""

    @property
    def load_stepped(self) -> bool:
        """Whether the last PV showed a step of the load."""

    @property
    def opposed(self) -> bool:
        """Whether PV answers to OP against the sign of the model's gain."""

    def improve_on(self, deviation: float, travel: float) -> None:
        """Take in PV's deviation and the stem's travel per scan before compensation: a small share
        of the deviation is worth no move, and travel is saved where PV is good enough.
        """

    def change_valve(self, valve: ValveModel) -> None:
        """Go on with other valve parameters."""

    def require_reachable(self, valve: ValveModel) -> tuple[float, float]:
        """Return the positions that moves can end at; raise `CompensatorError` if none is left."""
