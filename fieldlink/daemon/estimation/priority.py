"""Who goes first on a busy machine: the daemon, because a poll cannot wait and a window can.

Workers put themselves behind everything else by three means, because each is void somewhere: a nice
value (void against other sessions where Linux groups processes by session), a session of their own
with a nice value for the group (void inside a container or service with a share of its own), and
the scheduling class for computations, which never takes the processor from a process that wakes up.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

__all__ = ["NICENESS", "stand_back"]

NICENESS = 5
"""About a third of what a process of normal priority gets on the same core. With 10, a tenth on
paper, a worker on a machine whose cores were all taken got a hundredth, and ran out of its window's
time."""


def stand_back() -> None:
    """Put this process, a worker, behind the daemon; what the system refuses stays as it is."""
    if sys.platform == "win32":
        return
    with suppress(OSError):
        # Also, a terminal's Ctrl-C is for the daemon.
        os.setsid()
    with suppress(OSError):
        Path("/proc/self/autogroup").write_text(f"{NICENESS}\n")
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, max(NICENESS, os.getpriority(os.PRIO_PROCESS, 0)))
    if sys.platform == "linux":
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
