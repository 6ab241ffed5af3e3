"""What a client reads after each of many scans, without a request between them.

Between two scans of a batch no client writes, so the registers follow from the truth log of the
loops alone; `read_back` rounds its values as the registers do. The registers themselves are brought
up to date once, after the last scan. A loop that looks at its own registers, because an operator
may write there, still writes and reads them in each scan.
"""

from __future__ import annotations

from collections.abc import Sequence
from time import monotonic

import numpy as np
from numpy.typing import NDArray

from fieldlink.lab.plc.hosted import exact_period, manual_value
from fieldlink.lab.plc.ports import counter_modulus
from fieldlink.lab.plc.truth import Truth
from fieldlink.lab.plc.virtual import VirtualPlc, scan_period
from fieldlink.registers import Tag, read_back
from fieldlink.site import Loop, Site

__all__ = ["ScanReader"]

_ROLES = ("op", "pv", "sp", "mode", "scan")
_LOOK = 64
"""Scans between two looks at the clock: some milliseconds of scans, of which a look is a
thousandth."""


class ScanReader:
    """Scans a PLC many times and keeps what the registers of some tags held after each scan.

    Args:
        plc: the PLC.
        site: its site.
        tags: of the device's register map.
    """

    def __init__(self, plc: VirtualPlc, site: Site, tags: Sequence[Tag]) -> None:
        self._plc = plc
        self._tags = list(tags)
        self._loops = {name: site.loops_of(plc.device)[name] for name in plc.loops}
        period = scan_period(site, plc.device)
        self._every = {name: int(exact_period(loop) / period) for name, loop in self._loops.items()}
        self._sources = _sources(self._tags, list(site.maps[plc.device].values()), self._loops)

    def scan(self, most: int, seconds: float) -> NDArray[np.float64]:
        """Scan up to ``most`` times, no new scan after ``seconds`` of the wall clock.

        Returns:
            Engineering values after each scan, shape ``(scans, tags)``; NaN for no number.
        """
        if self._sources is None:
            return self._scan_and_read(most, seconds)
        plc, first = self._plc, self._plc.scans
        held = [self._read(tag) for tag in self._tags]
        until = monotonic() + seconds
        done = 0
        while done < most and (done % _LOOK or not done or monotonic() < until):
            plc.scan(show=False)
            done += 1
        plc.show()
        truths = {name: plc.truth(name, last=done + 1) for name, _ in self._sources}
        scans = np.arange(first, first + done)
        columns = []
        for tag, before, (name, role) in zip(self._tags, held, self._sources, strict=True):
            cycles = scans // self._every[name]
            shown = self._column(truths[name], name, role, tag, cycles)
            columns.append(read_back(tag, shown, before))
        return np.column_stack(columns) if columns else np.empty((done, 0))

    def _scan_and_read(self, most: int, seconds: float) -> NDArray[np.float64]:
        rows: list[list[float]] = []
        until = monotonic() + seconds
        while len(rows) < most and (not rows or monotonic() < until):
            self._plc.scan()
            rows.append([self._read(tag) for tag in self._tags])
        return np.array(rows, dtype=np.float64)

    def _read(self, tag: Tag) -> float:
        return tag.decode(self._plc.image.read(tag.table, tag.address, tag.count)).value

    def _column(
        self, truth: Truth, name: str, role: str, tag: Tag, cycles: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return what a loop shows in a role after each of its ``cycles``, engineering units."""
        rows = cycles - int(truth.cycle[0])
        if role == "mode":
            loop = self._loops[name]
            return np.where(truth.automatic[rows], loop.auto_values[0], manual_value(loop))
        if role == "scan":
            modulus = counter_modulus(tag)
            return (cycles + 1 if modulus is None else (cycles + 1) % modulus).astype(np.float64)
        values: NDArray[np.float64] = getattr(truth, role)[rows]
        return values


def _sources(
    tags: Sequence[Tag], known: Sequence[Tag], loops: dict[str, Loop]
) -> list[tuple[str, str]] | None:
    """Return loop and role of each tag; None where the registers themselves must be looked at.

    That is so where an operator may write what a loop reads, where a tag is not a loop's or more
    than one's, and where tags share registers.
    """
    owners: dict[str, list[tuple[str, str]]] = {}
    for name, loop in loops.items():
        if loop.plant is not None and loop.plant.external is not None:
            return None
        for role in _ROLES:
            if (tag := getattr(loop, role)) is not None:
                owners.setdefault(tag, []).append((name, role))
    by_name = {tag.name: tag for tag in known}
    if any(by_name[owned].writable for owned in owners):
        return None
    sources = []
    for tag in tags:
        if len(owners.get(tag.name, ())) != 1 or any(_overlap(tag, other) for other in known):
            return None
        owner = owners[tag.name][0]
        if owner[1] == "scan" and (tag.low, tag.high) != (None, None):
            return None  # a counter beyond its range is refused
        sources.append(owner)
    return sources


def _overlap(one: Tag, other: Tag) -> bool:
    return (
        one.name != other.name
        and one.table == other.table
        and one.address < other.end
        and other.address < one.end
    )
