"""When a device is lost, and when it is back: a loose contact is neither."""

from __future__ import annotations

from collections.abc import Mapping

from fieldlink.links import LinkState

__all__ = ["DeviceWatch"]


class DeviceWatch:
    """Watches the states of devices.

    Args:
        lost_after: seconds of silence from which a device is lost.
    """

    def __init__(self, lost_after: float) -> None:
        self._lost_after = lost_after
        self._silent_since: dict[str, float] = {}
        self._last: dict[str, str] = {}

    def look(self, states: Mapping[str, LinkState], now: float) -> list[tuple[str, str]]:
        """Return the devices that are lost or back since the last look, each with the word.

        Args:
            states: of each device; one that was not asked yet is closed, and no news.
            now: seconds of a clock that never steps.
        """
        found = []
        for device, state in states.items():
            word = ""
            if state in (LinkState.GOOD, LinkState.DEGRADED):
                self._silent_since.pop(device, None)
                word = "back"
            elif state is LinkState.DEMOTED:
                since = self._silent_since.setdefault(device, now)
                word = "lost" if now - since >= self._lost_after else ""
            if word and self._last.get(device) != word:
                self._last[device] = word
                found.append((device, word))
        return found
