"""Orders of operators: what a person at the page or the command line may ask of the daemon.

An order can make the write-back safer than the site file, never bolder: every rule about writing
still holds at the moment of writing. Each order is an event with who gave it and why; those that
stand (hold, off) are read from these events again when the daemon begins.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import Enum

from fieldlink.daemon.loop import LoopRunner
from fieldlink.daemon.loop_spec import LoopSpec
from fieldlink.daemon.reporting.journal import Journal
from fieldlink.daemon.writeback.standing_orders import StandingOrders
from fieldlink.errors import FieldlinkError
from fieldlink.printable import as_printable
from fieldlink.store import RENAMED, EventRecord

__all__ = [
    "ORDER_EVENTS",
    "Action",
    "Order",
    "OrderError",
    "carry_out",
    "keep_orders",
    "recall_orders",
]

LONGEST_WHO = 80
LONGEST_WHY = 500
"""Characters: a name, and a few sentences for the record."""

_PREFIX = "operator."


class OrderError(FieldlinkError):
    """An order that cannot be carried out."""


class Action(Enum):
    """What may be ordered: the name used in requests and events, and the answer when done."""

    ESTIMATE = ("estimate", "the window is being judged; the result appears when it is ready")
    ACCEPT = ("accept", "the hold has ended; the rules of the site file decide again")
    HOLD = ("hold", "no new block is written; the block in force stays until it expires")
    WITHDRAW = ("withdraw", "the block is withdrawn at the next look at the PLC")
    WRITEBACK_OFF = (
        "writeback_off",
        "nothing is written any more; the PLC drops its model when the heartbeat stands still",
    )
    WRITEBACK_ON = ("writeback_on", "the write-back follows the site file again")
    ANNOTATE = ("annotate", "noted; the trend starts again at this moment")

    def __init__(self, code: str, done: str) -> None:
        self.code = code
        self.done = done

    @classmethod
    def of(cls, code: str) -> Action:
        """Return the action with a code.

        Raises:
            OrderError: there is none.
        """
        for action in cls:
            if action.code == code:
                return action
        known = ", ".join(action.code for action in cls)
        raise OrderError(f"there is no action {code!r}; choose one of {known}")

    @property
    def event(self) -> str:
        """The kind of its event."""
        return _PREFIX + self.code


_STANDING = (Action.ACCEPT, Action.HOLD, Action.WRITEBACK_OFF, Action.WRITEBACK_ON)

_LEFT = "loop.left"

ORDER_EVENTS = (_LEFT, *(action.event for action in _STANDING))
"""Kinds of the events from which standing orders are known again, see `recall_orders`."""


@dataclass(frozen=True, slots=True)
class Order:
    """One order.

    Attributes:
        loop: the loop's name.
        action: what is to be done.
        who: the operator's name; why: the reason. Both for the record.

    Raises:
        OrderError: name or reason is missing or too long.
    """

    loop: str
    action: Action
    who: str
    why: str

    def __post_init__(self) -> None:
        for name in ("who", "why"):
            # As it is stored and shown: terminals and logs must have nothing in it to obey.
            shown = as_printable(getattr(self, name), lines=True)
            object.__setattr__(self, name, shown)
        for name, text, most in (("who", self.who, LONGEST_WHO), ("why", self.why, LONGEST_WHY)):
            if not text.strip():
                raise OrderError(f"{name} is empty; give it, for the record")
            if len(text) > most:
                raise OrderError(f"{name} has {len(text)} characters; at most {most} are kept")

    @property
    def words(self) -> str:
        """Who and why, in one line."""
        return f"{' '.join(self.who.split())}: {' '.join(self.why.split())}"

    def record(self, utc_ms: int, spec: LoopSpec) -> EventRecord:
        """Return the event to store; ``spec`` tells the valve by what its PLC calls it."""
        detail = {"who": self.who, "why": self.why, **_valve(spec)}
        return EventRecord(utc_ms, self.action.event, self.loop, self.words, detail)


def carry_out(order: Order, loop: LoopRunner, utc: float, *, read_only: bool) -> None:
    """Carry out an order that concerns a loop's write-back; others change nothing here.

    Args:
        order: the order.
        loop: the loop's runner.
        utc: seconds since 1970.
        read_only: whether the daemon writes to no device.

    Raises:
        OrderError: the loop may not be written, or there is nothing to end.
        FieldlinkError: the block cannot be withdrawn.
    """
    action, orders = order.action, loop.orders
    if action in (Action.ESTIMATE, Action.ANNOTATE):
        return
    if action is not Action.WRITEBACK_OFF and action is not Action.HOLD:
        _check_may_write(loop, read_only)
    if action is Action.WITHDRAW:
        loop.withdraw(order.words, utc)
    elif action is Action.ACCEPT and not orders.hold:
        raise OrderError(
            f"loop {loop.name} is not on hold, so its models are accepted by the rules of the site "
            "file; after a withdrawal clear the PLC's enable bit for four seconds and set it again"
        )
    elif action is Action.WRITEBACK_ON and not orders.off:
        raise OrderError(f"the write-back of loop {loop.name} is not switched off")
    else:
        _apply(orders, action, order.words)


def recall_orders(
    events: Sequence[EventRecord], loops: Mapping[str, LoopRunner], journal: Journal
) -> None:
    """Put the standing orders of events, oldest first, in force again.

    Those of a loop that the site file does not name any more go to the loop that has its place in
    the PLC now; without one an event reports, once, that they are lost.
    """
    absent: dict[str, tuple[StandingOrders, EventRecord]] = {}
    for event in events:
        if event.kind == _LEFT:
            absent.pop(event.source, None)
            continue
        loop = loops.get(event.source)
        orders = StandingOrders() if loop is None else loop.orders
        if loop is None:
            orders = absent.get(event.source, (orders, event))[0]
            absent[event.source] = orders, event
        _apply(orders, Action.of(event.kind.removeprefix(_PREFIX)), event.message)
    named = {event.source for event in events}
    for name, (orders, event) in absent.items():
        if not orders.hold and not orders.off:
            continue
        same = (
            loop for loop in loops.values() if _has_place(loop, event) and loop.name not in named
        )
        if (heir := next(same, None)) is not None:
            _hand_on(heir, name, orders, journal)
            continue
        since = datetime.fromtimestamp(event.utc_ms / 1000.0, UTC)
        words = " and ".join(
            f"{what} ({said})"
            for what, said in (("on hold", orders.hold), ("write-back off", orders.off))
            if said
        )
        journal.event(
            _LEFT,
            name,
            "the site file has no loop of this name any more; its orders are not carried over: "
            f"{words}, since {since:%Y-%m-%d %H:%M} UTC; if it has another name now, give them "
            "again",
            bad=True,
        )


def keep_orders(loop: LoopRunner, former: LoopRunner, journal: Journal) -> None:
    """Keep what stands for a loop that has a new name in the site file, on the record.

    Args:
        loop: the loop under its new name.
        former: the same loop under its former one.
        journal: where it is recorded, so that it is known again when the daemon begins.
    """
    loop.numbers.learn(former.numbers.last)
    _hand_on(loop, former.name, former.orders, journal)


def _hand_on(loop: LoopRunner, former: str, orders: StandingOrders, journal: Journal) -> None:
    renamed = journal.event_record(RENAMED, loop.name, f"its name was {former}; its orders stand")
    # By this the loop's history is found under its new name.
    journal.order(replace(renamed, detail={"former": former}))
    for action, words in ((Action.HOLD, orders.hold), (Action.WRITEBACK_OFF, orders.off)):
        if words:
            _apply(loop.orders, action, words)
            record = journal.event_record(action.event, loop.name, words)
            journal.order(replace(record, detail=_valve(loop.spec)))
    if orders.hold or orders.off:
        journal.event(_LEFT, former, f"its name is {loop.name} now; its orders stand there")


def _valve(spec: LoopSpec) -> dict[str, str | int]:
    number = spec.loop.writeback.loop_id
    return {} if number is None else {"device": spec.loop.device, "loop_id": number}


def _has_place(loop: LoopRunner, event: EventRecord) -> bool:
    """Whether the PLC knows a loop by what it called the one that an order was given for."""
    valve = _valve(loop.spec)
    return bool(valve) and valve.items() <= (event.detail or {}).items()


def _apply(orders: StandingOrders, action: Action, words: str) -> None:
    if action is Action.HOLD:
        orders.hold = words
    elif action is Action.ACCEPT:
        orders.hold = ""
    elif action is Action.WRITEBACK_OFF:
        orders.off = words
    elif action is Action.WRITEBACK_ON:
        orders.off = ""


def _check_may_write(loop: LoopRunner, read_only: bool) -> None:
    if loop.writer is None:
        raise OrderError(
            f"loops.{loop.name}.writeback is not enabled in the site file, so nothing is written; "
            "an order cannot change that"
        )
    if read_only:
        raise OrderError(
            "the running daemon writes nothing (--read-only); start it without that option first"
        )
