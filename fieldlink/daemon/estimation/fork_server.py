"""The fork server, from which the estimator's processes come: it imports the estimator once."""

from __future__ import annotations

import multiprocessing
import os
import signal

__all__ = ["end_fork_server", "worker_context"]


def worker_context() -> multiprocessing.context.BaseContext:
    """Return how workers begin; never fork: a lock that a thread holds would stay locked in them.

    The fork server has loaded the estimator once, so that a new worker is there in milliseconds.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["fieldlink.daemon.estimation.worker_imports"])
    return context


def end_fork_server() -> None:
    """End the fork server, so that nobody waits for its import; the next worker starts another.

    Its import takes seconds, minutes on a slow machine, and who asked for a worker waits for it.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return
    from multiprocessing import forkserver

    # There is no public name for the process, only for its start.
    server = getattr(forkserver, "_forkserver", None)
    if server is None:
        return
    with server._lock:
        if server._forkserver_pid is not None:
            os.kill(server._forkserver_pid, signal.SIGKILL)
