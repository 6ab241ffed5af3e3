"""Which models may be tried: by what is known of the loop, before any of them has it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from compensator.action import CompensatorError, RefusalKind
from compensator.hybrid.slow_lags import as_planned
from compensator.supervising.figures import LoopFigures, Sample
from compensator.supervising.given_up import GivenUpModels
from compensator.supervising.record_check import seen_agreement, seen_friction
from compensator.supervising.supervision import SupervisorSettings
from loop_model import LoopModel, ProcessModel, ValveModel

__all__ = ["Admission"]


class Admission:
    """Refuses models that cannot be right for this loop.

    Args:
        settings: of the supervisor.

    Attributes:
        given_up: models that made the loop worse.
        gain_sign: of the process, as the record showed it; 0 while unknown.
        friction_factor: by which the friction is larger than the model asked about last has it.
    """

    def __init__(self, settings: SupervisorSettings) -> None:
        self._settings = settings
        self.given_up = GivenUpModels(settings.retry)
        self.gain_sign = 0
        self.friction_factor = 1.0
        self._asked: ValveModel | None = None

    def require_usable(self, model: LoopModel) -> None:
        """Raise `CompensatorError` for a model that must not be tried."""
        s, process = self._settings, model.process
        if s.period and not math.isclose(process.period, s.period):
            raise CompensatorError(
                f"the model's period of {process.period:g} s is not the scan's {s.period:g} s; "
                "identify with the scan's",
                RefusalKind.PERIOD,
            )
        if s.gain_sign * math.fsum(process.b) < 0.0:  # A(1) is above zero in every stable process
            raise CompensatorError(
                "the model's gain has the other sign than the loop's own controller counts on; "
                "check the signs of OP and PV",
                RefusalKind.WRONG_SIGN,
            )
        given_up = self.given_up.find(model)
        if given_up is not None:
            raise CompensatorError(
                f"this model made the loop worse before ({given_up.why.value}); offer a newly "
                f"identified one, or wait {given_up.left} scans",
                given_up.why,
            )
        if self.given_up.pause:
            known = self.given_up.known
            raise CompensatorError(
                f"{len(known)} models that differ made this loop worse; look for what moves the "
                "stem or PV beside OP (a positioner's own integral, a driven load), or wait "
                f"{self.given_up.pause} scans",
                known[-1].why,
            )
        if model.valve.stick_band == 0.0:
            raise CompensatorError(
                "the model's stick band is 0: a valve that does not stick needs no compensation"
            )

    def require_right_sign(self, model: LoopModel, seen: Sequence[Sample]) -> None:
        """Raise `CompensatorError` if the record of the loop, also one from before a restart,
        contradicts the sign of the model's gain.
        """
        sign = 1 if math.fsum(model.process.b) > 0.0 else -1
        agrees = seen_agreement(
            model, [s.op for s in seen], [s.pv for s in seen], self._settings.check
        )
        if agrees:
            self.gain_sign = agrees * sign
        if self.gain_sign * sign < 0:
            raise CompensatorError(
                "PV moved against what the model makes of OP: its gain has the wrong sign; check "
                "the signs of OP and PV and identify again",
                RefusalKind.WRONG_SIGN,
            )

    def require_fine_enough(
        self, valve: ValveModel, process: ProcessModel, before: LoopFigures | None
    ) -> None:
        """Raise `CompensatorError` for a level that the stem cannot set finely enough.

        A level is corrected by the least move of the stem and another one back, after the scans
        that OP stays. Where that shifts it by more than it deviated before, noise and the doubt
        about the stem leave more than half of that deviation: of 30 such simulated runs none
        halved it. The record of a loop that cycles faster than a lag does not tell that from a
        level.
        """
        if before is None:
            return
        if before.travel * before.period >= valve.slip_jump:
            process = as_planned(process, before.period)
        if not process.is_integrating:
            return
        s = self._settings.hybrid
        least = valve.slip_jump + s.slip_margin * valve.static_friction
        shift = least * max(1, s.dwell) * abs(math.fsum(process.b))
        known = math.sqrt(before.mean_square)
        if shift > known:
            raise CompensatorError(
                f"the stem's least move shifts PV by {shift:.3g}, more than the "
                f"{known:.3g} by which it deviates now: compensation cannot halve that; leave the "
                "loop to its own controller",
                RefusalKind.WORSE,
            )

    def with_seen_friction(self, model: LoopModel, seen: Sequence[Sample]) -> LoopModel:
        """Return a model with the friction that the record shows, where that is plainly larger.

        The answer of a first model stays while models of about the same friction are offered: a
        record under the compensator holds few moves, all made by that friction.
        """
        asked, valve = self._asked, model.valve
        self._asked = valve if len(seen) >= self._settings.check.shortest else None
        known = asked is not None and math.isclose(
            asked.static_friction, valve.static_friction, rel_tol=self._settings.retry.widest
        )
        if not known:
            self.friction_factor = seen_friction(
                model, [s.op for s in seen], [s.pv for s in seen], self._settings.check
            )
        f = self.friction_factor
        return LoopModel(ValveModel(f * valve.stick_band, f * valve.slip_jump), model.process)
