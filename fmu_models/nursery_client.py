"""The nursery of this process: started at the first need, ended with the process, never shared."""

from __future__ import annotations

import atexit
import contextlib
import itertools
import os
import socket
import subprocess
import sys
import threading
from multiprocessing.connection import Connection
from pathlib import Path

from .nursery import BIRTH, KILL, REQUEST

__all__ = ["NurseryClient", "nursery"]

_PROGRAM = "from fmu_models.nursery import main; main({})"


class NurseryClient:
    """The nursery of this process, and the socket to it."""

    def __init__(self) -> None:
        self._control, theirs = socket.socketpair()
        self._keys = itertools.count()
        root = str(Path(__file__).parents[1])
        path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _PROGRAM.format(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                # What an FMU prints must not mix with what this process prints for machines.
                stdin=subprocess.DEVNULL,
                stdout=2,
                # No thread may run where workers are forked.
                env={**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"},
            )

    def is_running(self) -> bool:
        """Whether it has not ended or been killed."""
        return self._process.poll() is None

    def start_worker(self, memory: int) -> tuple[int, Connection, int]:
        """Return the key of a new worker, the connection to it and the pipe of its exit status.

        Args:
            memory: descriptor of the file that the worker maps; it stays the caller's to close.
        """
        key = next(self._keys)
        ours, theirs = socket.socketpair()
        status, status_end = os.pipe()
        try:
            socket.send_fds(
                self._control,
                [REQUEST.pack(BIRTH, key)],
                [theirs.fileno(), status_end, memory],
            )
        except BaseException:
            os.close(status)
            ours.close()
            raise
        finally:
            theirs.close()
            os.close(status_end)
        return key, Connection(ours.detach()), status

    def kill(self, key: int) -> None:
        """Kill a worker; nothing happens to one that has ended."""
        with contextlib.suppress(ConnectionError):  # a nursery that is gone took its workers along
            self._control.sendall(REQUEST.pack(KILL, key))

    def close(self) -> None:
        """Let it end, with the workers that are left, and wait for it."""
        self._control.close()
        self._process.wait()

    def close_copy(self) -> None:
        """In a forked child: let go of the parent's nursery without ending it."""
        self._control.close()


_lock = threading.Lock()
_current: NurseryClient | None = None
_parents: list[NurseryClient] = []


def nursery() -> NurseryClient:
    """Return the running nursery of this process; it is started at the first need."""
    global _current
    with _lock:
        if _current is None:
            _current = NurseryClient()
        elif not _current.is_running():
            _current.close()
            _current = NurseryClient()
        return _current


@atexit.register
def _close_nursery() -> None:
    global _current
    if _current is not None:
        _current.close()
        _current = None


def _after_fork() -> None:
    global _current, _lock
    _lock = threading.Lock()
    if _current is not None:
        _current.close_copy()
        _parents.append(_current)  # kept: its process is not ours to wait for
        _current = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
