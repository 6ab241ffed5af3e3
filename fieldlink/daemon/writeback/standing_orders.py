"""What an operator has ordered for a loop's write-back; it can only forbid more than the site file.

Hold: no new block, the one in force stays. Off: nothing at all is written to the loop's registers,
the heartbeat included, so that the PLC drops its model after the heartbeat's time-out.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["StandingOrders"]


@dataclass(slots=True)
class StandingOrders:
    """Orders for one loop; belong to the loop's name and outlive its runner.

    Attributes:
        hold: who holds new blocks, and why; empty while nothing is held.
        off: who has switched the write-back off, and why; empty while it is on.
    """

    hold: str = ""
    off: str = ""
