"""The controllers of a closed-loop study: what `fieldlink simulate` and benchmarks run.

A run begins with what a plant has, the stiction-unaware MPC, until the loop shows its limit cycle;
then the controller under study takes over, with everything it could have seen. What compensates has
the loop under a `Supervisor`, as in the product: method and watch are judged together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from compensator import (
    Action,
    Compensator,
    CompensatorError,
    Controller,
    EmbeddingMpc,
    EmbeddingSettings,
    Followed,
    HybridMpc,
    HybridSettings,
    Knocker,
    KnockerSettings,
    MpcSettings,
    NoiseModel,
    OpLimits,
    PiController,
    PiSettings,
    Supervisor,
    SupervisorSettings,
    TwoMove,
    TwoMoveSettings,
    UnawareMpc,
    WithdrawReason,
)
from fieldlink.lab.study.timing import Timing, timed, timed_compensator
from loop_model import LoopModel, ProcessModel, ValveModel

__all__ = ["CONTROLLERS", "Setup", "Staged", "mismatched", "staged"]

CONTROLLERS = ("pi", "unaware", "hybrid", "embedding", "knocker", "two-move")


@dataclass(frozen=True, slots=True)
class Setup:
    """What the controllers are built from.

    Attributes:
        process: what the plant's own controller (PI, unaware MPC) is tuned for.
        model: valve and process in the compensators.
        limits: of OP.
        weight: factor on the setting that trades PV against travel: the unaware MPC's and the
            embedding's price of OP, the hybrid's price of a move, the two-move method's tolerance;
            of the PI's gain and the knocker's amplitude it is the reciprocal.
    """

    process: ProcessModel
    model: LoopModel | None
    limits: OpLimits = field(default_factory=OpLimits)
    weight: float = 1.0


class Staged:
    """One controller until sample ``at``, then another that has observed everything."""

    def __init__(self, before: Controller, after: Controller, at: int) -> None:
        self.before, self.after, self.at = before, after, at
        self._scan = -1

    def observe(self, pv: float, op: float) -> None:
        """See `Controller.observe`."""
        self._scan += 1
        self.before.observe(pv, op)
        self.after.observe(pv, op)

    def decide(self, sp: float) -> Action:
        """See `Controller.decide`."""
        return (self.before if self._scan < self.at else self.after).decide(sp)


class _Supervised:
    """A supervisor as a controller; the model is offered at sample ``at``."""

    def __init__(self, supervisor: Supervisor, model: LoopModel, at: int) -> None:
        self.supervisor = supervisor
        self._model, self._at = model, at
        self._scan = -1
        self._pv = self._op = math.nan
        self.lost_at: int | None = None

    def observe(self, pv: float, op: float) -> None:
        """See `Controller.observe`."""
        self._scan += 1
        self._pv, self._op = pv, op
        if self._scan == self._at:
            self.supervisor.offer(self._model)

    def decide(self, sp: float) -> Action:
        """See `Controller.decide`."""
        had = self.supervisor.compensating
        action = self.supervisor.step(self._pv, sp, self._op)
        if self.supervisor.compensating:
            self.lost_at = None
        elif had:
            self.lost_at = self._scan
        return action


@dataclass(frozen=True, slots=True)
class StagedRun:
    """A controller ready to run, and its figures after the run."""

    controller: Controller
    timing: Timing
    supervisor: Supervisor | None = None

    @property
    def fell_back(self) -> str:
        """Why a supervised compensator does not have the loop at the end; empty if it has."""
        if self.supervisor is None or self.supervisor.compensating:
            return ""
        reason = self.supervisor.reason
        return reason.name.lower() if reason is not WithdrawReason.NONE else "waiting"

    @property
    def lost_at(self) -> int | None:
        """Scan at which the compensator lost the loop for good; None if it has it."""
        return self.controller.lost_at if isinstance(self.controller, _Supervised) else None


def staged(name: str, setup: Setup, at: int, *, watched: bool = True) -> StagedRun:
    """Return a controller by name that has the loop from sample ``at`` on.

    Unless ``watched`` there is no supervisor, so the loop is never given back to its controller.

    Raises:
        CompensatorError: there is no such controller, or it cannot be built for this model.
    """
    base = _base(setup)
    timing = Timing()
    if name in _COMPENSATORS:
        if setup.model is None:  # no valve model, no compensation: the plant's own goes on
            return StagedRun(timed(base, timing, at), timing)
        build = _COMPENSATORS[name]
        if not watched:
            alone = timed(build(setup, setup.model), timing, at)
            return StagedRun(Staged(base, alone, at), timing)
        supervisor = Supervisor(
            base,
            SupervisorSettings(_hybrid(setup)),
            build=lambda model, _: timed_compensator(build(setup, model), timing),
        )
        if setup.process.is_integrating and name == "two-move":
            _two_move(setup, setup.model)  # says why it cannot
        return StagedRun(_Supervised(supervisor, setup.model, at), timing, supervisor)
    after = _plain(name, setup)
    return StagedRun(Staged(base, timed(after, timing, at), at), timing)


def _base(setup: Setup) -> Controller:
    """What a plant has."""
    return UnawareMpc(setup.process, _mpc(setup))


def _mpc(setup: Setup) -> MpcSettings:
    """The plant's MPC; a level's is tuned as levels are, to leave its measurement's noise alone."""
    if setup.process.is_integrating:
        return MpcSettings(limits=setup.limits, op_weight=0.15, noise=NoiseModel(0.1, 1.0, 0.01))
    return MpcSettings(limits=setup.limits)


def _hybrid(setup: Setup) -> HybridSettings:
    defaults = HybridSettings(limits=setup.limits)
    return replace(defaults, move_penalty=defaults.move_penalty * setup.weight)


def _embedding(setup: Setup) -> EmbeddingSettings:
    defaults = EmbeddingSettings(limits=setup.limits, estimator=HybridSettings(setup.limits))
    return replace(defaults, op_weight=defaults.op_weight * setup.weight)


def _pi(setup: Setup, weight: float = 1.0) -> PiController:
    pi = PiSettings.simc(setup.process, setup.limits)
    return PiController(replace(pi, gain=pi.gain / weight))


def _plain(name: str, setup: Setup) -> Controller:
    if name == "unaware":
        defaults = _mpc(setup)
        weighted = replace(defaults, op_weight=defaults.op_weight * setup.weight)
        return UnawareMpc(setup.process, weighted)
    if name == "pi":
        return _pi(setup, setup.weight)
    raise CompensatorError(
        f"there is no controller {name!r}; choose one of {', '.join(CONTROLLERS)}"
    )


def _two_move(setup: Setup, model: LoopModel) -> Controller:
    return TwoMove(model, TwoMoveSettings(setup.limits, tolerance=setup.weight))


def _knocker(setup: Setup, model: LoopModel) -> Controller:
    knocks = KnockerSettings.of(model.valve, setup.limits)
    return Knocker(_pi(setup), replace(knocks, amplitude=knocks.amplitude / setup.weight))


def _followed(
    make: Callable[[Setup, LoopModel], Controller], setup: Setup, model: LoopModel
) -> Compensator:
    limits = HybridSettings(limits=setup.limits)
    return Followed(lambda changed: make(setup, changed), model, limits)


_COMPENSATORS: Mapping[str, Callable[[Setup, LoopModel], Compensator]] = {
    "hybrid": lambda setup, model: HybridMpc(model, _hybrid(setup)),
    "embedding": lambda setup, model: EmbeddingMpc(model, _embedding(setup)),
    "knocker": lambda setup, model: _followed(_knocker, setup, model),
    "two-move": lambda setup, model: _followed(_two_move, setup, model),
}


def mismatched(model: LoopModel, *, valve: float = 1.0, gain: float = 1.0) -> LoopModel:
    """Return a model whose frictions and process gain are wrong by factors."""
    v, p = model.valve, model.process
    scaled = tuple(gain * b for b in p.b)
    # The wrong process agrees with the right one at the operating point that its offset stands for.
    offset = p.offset * gain if p.is_integrating else p.offset
    return LoopModel(
        ValveModel(valve * v.stick_band, valve * v.slip_jump), replace(p, b=scaled, offset=offset)
    )
