"""A line to a server that is cut after so many bytes of its answers, and stays cut."""

from __future__ import annotations

import socket
import threading
from typing import Self


class CutLine:
    """Listens on `port` while the block runs; ``limit`` None cuts nothing."""

    def __init__(self, server: int, limit: int | None = None) -> None:
        self._server, self._limit = server, limit
        self.passed = 0
        self._open: list[socket.socket] = []
        self._threads: list[threading.Thread] = []
        self._lock = threading.Lock()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])

    def __enter__(self) -> Self:
        self._start(self._accept)
        return self

    def __exit__(self, *_: object) -> None:
        self._cut()
        for thread in self._threads:
            thread.join(10.0)

    def _start(self, work: object, *values: object) -> None:
        thread = threading.Thread(target=work, args=values, daemon=True)  # type: ignore[arg-type]
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            far = socket.create_connection(("127.0.0.1", self._server))
            with self._lock:
                self._open += [near, far]
            self._start(self._pump, near, far, False)
            self._start(self._pump, far, near, True)

    def _pump(self, source: socket.socket, target: socket.socket, is_answer: bool) -> None:
        try:
            while data := source.recv(65536):
                if is_answer and self._limit is not None:
                    data = data[: max(0, self._limit - self.passed)]
                target.sendall(data)
                self.passed += len(data) if is_answer else 0
                if is_answer and self.passed == self._limit:
                    self._cut()
        except OSError:
            return
        finally:
            for end in (source, target):
                end.close()

    def _cut(self) -> None:
        with self._lock:
            # Closing a socket does not wake the thread that waits for it.
            for end in (self._listener, *self._open):
                try:
                    end.shutdown(socket.SHUT_RDWR)
                except OSError:
                    # It is closed already.
                    continue
        self._listener.close()
