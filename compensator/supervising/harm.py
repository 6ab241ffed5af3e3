"""Is a compensated loop worse in both: PV deviates more and the stem travels more than before?

Either may be the price of the other for a while; both together never are. So the question is asked
over a short window of its own, from the take-over on, whatever else is being waited for.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from compensator.action import CompensatorError, require_positive, require_whole

__all__ = ["HarmSettings", "HarmWatch"]


@dataclass(frozen=True, slots=True)
class HarmSettings:
    """Settings of `HarmWatch`.

    Attributes:
        window: scans that PV and travel are averaged over.
        scans: in a row for which both must be worse: half a window, so that figures which differ a
            little from the plant's own still give the loop back within another window.
        deviation: factor of PV's root mean square that is worse.
        travel: factor of the stem's travel that is worse.
        strokes: stick bands that the stem of a loop that was at rest may travel in a window (it
            travelled less than one): a set-point and a load that step ask for two each.
    """

    window: int = 60
    scans: int = 30
    deviation: float = 1.1
    travel: float = 2.0
    strokes: float = 4.0

    def __post_init__(self) -> None:
        require_whole("HarmSettings", 1, window=self.window, scans=self.scans)
        require_positive("HarmSettings", strokes=self.strokes)
        if not (self.deviation >= 1.0 and self.travel >= 1.0):
            raise CompensatorError(
                "HarmSettings: deviation and travel are factors of at least 1; got "
                f"{self.deviation!r} and {self.travel!r}"
            )


class HarmWatch:
    """Follows error and travel under the compensator; `push` once a scan.

    Args:
        mean_square: of the error that is usual.
        travel: of the stem per scan that is usual.
        stroke: way of a correction, a stick band.
        settings: window and factors.
    """

    def __init__(
        self,
        mean_square: float,
        travel: float,
        stroke: float,
        settings: HarmSettings | None = None,
    ) -> None:
        self.settings = s = settings or HarmSettings()
        self._square = s.deviation**2 * mean_square
        usual = travel * s.window
        self._way = s.strokes * stroke if usual < stroke else s.travel * usual
        self._errors: deque[float] = deque(maxlen=s.window)
        self._ways: deque[float] = deque(maxlen=s.window)
        self._run = 0

    def push(self, error: float, way: float, quiet: float) -> bool:
        """Take in a scan; return whether both have been worse for too long.

        Args:
            error: PV minus SP, less what a set-point change explains.
            way: of the stem, less what the set-point asks for.
            quiet: mean square that noise explains.
        """
        s = self.settings
        self._errors.append(error**2)
        self._ways.append(way)
        mean = math.fsum(self._errors) / s.window
        both = mean > max(self._square, quiet) and math.fsum(self._ways) > self._way
        self._run = self._run + 1 if both else 0
        return self._run >= s.scans
