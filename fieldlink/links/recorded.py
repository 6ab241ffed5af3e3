"""The link of kind "recording": the loops of a device played from CSV files, a row a scan.

After its last row a loop's tags are not read any more, and once all loops have ended every scan
carries a `RecordingEndedError`: no row is ever played twice.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from fieldlink.links.base import LinkState, Quality, Reading, Scan
from fieldlink.links.clock import Clock
from fieldlink.links.errors import RecordingEndedError
from fieldlink.site import Loop, Site
from fieldlink.site.missing_rows import fill_missing_rows
from fieldlink.site.recording import Recording, read_recording

__all__ = ["RecordedLink"]


@dataclass(frozen=True, slots=True)
class _Track:
    loop: Loop
    recording: Recording

    def values(self, row: int) -> Iterator[tuple[str, float]]:
        """Yield (tag, value) of one row; nothing after the last."""
        recording, loop = self.recording, self.loop
        if row >= len(recording):
            return
        yield loop.op, float(recording.op[row])
        yield loop.pv, float(recording.pv[row])
        if loop.sp is not None and recording.sp is not None:
            yield loop.sp, float(recording.sp[row])
        if loop.mode is not None:
            automatic = recording.auto is None or bool(recording.auto[row])
            yield loop.mode, loop.auto_values[0] if automatic else math.nan
        if loop.scan is not None:
            yield loop.scan, float(row)


class RecordedLink:
    """A `SteppedLink` over recordings.

    Args:
        site: the site.
        device: the device's name; each of its loops names a recording.
        clock: stamps the readings.
    """

    def __init__(self, site: Site, device: str, clock: Clock) -> None:
        self._site = site
        self._device = device
        self._clock = clock
        self._loops = site.loops_of(device)
        self._tracks: list[_Track] = []
        self._scans = 0
        self.state = LinkState.CLOSED

    @property
    def scan_period(self) -> float:
        """Plant seconds from one scan to the next: the shortest period of the loops."""
        return min(loop.period for loop in self._loops.values())

    @property
    def ended(self) -> bool:
        """Whether every row of every recording has been played."""
        return all(self._row(track) >= len(track.recording) for track in self._tracks)

    async def open(self) -> None:
        """Read the files and begin with the first row.

        Raises:
            RecordingError: a file cannot be used.
        """
        self._scans = 0
        self._tracks = [
            _Track(
                loop,
                fill_missing_rows(
                    read_recording(self._site.resolve(loop.plant.recording), period=loop.period)
                ),
            )
            for loop in self._loops.values()
            if loop.plant is not None and loop.plant.recording is not None
        ]
        self.state = LinkState.GOOD

    async def scan(self) -> Scan:
        """Play the next row of every recording."""
        now, utc = self._clock.monotonic(), self._clock.utc()
        readings = {
            tag: Reading(math.nan, Quality.NOT_READ, now, utc)
            for track in self._tracks
            for tag in track.loop.tags
        }
        ended = self.ended
        for track in self._tracks:
            for tag, value in track.values(self._row(track)):
                quality = Quality.GOOD if math.isfinite(value) else Quality.NOT_A_NUMBER
                readings[tag] = Reading(value, quality, now, utc)
        self._scans += 1
        if not ended:
            return Scan(readings, now, utc)
        self.state = LinkState.DEMOTED
        names = ", ".join(sorted({track.recording.path.name for track in self._tracks}))
        error = RecordingEndedError(
            self._device, f"all rows of {names} have been played", "stop here, or start again"
        )
        return Scan(readings, now, utc, failures=(error,))

    async def close(self) -> None:
        """Forget the recordings."""
        self._tracks = []
        self.state = LinkState.CLOSED

    def _row(self, track: _Track) -> int:
        """A loop with a longer period than the scan's keeps its row for several scans."""
        return math.floor(self._scans * self.scan_period / track.loop.period + 1e-9)
