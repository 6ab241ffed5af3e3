"""Replies that are still owed after a time-out, and the probes that settle them.

Without a transaction id a reply is known by its form alone: function and length of a read, the echo
of a write. Devices answer in order, so that a reply to a probe proves that no older one will come,
if it cannot be anything else than the reply to the probe. Two kinds of probe take turns:

- the echo of diagnostics (FC8, sub-function 0): nothing else is answered with that function, and a
  device that does not know it answers with an exception of that function, which proves as much,
  unless it may be the late answer to an echo before;
- for devices that say nothing to FC8: a read with a length that no owed reply has. An exception to
  it proves nothing, because it may be the late answer to another read.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from fieldlink.links.frames import (
    DIAGNOSTICS,
    EXCEPTION,
    Request,
    echo_request,
    read_request,
)
from fieldlink.registers import Table

__all__ = ["LateReplies"]

FORGET_AFTER = 60.0
"""Seconds after which a reply that has not come is held to be lost."""

REFUSALS = 3
"""Reads refused as probes after which only echoes are tried: each is owed itself, for a while."""


@dataclass(frozen=True, slots=True)
class _Owed:
    request: Request
    since: float


class LateReplies:
    """Replies that one unit still owes; false when it owes none."""

    def __init__(self) -> None:
        self._owed: list[_Owed] = []
        self._owed_echoes = 0
        self._probes = self._refusals = self._passed = self._echoes = 0

    def __bool__(self) -> bool:
        return bool(self._owed)

    def owe(self, request: Request, now: float) -> None:
        """Note a request that got no answer (yet); an echo is only counted: it has its number."""
        if request.function == DIAGNOSTICS:
            self._owed_echoes += 1
        else:
            self._owed.append(_Owed(request, now))

    def recognise(self, pdu: bytes) -> bool:
        """Whether ``pdu`` is a late reply, not to what is being waited for; notes that it came."""
        if pdu[0] & ~EXCEPTION == DIAGNOSTICS:
            self._owed_echoes = max(0, self._owed_echoes - 1)
            return True
        for owed in self._owed:
            if owed.request.is_regular(pdu):
                self._owed.remove(owed)
                self._passed += 1
                return True
        return False

    def probe_for(self, request: Request) -> Request:
        """Return the next probe to try before ``request``."""
        self._probes += 1
        if self._probes % 2 == 0 and self._refusals < REFUSALS:
            for probe in _reads_beside(request):
                if not any(_alike(probe, owed.request) for owed in self._owed):
                    return probe
        # Counted on from one time-out to the next, so that no echo is like an older one.
        self._echoes += 1
        return echo_request(self._echoes & 0xFFFF)

    def proves(self, probe: Request, pdu: bytes) -> bool:
        """Whether the answer ``pdu`` to ``probe`` can be the answer to nothing else."""
        if not probe.is_exception(pdu):
            return True
        return probe.function == DIAGNOSTICS and not self._owed_echoes

    def refused(self, probe: Request, now: float) -> None:
        """Note an answer to a probe that does not prove that it is the probe's."""
        if probe.function == DIAGNOSTICS:
            # The oldest echo is answered, and this one is owed in its place.
            return
        self._refusals += 1
        self.owe(probe, now)

    def settled(self) -> int:
        """Forget what is owed: a probe was answered. Returns how many late replies had come."""
        self._owed.clear()
        self._owed_echoes = self._probes = self._refusals = 0
        passed, self._passed = self._passed, 0
        return passed

    def forget(self, now: float) -> None:
        """Give up waiting for what has been owed for long."""
        self._owed = [owed for owed in self._owed if now - owed.since < FORGET_AFTER]
        if not self._owed:
            self._owed_echoes = self._probes = self._refusals = 0


def _alike(probe: Request, owed: Request) -> bool:
    return probe.head == owed.head and probe.size == owed.size


def _reads_beside(request: Request) -> Iterator[Request]:
    """Yield reads of about the same registers, no two replies of which have the same length."""
    function, address, count = struct.unpack(">BHH", request.pdu[:5])
    table = {1: Table.COIL, 2: Table.DISCRETE, 4: Table.INPUT, 5: Table.COIL, 15: Table.COIL}.get(
        function, Table.HOLDING
    )
    if function in (5, 6):
        count = 1
    step = 8 if table.is_bits else 1
    lengths = [count + sign * step * i for sign in (-1, 1) for i in range(1, 9)]
    for number in lengths:
        if 1 <= number <= min(table.read_limit, 0x10000 - address):
            yield read_request(table, address, number)
