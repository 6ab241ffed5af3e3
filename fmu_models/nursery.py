"""The process that isolated plants are forked from.

It has imported everything once, so a plant starts in milliseconds and shares its memory with the
others. It does three things: starts a worker on request, kills one on request, and when a
worker has ended for any reason, removes its folder, ends what its FMU had started and reports the
exit status. When the process it serves has ended, it kills the workers that are left and ends too.
If it is killed itself, the workers go on until they are closed. Every worker leads a process group,
so that the processes of an FMU end with it.

Requests on the control socket are ``REQUEST``; a ``BIRTH`` carries three descriptors, the worker's
end of its connection, the pipe for its exit status and the memory for rows of outputs.
"""

from __future__ import annotations

import contextlib
import gc
import os
import select
import shutil
import signal
import socket
import struct
import sys
import tempfile
import traceback
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from .worker import serve

__all__ = ["BIRTH", "KILL", "REQUEST", "STATUS", "main"]

REQUEST = struct.Struct("<cq")
STATUS = struct.Struct("<i")
BIRTH = b"B"
KILL = b"K"


@dataclass(frozen=True, slots=True)
class _Child:
    pid: int
    folder: str
    status: int


class _Nursery:
    def __init__(self, control: socket.socket) -> None:
        self._control = control
        self._children: dict[int, _Child] = {}
        self._wake, wake_end = socket.socketpair()
        wake_end.setblocking(False)
        self._wake_end = wake_end
        signal.signal(signal.SIGCHLD, lambda *_: None)  # a handler, so that the wake-up is written
        signal.set_wakeup_fd(wake_end.fileno(), warn_on_full_buffer=False)

    def run(self) -> None:
        while True:
            ready, _, _ = select.select([self._control, self._wake], [], [])
            if self._wake in ready:
                self._wake.recv(4096)
                self._reap(os.WNOHANG)
            if self._control in ready and not self._obey():
                break
        for child in self._children.values():
            _kill_group(child.pid)
        self._reap(0)

    def _obey(self) -> bool:
        try:
            message, descriptors, _, _ = socket.recv_fds(self._control, REQUEST.size, 3)
        except ConnectionError:
            return False
        if len(message) < REQUEST.size:
            return False
        kind, key = REQUEST.unpack(message)
        if kind == BIRTH:
            self._bear(key, *descriptors)
        elif key in self._children:
            _kill_group(self._children[key].pid)
        return True

    def _bear(self, key: int, connection: int, status: int, memory: int) -> None:
        folder = tempfile.mkdtemp(prefix="fieldlink-fmu-")
        pid = os.fork()
        # Here and in the worker: the second of the two finds it done.
        with contextlib.suppress(OSError):
            os.setpgid(pid, pid)
        if pid == 0:
            self._live(Connection(connection), Path(folder), status, memory)
        os.close(connection)
        os.close(memory)
        self._children[key] = _Child(pid, folder, status)

    def _live(self, connection: Connection, folder: Path, status: int, memory: int) -> None:
        """Be the worker; never returns."""
        code = 1
        try:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for other in self._children.values():
                os.close(other.status)
            os.close(status)
            for end in (self._control, self._wake, self._wake_end):
                end.close()
            serve(connection, folder, memory)
            code = 0
        except BaseException:
            traceback.print_exc()  # before the exit below, which the client sees the status of
            raise
        finally:
            shutil.rmtree(folder, ignore_errors=True)
            sys.stderr.flush()
            os._exit(code)

    def _reap(self, flags: int) -> None:
        while self._children:
            pid, status = os.waitpid(-1, flags)
            if pid == 0:
                return
            key = next(key for key, child in self._children.items() if child.pid == pid)
            child = self._children.pop(key)
            _kill_group(pid)
            shutil.rmtree(child.folder, ignore_errors=True)
            with contextlib.suppress(BrokenPipeError):  # the client no longer waits for it
                os.write(child.status, STATUS.pack(os.waitstatus_to_exitcode(status)))
            os.close(child.status)


def _kill_group(pid: int) -> None:
    """Kill a worker, and the processes that its FMU has started."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)


def main(descriptor: int) -> None:
    """Serve the process at the other end of the socket ``descriptor`` until it goes away."""
    # A terminal's Ctrl-C and a service manager's SIGTERM go to the whole group. The plants end
    # when the process they serve lets go of them, not before.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    gc.collect()
    gc.freeze()  # forked workers then share these pages instead of copying them
    with socket.socket(fileno=descriptor) as control:
        _Nursery(control).run()
