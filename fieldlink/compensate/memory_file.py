"""The file that keeps what a compensator has learnt of its loop over a restart.

The file holds the figures of the loop under its own controller, the sign of its gain that the
record showed, and the models that were given up. It is JSON, written to a second file and put in
place at once, so that a power failure leaves the older one.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from compensator import GivenUp, LoopFigures, LoopMemory, RefusalKind, Uncertainty
from compensator.stem_tracking.friction import FrictionPrior
from fieldlink.errors import FieldlinkError
from fieldlink.unfinished_file import write_whole
from loop_model import LoopModel

__all__ = ["MemoryFileError", "load_memory", "only_writer", "save_memory"]


class MemoryFileError(FieldlinkError):
    """A memory file that cannot be read or written."""


class _GivenUp(BaseModel):
    """A `GivenUp` as stored; the name of its reason stays the same in later releases."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    model: LoopModel
    stated: Uncertainty
    seconds_left: float
    why: str


class _Memory(BaseModel):
    """A `LoopMemory` at a moment, ``saved_at`` seconds since 1970 in UTC."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    version: int = 1
    loop: str
    saved_at: float
    figures: LoopFigures | None
    gain_sign: int
    given_up: tuple[_GivenUp, ...]


@contextmanager
def only_writer(file: Path) -> Iterator[None]:
    """Be the only process that writes OP with a memory file, while the block runs.

    The lock is on a file beside it, because the memory is replaced as a whole, and ends with the
    process, however that ends.

    Raises:
        MemoryFileError: another process has it, or there is no place for the lock.
    """
    beside = file.with_name(f"{file.name}.lock")
    try:
        lock = os.open(beside, os.O_CREAT | os.O_RDWR, 0o640)
    except OSError as error:
        raise MemoryFileError(
            f"{beside}: cannot be made ({error.strerror}); check the folder and its permissions, "
            "or name another place with memory"
        ) from error
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise MemoryFileError(
                f"{file}: another process compensates this loop already; stop it first, or run "
                "this one without --write"
            ) from error
        yield
    finally:
        os.close(lock)


def save_memory(file: Path, loop: str, memory: LoopMemory, *, period: float, now: float) -> None:
    """Write what a supervisor remembers.

    Args:
        file: takes it.
        loop: name of the loop.
        memory: of its supervisor.
        period: seconds between scans.
        now: seconds since 1970 in UTC.

    Raises:
        MemoryFileError: the file cannot be written.
    """
    given_up = tuple(
        _GivenUp(
            model=g.model,
            stated=g.prior.uncertainty,
            seconds_left=g.left * period,
            why=g.why.name,
        )
        for g in memory.given_up
    )
    kept = _Memory(
        loop=loop,
        saved_at=now,
        figures=memory.figures,
        gain_sign=memory.gain_sign,
        given_up=given_up,
    )
    try:
        write_whole(file, kept.model_dump_json(indent=1).encode())
    except OSError as error:
        raise MemoryFileError(
            f"{file}: the compensator's memory cannot be written ({error.strerror or error}); "
            "check the folder and its permissions, or name another with memory"
        ) from error


def load_memory(file: Path, loop: str, *, period: float, now: float) -> LoopMemory:
    """Return what `save_memory` wrote, an empty memory where there is no file.

    Time that passed since counts: a model may be tried again when its time is over.

    Raises:
        MemoryFileError: the file cannot be read, is not a memory file, or belongs to another loop.
    """
    remedy = "delete it to begin without a memory"
    try:
        text = file.read_text(encoding="utf-8")
    except FileNotFoundError:
        return LoopMemory()
    except (OSError, UnicodeDecodeError) as error:
        raise MemoryFileError(
            f"{file}: the compensator's memory cannot be read; {remedy}"
        ) from error
    try:
        kept = _Memory.model_validate_json(text)
        known = tuple(_restored(g, period, max(0.0, now - kept.saved_at)) for g in kept.given_up)
    except (ValidationError, KeyError) as error:
        raise MemoryFileError(f"{file}: not written by a compensator; {remedy}") from error
    if kept.loop != loop:
        raise MemoryFileError(
            f"{file}: this is the memory of loop {kept.loop}, not of {loop}; give each loop its own"
        )
    return LoopMemory(kept.figures, tuple(g for g in known if g.left > 0), kept.gain_sign)


def _restored(kept: _GivenUp, period: float, passed: float) -> GivenUp:
    left = round((kept.seconds_left - passed) / period)
    return GivenUp(kept.model, FrictionPrior(uncertainty=kept.stated), left, RefusalKind[kept.why])
