"""The write-ahead log of an SQLite file, looked at before SQLite does: what of it will be lost.

SQLite reads the log up to the first frame whose checksum does not fit and drops the rest without a
word, because that is how an unfinished transaction looks. Frames behind it that belong to the same
log were complete once: their rows are gone. The format is that of https://sqlite.org/fileformat2.html
(section 4, "The Write-Ahead Log").
"""

from __future__ import annotations

import shutil
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

__all__ = ["LogDamage", "find_log_damage", "keep_damaged_log"]

Words = NDArray[np.uint32]

_HEADER = struct.Struct(">8I")
_FRAME = struct.Struct(">6I")
_VERSION = 3007000
_ORDERS = {0x377F0682: "<u4", 0x377F0683: ">u4"}
"""The header's magic number tells the order of bytes in the words that the checksums add up."""
_MASK = 0xFFFFFFFF


@dataclass(frozen=True, slots=True)
class LogDamage:
    """What of a write-ahead log cannot be read.

    Attributes:
        frames: pages that the log holds.
        lost: of these, the ones that SQLite will drop.
    """

    frames: int
    lost: int

    def __str__(self) -> str:
        if self.lost == self.frames:
            return f"none of its {self.frames} pages can be read"
        return f"the last {self.lost} of its {self.frames} pages cannot be read"


def keep_damaged_log(database: Path) -> str:
    """Keep a copy of a damaged log and return what was found, as a sentence; empty if it is sound.

    Call it before SQLite opens the database, because SQLite then empties the log.
    """
    log = database.with_name(database.name + "-wal")
    try:
        damage = find_log_damage(log)
    except OSError as error:
        return f"{log.name} cannot be read ({error.strerror}); what it holds may be lost"
    if damage is None:
        return ""
    copy = log.with_name(f"{log.name}.damaged-{datetime.now(UTC):%Y%m%dT%H%M%SZ}")
    try:
        shutil.copyfile(log, copy)
        kept = f"a copy is kept as {copy.name}"
    except OSError as error:
        kept = f"it could not be kept as {copy.name}: {error.strerror}"
    return f"{log.name} is damaged: {damage}; the newest rows in it are lost, and {kept}"


def find_log_damage(log: Path) -> LogDamage | None:
    """Return what SQLite will drop of a log; None when it will take all that belongs to it.

    Raises:
        OSError: the file cannot be read.
    """
    if not log.is_file() or log.stat().st_size <= _HEADER.size:
        return None
    with log.open("rb") as stream:
        begin = stream.read(_HEADER.size)
        magic, version, page, _, *salts, first, second = _HEADER.unpack(begin)
        size = log.stat().st_size - _HEADER.size
        order = _ORDERS.get(magic)
        if order is None or version != _VERSION or not _is_page_size(page):
            frames = max(1, size // (_FRAME.size + 4096))
            return LogDamage(frames, frames)
        frames = size // (_FRAME.size + page)
        state = _add(np.frombuffer(begin[:24], order), (0, 0))
        if state != (first, second):
            return LogDamage(frames, frames) if frames else None
        good = mine = 0
        for number, (header, content) in enumerate(_frames(stream, page)):
            _, _, *frame_salts, one, two = _FRAME.unpack(header)
            if frame_salts != salts:
                # Of an older log in the same file, or damaged itself: what comes behind tells.
                continue
            mine = number + 1
            if good == number:
                state = _add(np.frombuffer(header[:8] + content, order), state)
                good += state == (one, two)
    return LogDamage(mine, mine - good) if mine > good else None


def _frames(stream: BinaryIO, page: int) -> Iterator[tuple[bytes, bytes]]:
    while len(frame := stream.read(_FRAME.size + page)) == _FRAME.size + page:
        yield frame[: _FRAME.size], frame[_FRAME.size :]


def _is_page_size(size: int) -> bool:
    return 512 <= size <= 65536 and size & (size - 1) == 0


def _add(words: Words, state: tuple[int, int]) -> tuple[int, int]:
    """Add words to the two sums of a checksum: s0 += x0 + s1, s1 += x1 + s0 for each pair.

    The recurrence is linear, so the sums are products with its powers, modulo 2^32.
    """
    even, odd, power = _weights(len(words) // 2)
    pairs = words.astype(np.uint32)
    x0, x1 = pairs[0::2], pairs[1::2]
    s0, s1 = state
    sums = even @ x0 + odd @ x1
    return (
        (int(sums[0]) + power[0][0] * s0 + power[0][1] * s1) & _MASK,
        (int(sums[1]) + power[1][0] * s0 + power[1][1] * s1) & _MASK,
    )


@lru_cache(maxsize=8)
def _weights(pairs: int) -> tuple[Words, Words, tuple[tuple[int, int], tuple[int, int]]]:
    """Return the weights of the even and the odd words (2, pairs), and the power of the step."""
    even = np.empty((2, pairs), np.uint32)
    odd = np.empty((2, pairs), np.uint32)
    a, b, c, d = 1, 0, 0, 1
    for number in reversed(range(pairs)):
        even[:, number] = (a + b) & _MASK, (c + d) & _MASK
        odd[:, number] = b, d
        a, b, c, d = (a + b) & _MASK, (a + 2 * b) & _MASK, (c + d) & _MASK, (c + 2 * d) & _MASK
    return even, odd, ((a, b), (c, d))
