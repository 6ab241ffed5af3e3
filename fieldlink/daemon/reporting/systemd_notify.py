"""systemd's notification protocol: started, alive, stopping (sd_notify(3)).

A few datagrams to the socket that systemd names in the environment; without one nothing is sent.
The watchdog is fed from the event loop and only while every part of the daemon is at work, so that
a daemon that hangs in any of them is restarted.
"""

from __future__ import annotations

import asyncio
import os
import socket
from collections import Counter
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager

import structlog

from fieldlink.daemon.reporting.status import DaemonStatus
from fieldlink.daemon.sampling.tasks import spawn
from fieldlink.daemon.service import Daemon

__all__ = ["Notifier", "supervised"]

_log = structlog.get_logger(__name__)

STATUS_EVERY = 10.0
"""Seconds between two status lines where there is no watchdog that is quicker."""


class Notifier:
    """Sends to systemd.

    Args:
        environment: holds ``NOTIFY_SOCKET``, ``WATCHDOG_USEC`` and ``WATCHDOG_PID``.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        self._address = environment.get("NOTIFY_SOCKET", "")
        pid = environment.get("WATCHDOG_PID", "")
        usec = environment.get("WATCHDOG_USEC", "")
        mine = not pid or pid == str(os.getpid())
        self.watchdog = int(usec) / 1e6 if mine and usec.isdecimal() and int(usec) else None
        """Seconds within which systemd wants to hear of us; None when it does not."""

    @property
    def wanted(self) -> bool:
        """Whether anybody listens."""
        return bool(self._address)

    def send(self, **fields: str | int) -> None:
        """Send one message, such as ``READY=1``."""
        if not self._address:
            return
        # A leading @ stands for the zero byte of Linux' abstract names.
        address = "\0" + self._address[1:] if self._address[0] == "@" else self._address
        message = "\n".join(f"{key}={value}" for key, value in fields.items())
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
                sender.connect(address)
                sender.send(message.encode())
        except OSError as error:
            _log.warning("notify.failed", error=str(error), message=message)


@asynccontextmanager
async def supervised(daemon: Daemon, notifier: Notifier | None = None) -> AsyncIterator[None]:
    """Tell systemd about the daemon while the block runs."""
    notifier = notifier or Notifier()
    if not notifier.wanted:
        yield
        return
    task = spawn(_report(daemon, notifier), "notify")
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        notifier.send(STOPPING=1)


async def _report(daemon: Daemon, notifier: Notifier) -> None:
    await daemon.started.wait()
    notifier.send(READY=1, STATUS=_line(daemon.status()))
    interval = STATUS_EVERY if notifier.watchdog is None else notifier.watchdog / 3.0
    said: tuple[str, ...] = ()
    while True:
        await asyncio.sleep(interval)
        stuck = daemon.stuck()
        if stuck:
            if stuck != said:
                _log.error("daemon.stuck", parts=", ".join(stuck))
            notifier.send(STATUS=f"stuck: {', '.join(stuck)}")
        elif notifier.watchdog is not None:
            notifier.send(WATCHDOG=1, STATUS=_line(daemon.status()))
        else:
            notifier.send(STATUS=_line(daemon.status()))
        said = stuck


def _line(status: DaemonStatus) -> str:
    states = Counter(device.state.name.lower() for device in status.devices.values())
    devices = ", ".join(f"{count} {state}" for state, count in sorted(states.items()))
    store = "store fails" if status.store.failing else "store ok"
    return f"{len(status.loops)} loops; devices: {devices}; {store}, {status.store.dropped} lost"
