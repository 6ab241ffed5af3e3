"""What operators ask of a running daemon: at the page, on the command line, through a broker."""

from __future__ import annotations

from collections.abc import Mapping

from fieldlink.daemon.estimation.judging import WindowJudging
from fieldlink.daemon.loop import LoopRunner
from fieldlink.daemon.operators.orders import Action, Order, OrderError, carry_out
from fieldlink.daemon.site_runner import SiteRunner
from fieldlink.errors import FieldlinkError
from fieldlink.links import Clock

__all__ = ["OperatorRequests"]


class OperatorRequests:
    """Carries out what an operator asks for, on the record.

    Args:
        site_runner: the loops.
        judging: judges a window when an operator asks.
        clock: stamps the orders.
        read_only: whether the daemon writes to no device.
    """

    def __init__(
        self, site_runner: SiteRunner, judging: WindowJudging, clock: Clock, *, read_only: bool
    ) -> None:
        self._site_runner = site_runner
        self._judging = judging
        self._clock = clock
        self._read_only = read_only

    def withdraw(self, name: str, reason: str) -> None:
        """Withdraw a loop's block at the next look.

        Raises:
            FieldlinkError: there is no such loop, or it may not be written.
        """
        loop = self._loop(name)
        if self._read_only:
            raise FieldlinkError(
                "the running daemon writes nothing (--read-only); clear the PLC's enable bit"
            )
        loop.withdraw(reason, self._clock.utc())

    def carry_out(self, order: Order) -> str:
        """Carry out an operator's order and record it; return in words what follows.

        Raises:
            OrderError: there is no such loop, or the order cannot be carried out.
        """
        loop = self._loop(order.loop)
        utc = self._clock.utc()
        if order.action is Action.ESTIMATE:
            self._judging.judge_by_hand(loop)
        carry_out(order, loop, utc, read_only=self._read_only)
        self._site_runner.journal.order(order.record(round(utc * 1000.0), loop.spec))
        return order.action.done

    def order_for_broker(self, action: Action, loop: str, why: str) -> None:
        """Carry out an order that came as a message of the broker."""
        self.carry_out(Order(loop, action, "MQTT broker", why))

    def answer(self, request: Mapping[str, object]) -> Mapping[str, object]:
        """Answer a command that came through the control socket."""
        if request.get("command") != "withdraw":
            raise FieldlinkError(f"there is no command {str(request.get('command'))!r}")
        self.withdraw(str(request.get("loop", "")), str(request.get("reason", "")))
        return {"asked": True}

    def _loop(self, name: str) -> LoopRunner:
        loop = self._site_runner.loop(name)
        if loop is None:
            raise OrderError(f"the running daemon has no loop {name!r}; see fieldlink status")
        return loop
