"""The inside of an isolated plant's process: requests come in as JSON, answers go out.

Nothing is unpickled on either side: an FMU is foreign native code, and what it writes into
its own process must not become code in ours.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
from dataclasses import asdict
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from .errors import PlantError
from .inprocess import InProcessPlant
from .opening import OpenOptions
from .shared_rows import SharedRows

__all__ = ["serve"]


def serve(connection: Connection, folder: Path, memory: int) -> None:
    """Answer requests until the client closes the plant or goes away.

    Args:
        connection: to the client.
        folder: where the FMU may be extracted; its maker removes it.
        memory: descriptor of the file for the rows of a run.
    """
    _limit_harm()
    plant: InProcessPlant | None = None
    rows: SharedRows | None = None
    while True:
        try:
            action, argument = json.loads(connection.recv_bytes())
            content = connection.recv_bytes() if action == "run" else b""
        except (EOFError, ConnectionError):
            return
        try:
            if plant is None or rows is None:
                options = OpenOptions(**argument["options"])
                plant = InProcessPlant(Path(argument["file"]), options, folder)
                rows = SharedRows(memory, len(plant.info.outputs))
                os.close(memory)
                answer: dict[str, Any] = {"ok": asdict(plant.info)}
            elif action == "run":
                _run(plant, rows, argument, content)
                answer = {"ok": None}
            else:
                answer = {"ok": _answer(plant, action, argument)}
        except PlantError as error:
            answer = {"error": type(error).__name__, "text": str(error)}
        if plant is not None:
            answer["time"] = plant.time
        try:
            connection.send_bytes(json.dumps(answer).encode())
        except OSError:  # the client has gone, or the FMU has closed what is not its own
            return
        if plant is None or action == "close":
            return


def _run(plant: InProcessPlant, rows: SharedRows, argument: Any, content: bytes) -> None:
    names, count = argument["names"], argument["count"]
    table = np.frombuffer(content).reshape(-1, len(names)) if names else np.empty((0, 0))
    columns = {name: table[:, i] for i, name in enumerate(names)}
    plant.fill(
        {**argument["held"], **columns},
        rows.table[:count],
        rows.moments[:count],
        rows.progress,
        last=argument["last"],
    )


def _answer(plant: InProcessPlant, action: str, argument: Any) -> Any:
    match action:
        case "step":
            return plant.step(argument)
        case "outputs":
            return plant.outputs()
        case "intermediate":
            piece = plant.take_intermediate()
            columns = {name: values.tolist() for name, values in piece.columns.items()}
            return [piece.time.tolist(), columns]
        case "snapshot":
            return base64.b64encode(plant.snapshot()).decode("ascii")
        case "restore":
            return plant.restore(base64.b64decode(argument))
        case "close":
            return plant.close()
    raise AssertionError(f"unknown request {action!r}")


def _limit_harm() -> None:
    """Let a crash of the FMU leave no core file, and let a lack of memory end the FMU first."""
    import resource  # POSIX only, as this module's process is

    _soft, hard = resource.getrlimit(resource.RLIMIT_CORE)
    resource.setrlimit(resource.RLIMIT_CORE, (0, hard))
    with contextlib.suppress(OSError):  # Linux only; without it the system chooses
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")
